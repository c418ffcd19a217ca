"""One answer for many recordings, computed in these steps.

1. The structure: which effects the devices have, from a few informative recordings (`structure`).
2. A quick fit of the structure to every recording, as independent tasks (`quick`, `jobs`), each
stored. 3. Which recordings are unlike the others (`odd`), and what changed over the dates
(`history`): a recording that a change explains is not odd. 4. Why the remaining ones are odd: which
fault, if corrected, makes a recording like the others (`reasons`). Odd recordings are not used in
step 5. 5. Which parameters are shared, per device or per run, and which depend on a known column
(`spread`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.compiled import compiled
from zwidth.diagnosis.mishaps import Say, silent
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.effort import EFFORTS
from zwidth.fleet.grouping import places_by
from zwidth.fleet.history import ALL, Change, changes
from zwidth.fleet.kept import Kept
from zwidth.fleet.listing import Listed, columns_of
from zwidth.fleet.odd import Course, Odd, courses, odd_ones
from zwidth.fleet.quick import Quick, Task, names_of, run
from zwidth.fleet.reading import content_of, experiment_of
from zwidth.fleet.reasons import Question, Reason, explained, unusable
from zwidth.fleet.result import Fleet, Member
from zwidth.fleet.spread import Spread, spread
from zwidth.fleet.structure import Structure, informative, sought
from zwidth.jobs.executor import Executor, Local
from zwidth.sim.device import Device

Floats = NDArray[np.float64]
LOOKED_AT = 40  # recordings among which informative ones are sought
SEARCHED = 4  # number of these in which the structure is sought
OWN_ERRORS = 1.5  # ratio of scatter to errors, above which repeats of a device differ
EACH = 8  # recordings per task
Advance = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Fitted:
    """Recordings, their quick fits and keys, and the structure."""

    structure: Structure
    candidates: Mapping[str, float]
    quicks: list[Quick]
    keys: list[str]
    fresh: int


def diagnose_fleet(
    device: Device,
    recordings: Sequence[Listed],
    work: Path,
    runner: Executor | None = None,
    effort: str = "quick",
    say: Say = silent,
    advance: Advance = lambda _, __, ___: None,
) -> Fleet:
    """Diagnose many recordings of devices that are alike.

    device: what is known about the devices; work: folder that stores results, so that a rerun
    continues and only new recordings are fitted; runner: executes the tasks, None: this process;
    effort: of the search for the structure; advance: called with the stage, the number done, and
    the total. Raises ValueError if fewer than three recordings can be used, or the device predicts
    none of them.
    """
    runner = Local() if runner is None else runner
    compiled()
    kept = Kept(work, device, effort)
    found = _fitted(device, recordings, kept, runner, effort, say, advance)
    names = names_of(found.structure)
    usable = [i for i, q in enumerate(found.quicks) if not q.problem]
    if len(usable) < 3:
        problems = "; ".join(q.problem for q in found.quicks if q.problem)
        raise ValueError(
            f"{len(usable)} of {len(recordings)} recordings can be used, and a fleet needs 3:"
            f" {problems}"
        )
    columns, left = columns_of(recordings)
    every = _Every(
        [found.quicks[i] for i in usable],
        [recordings[i].device for i in usable],
        np.array([np.nan if (d := recordings[i].day) is None else d for i in usable]),
        {n: np.array(v)[usable] for n, v in columns.items()},
    )
    course = courses(every.values, every.errors, every.devices, every.columns)
    odd = odd_ones(every.quicks, list(names), every.devices, course)
    changed = _changes(every, list(names), course, odd)
    odd = _beside(every, list(names), course, odd, changed)
    say(f"unlike the others: {len(odd)} of {len(every.quicks)} recordings")
    reasons = _reasons(every, odd, course, found, recordings, usable, kept, runner, advance)
    members: list[Member] = []
    places = {i: k for k, i in enumerate(usable)}
    for i, one in enumerate(recordings):
        k, q = places.get(i), found.quicks[i]
        reason = unusable(q.problem) if k is None else reasons.get(k)
        members.append(Member(one, q, None if k is None else odd.get(k), reason))
    sound = [k for k in range(len(usable)) if k not in reasons]
    spreads: dict[str, Spread] = {}
    repeats: dict[str, float] = {}
    if len(sound) >= 2:
        for place, name in enumerate(names):
            values = every.unchanged(place, name, changed)[sound]
            errors = every.errors[sound, place]
            devices = [every.devices[k] for k in sound]
            if np.count_nonzero(np.isfinite(errors)) < 2:
                continue
            known = {n: c[sound] for n, c in every.columns.items()}
            repeats[name] = _repeats(values - course[place].expected[sound], errors, devices)
            floor = np.maximum(errors, 1e-300) * min(max(1.0, repeats[name]), OWN_ERRORS)
            spreads[name] = spread(values, floor, devices, known)
    notes = tuple(f"{n} is not known for all recordings and is not used" for n in left)
    return Fleet(
        found.structure, names, tuple(members), spreads, tuple(changed), found.candidates,
        repeats, notes,
    )  # fmt: skip


@dataclass(frozen=True)
class _Every:
    """All fitted recordings. days: nan where unknown."""

    quicks: list[Quick]
    devices: list[str]
    days: Floats
    columns: dict[str, Floats]

    @cached_property
    def values(self) -> Floats:
        return np.stack([q.values for q in self.quicks])

    @cached_property
    def errors(self) -> Floats:
        return np.stack([q.errors for q in self.quicks])

    def unchanged(self, place: int, name: str, changed: Sequence[Change]) -> Floats:
        """Values of a parameter as they would be without its changes."""
        y = self.values[:, place].copy()
        own = np.asarray(self.devices)
        for change in changed:
            if change.parameter != name:
                continue
            mine = np.isfinite(self.days) & ((own == change.device) | (change.device == ALL))
            end = float(self.days[mine].max())
            y[mine] -= (change.after - change.before) * change.share(self.days[mine], end)
        return y


def _fitted(
    device: Device,
    recordings: Sequence[Listed],
    kept: Kept,
    runner: Executor,
    effort: str,
    say: Say,
    advance: Advance,
) -> Fitted:
    structure = kept.structure(len(recordings))
    candidates: dict[str, float] = {}
    if structure is None:
        say("looking for the most informative recordings")
        structure, candidates = _structure(device, recordings, effort, say)
        kept.keep_structure(structure, len(recordings))
    keys = [kept.key(content_of(one.path), structure) for one in recordings]
    found = [kept.fit(key, one.name) for key, one in zip(keys, recordings, strict=True)]
    missing = [i for i, q in enumerate(found) if q is None]
    parts = [missing[k : k + EACH] for k in range(0, len(missing), EACH)]
    tasks = {
        f"fit-{n}": Task(
            tuple((recordings[i].name, recordings[i].path.resolve()) for i in part), structure
        )
        for n, part in enumerate(parts)
    }
    done = len(recordings) - len(missing)
    advance("fitting", done, len(recordings))
    for key, quicks in runner.run(run, tasks):
        part = parts[int(key.partition("-")[2])]
        for i, q in zip(part, quicks, strict=True):
            found[i] = q
            kept.keep_fit(keys[i], q)
        done += len(part)
        advance("fitting", done, len(recordings))
    return Fitted(structure, candidates, [q for q in found if q is not None], keys, len(missing))


def _structure(
    device: Device, recordings: Sequence[Listed], effort: str, say: Say
) -> tuple[Structure, dict[str, float]]:
    """The structure, from recordings spread evenly over the list."""
    every = np.unique(np.linspace(0, len(recordings) - 1, LOOKED_AT).round().astype(int)).tolist()
    read: list[Experiment] = []
    devices: list[str] = []
    problem = ""
    for i in every:
        try:
            read.append(experiment_of(recordings[i].path, device, recordings[i].name))
            devices.append(recordings[i].device)
        except (ValueError, OSError) as error:
            problem = str(error)
    if not read:
        raise ValueError(f"no recording of the fleet can be used: {problem}")
    try:
        chosen = informative(device, read, devices, SEARCHED)
        return sought(device, [read[i] for i in chosen], EFFORTS[effort], say)
    except NoObserver as error:
        raise ValueError(str(error)) from error


def _changes(
    every: _Every, names: Sequence[str], course: Sequence[Course], odd: Mapping[int, Odd]
) -> list[Change]:
    """Changes over the dates, among recordings that the structure explains."""
    sound = np.array([k not in odd or not odd[k].fits_badly for k in range(len(every.quicks))])
    asked = len(names) * (len(set(every.devices)) + 1)
    devices = [d for d, good in zip(every.devices, sound, strict=True) if good]
    found: list[Change] = []
    for place, name in enumerate(names):
        own = course[place]
        middle = float(np.median(own.expected))
        values = (every.values[:, place] - own.expected + middle)[sound]
        errors = every.errors[sound, place]
        found += changes(name, every.days[sound], values, errors, devices, own.within, asked)
    return sorted(found, key=lambda c: -c.gained)


def _beside(
    every: _Every,
    names: Sequence[str],
    course: Sequence[Course],
    odd: Mapping[int, Odd],
    changed: Sequence[Change],
) -> dict[int, Odd]:
    """The recordings that are odd after the changes are removed from their values."""
    if not changed:
        return dict(odd)
    values = np.column_stack([every.unchanged(k, n, changed) for k, n in enumerate(names)])
    flat = [_with(q, values[i]) for i, q in enumerate(every.quicks)]
    again = courses(values, every.errors, every.devices, every.columns)
    return odd_ones(flat, list(names), every.devices, again)


def _with(q: Quick, values: Floats) -> Quick:
    return replace(q, values=values)


def _reasons(
    every: _Every,
    odd: Mapping[int, Odd],
    course: Sequence[Course],
    found: Fitted,
    recordings: Sequence[Listed],
    usable: Sequence[int],
    kept: Kept,
    runner: Executor,
    advance: Advance,
) -> dict[int, Reason]:
    """Why recordings are odd, by index among the fitted ones."""
    noise = float(np.median([q.noise for q in every.quicks]))
    questions: dict[int, Question] = {}
    of_device = places_by(every.devices)
    for k, one in odd.items():
        listed = recordings[usable[k]]
        # A recording is expected to have its device's own values if the others of that device are
        # not odd.
        own = of_device[listed.device].tolist()
        mates = [j for j in own if j != k and j not in odd]
        expected = np.array([c.expected[k] for c in course])
        scatter = np.array([max(c.tau, c.within) for c in course])
        if len(mates) >= 2:
            for p, c in enumerate(course):
                off = every.values[mates, p] - c.expected[mates]
                expected[p] += float(np.median(off))
                scatter[p] = max(c.within, float(np.std(off)))
        questions[k] = Question(
            listed.name, listed.path.resolve(), found.structure, expected, scatter, noise, one
        )
    reasons: dict[int, Reason] = {}
    tasks: dict[str, Question] = {}
    for k, question in questions.items():
        known = kept.reason(found.keys[usable[k]], question)
        if known is None:
            tasks[str(k)] = question
        else:
            reasons[k] = known
    advance("finding out why", len(reasons), len(questions))
    for key, reason in runner.run(explained, tasks):
        k = int(key)
        reasons[k] = reason
        kept.keep_reason(found.keys[usable[k]], questions[k], reason)
        advance("finding out why", len(reasons), len(questions))
    return reasons


def _repeats(off: Floats, errors: Floats, devices: Sequence[str]) -> float:
    """Scatter of recordings of one device, over their estimated errors."""
    total, free = 0.0, 0
    for own in places_by(devices).values():
        mine = own[np.isfinite(errors[own]) & (errors[own] > 0.0)]
        if mine.size < 2:
            continue
        weight = 1.0 / errors[mine] ** 2
        mean = float(np.average(off[mine], weights=weight))
        total += float(np.sum(weight * (off[mine] - mean) ** 2))
        free += mine.size - 1
    return float(np.sqrt(total / free)) if free else 0.0

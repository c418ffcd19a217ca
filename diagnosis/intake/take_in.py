"""Prepares recordings for the diagnosis: checks, corrects, and leaves out unusable parts.

A wrong sign or unit of a recording is a hypothesis beside physics. For each way to read the
recordings that the gate suspects (`readings`), physics is searched, and the way of least cost is
kept (`likeliest`).
"""

import math
import re
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from typing import TypeVar

from zwidth.diagnosis.answer.result import NotDiagnosed, Unanswered
from zwidth.diagnosis.intake.counted import as_counted, open_zeros
from zwidth.diagnosis.intake.derived import measured_alone
from zwidth.diagnosis.intake.gate import (
    COMMAND,
    Fault,
    Suspicion,
    corrected,
    oddities,
    suspicion,
)
from zwidth.diagnosis.intake.hold import smooth, was_smooth
from zwidth.diagnosis.intake.late import in_time
from zwidth.diagnosis.intake.rectified import as_known, unfolded
from zwidth.diagnosis.intake.swapped import EXCHANGED, in_place
from zwidth.diagnosis.intake.units import unit_of
from zwidth.diagnosis.mishaps import collecting, debugging, isolated, silent
from zwidth.diagnosis.model.own_values import refuse_unknown_words
from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment, ExperimentError
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.diagnosis.selection.evidence import ALPHA, rarity
from zwidth.diagnosis.selection.search import search
from zwidth.diagnosis.settings import INTAKE
from zwidth.sim.device import Device

Result = TypeVar("Result")
NUMBER = re.compile(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class Taken:
    """Complete recordings, the part of each to fit, and the held-out recordings that judge.

    faults: of all recordings; folded: factor by which their prediction is better unfolded, or 1.
    whole_unopened: whether the held-out data are a part of these recordings, and not others.
    left_out: indices of recordings that an error excluded. misread: index in fit_on and fault of
    each correction of this reading; doubted: whether a validation recording is suspected. device:
    with its zeros as free as the recordings require.
    """

    device: Device
    whole: tuple[Experiment, ...]
    fit_on: tuple[Experiment, ...]
    judge_by: tuple[Experiment, ...]
    faults: tuple[Fault, ...]
    folded: float
    whole_unopened: bool
    left_out: tuple[int, ...]
    misread: tuple[tuple[int, Fault], ...] = ()
    doubted: bool = False


def take_in(
    device: Device, experiments: Sequence[Experiment], validate: Sequence[Experiment] | None
) -> Taken:
    """Prepare recordings in their most likely reading, by a quick search with each reading.

    They stay as they are if an error disturbed such a search. Raises as `readings` does.
    """
    refuse_unknown_words(experiments, validate or ())
    every = readings(device, experiments, validate)
    if len(every) == 1 and not every[0].doubted:
        return every[0]

    def quick(taken: Taken) -> tuple[float, Device]:
        best = search(taken.device, taken.fit_on, QUICK).best
        return best.cost.total, best.model.build(best.x)

    with isolated("gate", "which reading is likeliest"), suppress(NoObserver):
        with collecting(silent) as mishaps:
            before = len(mishaps.of("search"))
            kept = likeliest(every, quick)
        if len(mishaps.of("search")) == before:  # an effect not tried may look like a wrong unit
            return judged_anew(*kept)
    return every[0]


def readings(
    device: Device, experiments: Sequence[Experiment], validate: Sequence[Experiment] | None
) -> list[Taken]:
    """Return the ways to read recordings: as they are, and at most two suspected others.

    Velocities that were computed from positions are left out (`intake.derived`); velocities that
    are an encoder's counts become positions (`intake.counted`). Each recording is unfolded,
    exchanged columns are put in order (`intake.swapped`), the command is shifted to the time when
    it acts (`intake.late`), suspected faults are corrected, and the command is read as held or
    smooth. A validation recording is corrected if a fitted one is corrected by the same factor. An
    error in one of several recordings excludes only that one. Raises ExperimentError if the only
    one cannot be used, and NotDiagnosed if an error leaves none.
    """

    def looked_at(e: Experiment) -> _Looked:
        one, factor = _folded_out(device, e)
        found: list[Fault] = []
        with isolated("gate", f"whether columns of {e.name} are exchanged"):
            one, found = in_place(device, one)
        lost = any(f.kind == EXCHANGED for f in found)  # a command read as a motion
        with isolated("gate", f"whether the command of {e.name} comes late"):
            # The signs of an unfolded output were chosen for the command at its recorded times.
            one, late = in_time(device, one) if not (lost or one.folded) else (one, [])
            found += late
        suspect = suspicion(device, one)
        odd = oddities(device, corrected(one, next(iter(suspect.ways), ())))
        suspect = suspect if not lost else Suspicion()
        return _Looked(one, factor, tuple(found + odd), suspect.ways, suspect.certain)

    measured = [*experiments, *(validate or ())]
    with isolated("gate", "velocities that were worked out from positions"):
        measured = measured_alone(measured)
    with isolated("gate", "velocities that are counts"):
        measured = as_counted(device, measured)
        device = open_zeros(device, measured)
    _refuse_other_outputs(measured)
    experiments, judging = measured[: len(experiments)], measured[len(experiments) :]
    passed = _each(experiments, looked_at)
    others = _each(judging, looked_at) if judging else []
    looked = [one for _, one in passed]
    certain = any(one.ways for one in looked) and all(one.certain for one in looked if one.ways)
    if certain:  # one way to read them; the fault mentions the alternative
        looked = [one.decided() for one in looked]
    ways: list[list[tuple[Fault, ...]]] = [] if certain else [[() for _ in looked]]
    for turn in range(max(len(one.ways) for one in looked)):
        ways.append([one.ways[min(turn, len(one.ways) - 1)] if one.ways else () for one in looked])
    whole = validate is None
    judges = [one for _, one in others]

    def taken(way: Sequence[tuple[Fault, ...]]) -> Taken:
        places = [place for place, _ in passed]
        return _taken(device, looked, places, way, judges, whole, len(experiments))

    return [taken(way) for way in ways]


def _refuse_other_outputs(experiments: Sequence[Experiment]) -> None:
    """Raise ExperimentError unless all recordings have the same outputs, in the same order."""
    first, *others = experiments
    for e in others:
        if e.outputs != first.outputs:
            own, had = (" and ".join(o.name for o in each.outputs) for each in (e, first))
            raise ExperimentError(
                f"{e.name} has {own}, but {first.name} has {had}; recordings that are diagnosed"
                " together need the same outputs: leave the others out of the recordings' TOML"
            )


@dataclass(frozen=True)
class _Looked:
    """A recording as read, the factor gained, facts and suspicions; certain: with any physics."""

    experiment: Experiment
    factor: float
    odd: tuple[Fault, ...]
    ways: tuple[tuple[Fault, ...], ...]
    certain: bool = False

    def decided(self) -> "_Looked":
        """Return it with only the most likely way, whose faults mention alternatives."""
        if not self.ways:
            return self
        others = [f for way in self.ways[1:] for f in way]
        return replace(self, ways=(tuple(_doubted(f, others) for f in self.ways[0]),))


def _taken(
    device: Device,
    looked: Sequence[_Looked],
    places: Sequence[int],
    way: Sequence[tuple[Fault, ...]],
    judges: Sequence[_Looked],
    whole: bool,
    asked: int,
) -> Taken:
    """The recordings corrected in one way."""
    same = {(f.channels, f.value) for wrong in way for f in wrong}
    first = [corrected(one.experiment, wrong) for one, wrong in zip(looked, way, strict=True)]
    swing = max(e.swing for e in first)  # one origin for all

    def acted(e: Experiment) -> tuple[Experiment, list[Fault]]:
        return _as_it_acted(device, replace(e, swing=swing))

    kept = _each(first, acted)
    whole_ones = tuple(e for _, (e, _) in kept)
    notes = [note for _, (_, notes) in kept for note in notes]
    misread = tuple((k, fault) for k, (place, _) in enumerate(kept) for fault in way[place])
    wrong = [fault for each in way for fault in each]
    if whole:
        fit_on, judge_by = zip(*(e.split() for e in whole_ones), strict=True)
    else:
        alike = [
            next((w for w in one.ways if all((f.channels, f.value) in same for f in w)), ())
            for one in judges
        ]
        wrong += [fault for each in alike for fault in each]
        turned = [corrected(one.experiment, w) for one, w in zip(judges, alike, strict=True)]
        fit_on, judge_by = whole_ones, tuple(e for _, (e, _) in _each(turned, acted))
    odd = said_once([fault for one in looked for fault in one.odd])
    return Taken(
        device, whole_ones, fit_on, judge_by, (*wrong, *odd, *notes),
        max(one.factor for one in looked), whole,
        tuple(sorted({*range(asked)} - {places[place] for place, _ in kept})),
        misread, any(one.ways for one in judges),
    )  # fmt: skip


def said_once(faults: Sequence[Fault]) -> list[Fault]:
    """Return faults; only the largest of equal ones from stretches of one recording."""
    found: dict[tuple[str, str, str], Fault] = {}
    for fault in faults:
        said = (fault.kind, fault.recording, NUMBER.sub("#", fault.sentence))
        if said not in found or abs(fault.value) > abs(found[said].value):
            found[said] = fault
    return list(found.values())


def misread_price(taken: Taken) -> float:
    """Return the cost of a reading in addition to that of its hypothesis, in -2 ln.

    A reading that corrects a measured output y by s predicts z = s y. For n samples

        p(y) = |s|^n p(z),    -2 ln p(y) = -2 ln p(z) - 2 n ln |s|:

    so the misfit of z is 2 n ln |s| larger because of its unit alone, which is subtracted here. The
    same fault in all recordings counts once, otherwise each time; a factor that is not a unit is
    one of 2 ln 1000 / width possible ones.
    """
    price = 0.0
    for place, fault in taken.misread:
        if fault.channels != COMMAND:
            samples = int(taken.fit_on[place].known[SETTLING:].sum()) * len(fault.channels)
            price -= 2.0 * samples * math.log(abs(fault.value))
    kinds = Counter((fault.channels, fault.value) for _, fault in taken.misread)
    for (_, factor), count in kinds.items():
        once = count == len(taken.fit_on)
        price += (1 if once else count) * _rarity(factor)
    return price


def _rarity(factor: float) -> float:
    if math.isclose(abs(factor), 1.0) or unit_of(factor) is not None:
        return rarity([INTAKE.unit_odds])
    wide = 2.0 * math.log(1e3) / INTAKE.factor_width  # a factor of 1000 either way
    return rarity([INTAKE.factor_odds]) + 2.0 * math.log(wide) - math.log(2.0 * math.pi)


def likeliest(
    every: Sequence[Taken], search: Callable[[Taken], tuple[float, Result]]
) -> tuple[Taken, Result]:
    """Return the reading of least cost, and the result of the search with it.

    search: returns the cost of the best hypothesis for a reading and its result, or raises
    NoObserver, which excludes the reading. Raises NoObserver if no reading is left. If another
    correction explains the recording equally well, the fault mentions it.
    """
    found: list[tuple[float, Taken, Result]] = []
    last: NoObserver | None = None
    for taken in every:
        try:
            cost, result = search(taken)
            found.append((cost + misread_price(taken), taken, result))
        except NoObserver as error:
            last = error
    if not found:
        raise last or NoObserver("there is no recording")
    least = min(cost for cost, _, _ in found)
    least, kept, result = next(
        one for one in found if one[0] <= least + 1.0
    )  # the first of equally good ones
    near = -2.0 * math.log(ALPHA)
    as_good = [t for c, t, _ in found if t is not kept and t.misread and c - least < near]
    return (_with_doubt(kept, as_good) if kept.misread else kept), result


def _with_doubt(kept: Taken, as_good: Sequence[Taken]) -> Taken:
    """Add to each fault the other channel that may be at fault."""
    others = [f for taken in as_good for _, f in taken.misread]
    misread = tuple((place, _doubted(fault, others)) for place, fault in kept.misread)
    known = {id(old): new for (_, old), (_, new) in zip(kept.misread, misread, strict=True)}
    faults = tuple(known.get(id(fault), fault) for fault in kept.faults)
    return replace(kept, misread=misread, faults=faults)


def _doubted(fault: Fault, others: Sequence[Fault]) -> Fault:
    other = [f for f in others if f.recording == fault.recording and f.channels != fault.channels]
    if not other:
        return fault
    names = " and ".join(dict.fromkeys(name for f in other for name in f.channels))
    by = f"{other[0].value:.3g}"
    more = (
        f"; or {names} may be wrong instead, by a factor of {by}: the recording cannot tell which"
    )
    return replace(fault, sentence=fault.sentence + more)


def judged_anew(taken: Taken, found: Device) -> Taken:
    """Correct validation recordings that are suspect for the device of the search.

    No search uses them, and a suspicion by the device file alone may be due to physics.
    """
    if not taken.doubted:
        return taken
    judges: list[Experiment] = []
    faults: list[Fault] = []
    for e in taken.judge_by:
        wrong: tuple[Fault, ...] = ()
        with isolated("gate", e.name):
            wrong = next(iter(suspicion(found, e).ways), ())
        judges.append(corrected(e, wrong))
        faults += wrong
    every = tuple(sorted((*taken.faults, *faults), key=lambda fault: not fault.wrong))
    return replace(taken, judge_by=tuple(judges), faults=every, doubted=False)


def not_diagnosed(stage: str, error: Exception, faults: Sequence[Fault] = ()) -> NotDiagnosed:
    """Return the exception for an error in a stage without which there is no answer."""
    with collecting(silent) as mishaps:
        sentence = f"nothing can be concluded: {mishaps.keep(stage, '', error).sentence}"
        return NotDiagnosed(Unanswered(sentence, tuple(faults), tuple(mishaps.found)))


def _each(
    experiments: Sequence[Experiment], work: Callable[[Experiment], Result]
) -> list[tuple[int, Result]]:
    """Results of work on recordings, by index; an error in one of several excludes only it."""
    found: list[tuple[int, Result]] = []
    for place, e in enumerate(experiments):
        try:
            with isolated("gate", e.name) if len(experiments) > 1 else nullcontext():
                found.append((place, work(e)))
        except ExperimentError:
            raise
        except Exception as error:
            if debugging():
                raise
            raise not_diagnosed("gate", error) from error
    if not found:
        raise not_diagnosed("gate", ExperimentError("no recording is left"))
    return found


def _folded_out(device: Device, e: Experiment) -> tuple[Experiment, float]:
    """Restore the signs of a rectifying sensor; returns the factor gained, or 1."""
    if any(p.effect.name == "rectified_sensor" for p in device.physics):
        return as_known(device, e), 1.0
    tried = unfolded(device, e)
    return (e, 1.0) if tried is None else (tried.experiment, tried.factor)


def _as_it_acted(device: Device, e: Experiment) -> tuple[Experiment, list[Fault]]:
    """Read a command as smooth if stated, if a motion is prescribed, or if that is much better."""
    if device.interface.command_hold == "smooth":
        return smooth(e), []
    if e.pushed is not None:
        said = f"the prescribed motion of {e.name} is assumed to be smooth between its samples"
        return smooth(e), [Fault("smooth_command", said, False, 1.0, e.name)]
    factor = was_smooth(device, e)
    if factor is None:
        return e, []
    sentence = (
        f"the command of {e.name} is assumed to be smooth between its samples, which explains the"
        f" motion {factor:.3g} times better than a command held constant between them"
    )
    return smooth(e), [Fault("smooth_command", sentence, False, factor, e.name)]

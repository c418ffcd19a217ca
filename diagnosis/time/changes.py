"""What changes while a device is recorded: suspected (`time.score`), fitted, dated, and believed.

The recording is cut where the parameter changes; its parts share all parameters, and the change is
one more (`Model.varying`). It is believed as any number is (`selection.evidence`), over everything
that was tried and stays the same, not only over the answer without it (a damper that settles may
stand for friction that was refused), and where free runs on held-out data, which come after it, err
no more with it than without: a law that lacks a state that differs between parts of a recording
looks like a change. With a change the device is as it was at the end; the rest of a recording is
judged by what it was in that.

An observer that has not yet forgotten predicts less of a step than its slopes do just after it, so
that slopes date it late, by tens of ticks. So it is dated by going through it at every tick about
there, with what was fitted before it and after, in one run.

Limit: what moves slowly is fitted in parts of a recording, each at its mean.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.intake.take_in import Taken
from zwidth.diagnosis.mishaps import Say, attempt
from zwidth.diagnosis.model.parameters import Varying
from zwidth.diagnosis.noise.beginning import begun
from zwidth.diagnosis.noise.predictor import (
    SEARCHING,
    SETTLING,
    copied,
    memory_at,
    prepared,
    window,
)
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.effort import Effort
from zwidth.diagnosis.selection.evidence import believed
from zwidth.diagnosis.selection.hypothesis import Hypothesis, against, judged, priced, settled
from zwidth.diagnosis.selection.search import Search
from zwidth.diagnosis.selection.searched import Searched, as_found
from zwidth.diagnosis.settings import CHANGES, EVIDENCE
from zwidth.diagnosis.time.score import CUT, DRIFT, SETTLES, STEP, Suspect, suspected
from zwidth.sim.device import Device
from zwidth.sim.kernel import Memory
from zwidth.sim.predict import alone

Floats = NDArray[np.float64]
Errs = Callable[[Hypothesis, Sequence[Experiment]], float]


@dataclass(frozen=True)
class Varied:
    """A change that was fitted, and how it was asked for.

    experiments: before it was asked for; hypothesis: with it, on recordings in parts; without: the
    same parts without. names: of the change, of several where every recording has its own. free:
    what free runs on held-out data err by without it and with it, None where it is held out itself.
    """

    suspect: Suspect
    names: tuple[str, ...]
    experiments: Sequence[Experiment]
    hypothesis: Hypothesis
    without: Hypothesis
    free: tuple[float, float] | None = None

    @property
    def gained(self) -> float:
        """In -2 ln, all paid."""
        return self.without.cost.total - self.hypothesis.cost.total


def changing(
    device: Device, found: Searched, taken: Taken, errs: Errs, say: Say
) -> tuple[Searched, Taken, tuple[Varied, ...]]:
    """Return what was found with what changes, what is to judge it, and the changes.

    errs: what free runs of a hypothesis on recordings err by.
    """
    changes: list[Varied] = []
    while len(changes) < CHANGES.most:
        more = attempt("changes", "", partial(_one_more, device, found, taken, errs, say))
        if more is None:
            break
        found, taken, new = more
        changes.append(new)
    if not changes:
        later = attempt("changes", "in held-out data", partial(_held_out, found.tried.best, taken))
        if later is not None:
            taken, new = later
            changes.append(new)
    return found, taken, tuple(changes)


def _one_more(
    device: Device, found: Searched, taken: Taken, errs: Errs, say: Say
) -> tuple[Searched, Taken, Varied] | None:
    new = _believed(found.tried, taken, errs, say)
    if new is None:
        return None
    again = as_found(device, _rivals_anew(found.tried, new))
    again = replace(again, held=found.held, far=found.far, beside=found.beside)
    return again, replace(taken, judge_by=_as_it_goes_on(taken.judge_by, new)), new


def _believed(tried: Search, taken: Taken, errs: Errs, say: Say) -> Varied | None:
    """A change within what was fitted, which held-out data bear out."""
    suspect = suspected(tried.best)
    if suspect is None:
        return None
    say(f"fitting {suspect.of.replace('@', ' at ')} with a change: {suspect.course}")
    new = varied(tried.best, suspect)
    if new is None or not _over_all_that_stays(tried, new):
        return None
    free = (
        errs(tried.best, taken.judge_by),
        errs(new.hypothesis, _as_it_goes_on(taken.judge_by, new)),
    )
    if not free[1] <= free[0]:
        say("free runs on held-out data err more with the change: it is not believed")
        return None
    return replace(new, free=free)


def _over_all_that_stays(tried: Search, new: Varied) -> bool:
    """Whether a change is ahead of all that were tried and stay the same.

    It is believed over those that have nothing that it lacks, and costs less than all others. They
    were fitted to recordings as they are, and it to their parts: what an answer costs on both
    without the change says by how much the parts differ.
    """
    h, best = new.hypothesis, tried.best
    cost = h.cost.total + best.cost.total - new.without.cost.total
    odds = 2.0 * against(h, new.without).phi * math.log(1.0 / EVIDENCE.alpha)
    return all(
        other.cost.total - cost > (odds if other.labels <= h.labels else 0.0)
        for other in (best, *tried.tried.values())
        if not other.against_physics
    )


def _rivals_anew(tried: Search, new: Varied) -> Search:
    """The best with its change, and beside it what comes near, fitted anew to the same parts."""
    best, parts = new.hypothesis, new.hypothesis.experiments

    def again(h: Hypothesis, varying: tuple[Varying, ...]) -> Hypothesis | None:
        model = replace(h.model, varying=varying)
        x = np.append(h.x, np.zeros(len(model.parameters) - h.x.size))
        return attempt("changes", h.model.label, lambda: settled(judged(parts, model, x, h.family)))

    plain = new.without  # the refit is that of a device that stays the same
    if tried.plain is not tried.best:
        plain = again(tried.plain, tried.plain.model.varying) or plain
    found = replace(
        tried, plain=plain, best=best, tried={}, grown=set(), looked=set(), exchanged=set()
    )
    near = tried.best.cost.total + Effort.near_rival
    for h in tried.tried.values():
        rival = h.labels not in (best.labels, plain.labels)
        if rival and (h.cost.total < near or h.labels < best.labels):
            other = again(h, best.model.varying)
            if other is not None:
                found.keep(other)
    for h in (plain, best):
        found.keep(h)
    return found


def _held_out(best: Hypothesis, taken: Taken) -> tuple[Taken, Varied] | None:
    """A step in the held-out part of the one recording, dated by all of it.

    What comes before it still judges, where two free runs fit into that.
    """
    if not taken.whole_unopened or len(taken.whole) != 1 or len(taken.judge_by) != 1:
        return None
    (held,) = taken.judge_by
    if held.before is None:
        return None
    first = held.before.ticks
    h = priced(judged(taken.whole, best.model, best.x, best.family, best.family.near(best.ratio)))
    suspect = suspected(h)
    if suspect is None or suspect.shape != STEP or suspect.at < first - SETTLING:
        return None
    new = varied(h, suspect)
    if new is None:
        return None
    until = round(new.suspect.at) - first
    if until >= 2 * window(held):
        taken = replace(taken, judge_by=(replace(held.part(0, until), before=held.before),))
    return taken, new


def varied(h: Hypothesis, suspect: Suspect) -> Varied | None:
    """Fit a change that is suspected; None where it is not believed. Raises NoObserver."""
    first = len(h.model.varying) + 1
    names = tuple(f"change {first + i}" for i in range(len(suspect.amounts)))
    parts = cut(h.experiments, suspect, names)
    if len({e.shares for e in parts}) < 2:
        return None
    own = [Varying(name, suspect.of, suspect.shape not in CUT, 0.0 if i else suspect.price)
           for i, name in enumerate(names)]  # fmt: skip
    model = replace(h.model, varying=(*h.model.varying, *own))
    without = settled(judged(parts, h.model, h.x, h.family))
    x = model.within(np.append(without.x, suspect.amounts))
    best = settled(judged(parts, model, x, h.family))
    if best.against_physics or not believed(best.cost, without.cost, against(best, without).phi):
        return None
    if suspect.shape == STEP:
        at, between = _dated(h.experiments, best, suspect)
        suspect = replace(suspect, at=at, between=between)
        parts = cut(h.experiments, suspect, names)
        best = settled(judged(parts, model, best.x, h.family))
        without = settled(judged(parts, h.model, without.x, h.family))
    return Varied(suspect, names, h.experiments, best, without)


def cut(
    experiments: Sequence[Experiment], suspect: Suspect, names: Sequence[str]
) -> list[Experiment]:
    """Return recordings in parts in each of which a change holds as much as in all of it.

    names: of the change, one for each of its amounts.
    """
    end, before = sum(e.ticks for e in experiments), 0
    found: list[Experiment] = []
    for e in experiments:
        for a, b in itertools.pairwise(_edges(e.ticks, suspect, before, end)):
            part = e.part(a, b) if (a, b) != (0, e.ticks) else e
            shares = zip(names, suspect.held(part, before + a, end), strict=True)
            own = tuple((name, share) for name, share in shares if share)
            found.append(replace(part, shares=(*e.shares, *own)))
        before += e.ticks
    return found


def _edges(ticks: int, suspect: Suspect, before: int, end: int, pieces: int = 16) -> list[int]:
    """Where a recording is cut: at a step, or evenly into so many of all, long enough to observe.

    A step that is as near to an end as an observer needs is that end. 8 pieces left a gain of 213
    of a drift by 7 %.
    """
    if suspect.shape in CUT:
        at = round(suspect.at) - before
        inside = suspect.shape == STEP and 2 * SETTLING <= at <= ticks - 2 * SETTLING
        return [0, at, ticks] if inside else [0, ticks]
    count = max(1, min(round(pieces * ticks / end), ticks // (3 * SETTLING)))
    return np.linspace(0, ticks, count + 1).round().astype(np.int64).tolist()


def _dated(
    experiments: Sequence[Experiment], h: Hypothesis, suspect: Suspect
) -> tuple[float, tuple[float, float]]:
    """Return when a step is, and the 95 % interval, in ticks of all recordings.

    h: with the step, fitted to the recordings in their parts.
    """
    before, place = 0, 0
    while place < len(experiments) - 1 and suspect.at >= before + experiments[place].ticks:
        before += experiments[place].ticks
        place += 1
    e = experiments[place]
    at = round(suspect.at) - before
    if len(_edges(e.ticks, suspect, before, 1)) < 3:  # between two recordings: it is not known when
        return suspect.at, suspect.between
    wide = round(0.5 * (suspect.between[1] - suspect.between[0]))
    half = min(max(2 * SETTLING, wide), e.ticks // 3)
    ticks, costs, best = np.array([at]), np.zeros(1), 0
    for _ in range(3):  # again where the best is at an edge of what was asked
        first, last = max(SETTLING, at - half), min(e.ticks - SETTLING, at + half)
        ticks = np.unique(np.linspace(first, last, 150).round().astype(np.int64))
        costs = _going_through(e, h, ticks, min(e.ticks, last + SETTLING))
        best = int(np.argmin(costs))
        at = int(ticks[best])
        if 0 < best < ticks.size - 1:
            break
    near = np.flatnonzero(costs < costs[best] + CHANGES.dated * suspect.told.phi)
    # It may be anywhere between two that were tried.
    ends = ticks[max(0, near[0] - 1)], ticks[min(ticks.size - 1, near[-1] + 1)]
    return before + at, (float(before + ends[0]), float(before + ends[1]))


def _going_through(e: Experiment, h: Hypothesis, ticks: NDArray[np.int64], stop: int) -> Floats:
    """What a recording costs (ticks,) until a tick where a step is at each of some."""
    model, x, observer = h.model, h.x, h.noise.observer
    device = model.acting(x)
    held = [model.seen(replace(e, shares=(*e.shares, *own)), x)
            for own in (((model.varying[-1].name, 1.0),), ())]  # fmt: skip
    early, late = (prepared(own.on(device), SEARCHING) for own in held)
    places, begun_there = held[0].places(early.coarse), begun(device, held[0], observer)
    memory, full = memory_at(early, begun_there, device, observer.gain)
    forces = held[0].external(early.coarse.dof)

    def through(side: int, a: int, b: int, memory: Memory) -> Floats:
        own, eq = held[side], (early, late)[side]
        return alone(eq.coarse, eq.fine, places, own.command[a:b], own.measured[a:b], full,
                     forces[a:b], memory, own.strengths_in(slice(a, b)))  # fmt: skip

    start = int(ticks[0])
    before: list[Floats] = [through(0, 0, start, memory)]
    costs: list[float] = []
    for here, tick in zip([start, *ticks[:-1].tolist()], ticks.tolist(), strict=True):
        before.append(through(0, here, tick, memory))
        after = through(1, tick, stop, copied(memory))
        white = observer.weigh(np.concatenate([*before, after]))[start - SETTLING // 2 :]
        costs.append(float(np.sum(white**2)))
    return np.nan_to_num(np.array(costs), nan=np.inf, posinf=np.inf)


def _as_it_goes_on(judge_by: Sequence[Experiment], new: Varied) -> tuple[Experiment, ...]:
    """Recordings to judge by, where a change goes on as it did."""
    if new.suspect.shape in CUT:
        return tuple(_as_its_first_part(e, new) for e in judge_by)
    return tuple(part for e in judge_by for part in _in_parts(e, new))


def _as_its_first_part(e: Experiment, new: Varied) -> Experiment:
    """The rest of a recording, with as much of a change as its first part had at its end.

    A step from one recording to the next, or one run that is unlike the others, is so to their ends
    as well. What stands by itself is judged by the device as it was at last.
    """
    if (first := e.before) is None:
        return e
    end = first.begins + (first.ticks - 0.5) * first.period
    alike = [p for p in new.hypothesis.experiments if p.name == first.name and p.begins < end]
    last = max(alike, key=lambda p: p.begins, default=None)
    own = () if last is None else tuple(s for s in last.shares if s[0] in new.names)
    if not own:
        return e
    return replace(e, shares=(*e.shares, *own), before=replace(first, shares=(*first.shares, *own)))


def _in_parts(e: Experiment, new: Varied, most: int = 8) -> Iterator[Experiment]:
    """A recording in at most so many parts, where what drifts goes on, or follows what it has."""
    suspect, fitted, before = new.suspect, new.experiments, e.before
    followed = suspect.covariate
    goes_on = before is not None and len(fitted) == 1 and suspect.shape in (DRIFT, SETTLES)
    follows = followed is not None and any(c.name == followed.name for c in e.covariates)
    if not (goes_on or follows):
        yield e
        return
    end = fitted[0].ticks
    count = max(1, min(most, e.ticks // (3 * SETTLING)))
    edges = np.linspace(0, e.ticks, count + 1).round().astype(np.int64).tolist()
    for a, b in itertools.pairwise(edges):
        part = replace(e.part(a, b), before=before)
        (share,) = suspect.held(part, end + a, end)
        before = replace(part, shares=(*e.shares, (new.names[0], share)))
        yield before

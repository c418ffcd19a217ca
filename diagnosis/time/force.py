"""The force of an event, fitted through the kernel: what acted, tick by tick, and how sure that is.

An event is a force f(t) = sum_j f_j phi_j(t), phi_j each tick by itself about what is short, and
hats over what lasts. The window about it is run through the kernel from the state that the observer
has there, so that friction, play and limits do what they do under that force; Gauss and Newton's
steps, damped, minimise

    |r(f)|^2 + |f / size|^2,

r the whitened innovations of the window and `size` far more than was seen, so that what sticks (no
force shows there) has an answer. A slip is one number instead, of a reading or of the force in a
spring, from its tick on; of several places and kinds the one is taken of which |r|^2, its numbers
and twice ln(rows) for the time and size of each of its pulses are least.

The tick of a slip is sought by what one number there takes off, to first order: with s the slope of
r by the number and r0 without it, |r0|^2 - (s'r0)^2 / s's. From the tick where that is least it is
fitted, and at its neighbours as far as they date it as well or better. Limit: two ticks that both
explain it, with worse ones between them, are dated as the one that is better to first order.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.uncertainty import inflation
from zwidth.diagnosis.noise.predictor import SEARCHING, copied, memory_at, prepared
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.hypothesis import Hypothesis
from zwidth.diagnosis.settings import CHANGES, EVIDENCE
from zwidth.sim.place import masses_and_links, place_at
from zwidth.sim.predict import alone

Floats = NDArray[np.float64]


class Pulse(NamedTuple):
    """From which tick of a recording on, and for how many, a force is asked for."""

    first: int
    ticks: int

    def shapes(self, short: int = 6, hats: int = 6) -> list[tuple[int, tuple[float, ...]]]:
        """First tick and values of each phi: ticks of what is short, else so many hats over it."""
        if self.ticks <= short:  # and two ticks beside it
            return [(t, (1.0,)) for t in range(self.first - 2, self.first + self.ticks + 2)]
        wide = max(1, self.ticks // hats)
        hat = tuple((1.0 - np.abs(np.arange(1 - wide, wide)) / wide).tolist())
        middles = range(self.first - wide, self.first + self.ticks + wide + 1, wide)
        return [(m + 1 - wide, hat) for m in middles]


@dataclass(frozen=True)
class Source:
    """Where something enters: a mass, a link, or an output's reading (its name, and which).

    lasting: from its time on for good, as what slips is.
    """

    place: str
    sensor: int | None = None
    lasting: bool = False

    def row(self, size: int) -> Floats:
        """Return what one of it adds to each of so many masses, or outputs (size,)."""
        return place_at(self.place).row(size) if self.sensor is None else np.eye(size)[self.sensor]


def sources(h: Hypothesis) -> Iterator[Source]:
    """Yield where an event may enter: a force at masses and links, a slip of readings, springs."""
    chain = h.model.build(h.x).chain
    places = masses_and_links(chain.masses.size)
    for place in places:
        yield Source(str(place))
    for i, o in enumerate(h.experiments[0].outputs):
        if o.quantity == "position":
            yield Source(o.name, sensor=i, lasting=True)
    for place in places:
        if place.kind == "link" or (place.index == 0 and chain.ground_spring > 0.0):
            yield Source(str(place), lasting=True)


@dataclass(frozen=True)
class Happened:
    """One event, in ticks of one of the recordings.

    first, last: where it is looked at. force (last - first,) at each tick, [N m | N], or the one
    amount of what lasts (of a reading [rad | m]); covariance of it. gain: chi-square. between: of
    what lasts, ticks that date it as well. elsewhere: places that explain it as well. pulses: that
    it was asked for.
    """

    recording: int
    source: Source
    first: int
    last: int
    force: Floats
    covariance: Floats
    gain: float
    between: tuple[float, float]
    elsewhere: tuple[str, ...] = ()
    pulses: tuple[Pulse, ...] = ()

    def on(self, e: Experiment) -> Experiment:
        """Return a recording in which the event is known."""
        if (o := self.source.sensor) is not None:
            measured = e.measured.copy()
            measured[self.first :, o] -= self.force[0]
            return replace(e, measured=measured)
        masses = 1 + max(place_at(self.source.place).ends)
        masses = max(masses, 0 if e.force is None else e.force.shape[1])
        own = np.zeros((e.ticks, 0)) if e.force is None else e.force
        force = np.pad(own, ((0, 0), (0, masses - own.shape[1])))
        end = e.ticks if self.source.lasting else self.last
        force[self.first : end] += self.force[:, None] * self.source.row(masses)
        return replace(e, force=force)


def with_events(recordings: Sequence[Experiment], known: Sequence[Happened]) -> list[Experiment]:
    """Return recordings that know of events: their forces act, their slips are taken off."""
    found = list(recordings)
    for one in known:
        found[one.recording] = one.on(found[one.recording])
    return found


class Window:
    """A recording about an event, from the state that the observer has before it.

    lead, tail: ticks before and after the event, in which it is fitted.
    """

    def __init__(
        self, h: Hypothesis, recording: int, first: int, last: int, lead: int = 60, tail: int = 150
    ) -> None:
        e = h.problem.experiments[recording]
        model, x = h.model, h.x
        device = model.acting(x)
        self.seen = model.seen(e, x)
        self.ready = prepared(self.seen.on(device), SEARCHING)
        self.observer, self.lead = h.noise.observer, lead
        self.begins, self.ends = max(0, first - lead), min(e.ticks, last + tail)
        own = np.zeros((e.ticks, 0)) if e.force is None else e.force
        self.forces = self.seen.external(self.ready.coarse.dof, own)
        self.memory, self.full = memory_at(self.ready, self.seen, device, self.observer.gain)
        self._run(slice(0, self.begins), self.seen.measured, self.forces, self.memory)
        self.unknown = self.white(None)

    def white(self, force: Floats | None, shift: Floats | None = None) -> Floats:
        """Return the whitened innovations under what acts on masses (window, masses).

        shift (window, o): what is taken off what was measured.
        """
        there = slice(self.begins, self.ends)
        forces, measured = self.forces, self.seen.measured
        if force is not None:  # beyond the masses: what the base does
            forces = forces.copy()
            forces[there, : force.shape[1]] += force
        if shift is not None:
            measured = measured.copy()
            measured[there] -= shift
        with np.errstate(all="ignore"):
            e = self._run(there, measured, forces, copied(self.memory))
        return np.nan_to_num(self.observer.weigh(e)[self.lead // 2 :], nan=1e6, posinf=1e6).ravel()

    def along(self, source: Source, size: Floats) -> Floats:
        """Return the same under so much (window,) of a source."""
        count = self.dof if source.sensor is None else len(self.seen.outputs)
        each = size[:, None] * source.row(count)
        return self.white(each) if source.sensor is None else self.white(None, each)

    def _run(self, part: slice, measured: Floats, forces: Floats, memory: object) -> Floats:
        return alone(
            self.ready.coarse, self.ready.fine, self.seen.places(self.ready.coarse),
            self.seen.command[part], np.ascontiguousarray(measured[part]), self.full,
            np.ascontiguousarray(forces[part]), memory,  # pyright: ignore[reportArgumentType]
        )  # fmt: skip

    @property
    def ticks(self) -> int:
        """How many it has."""
        return self.ends - self.begins

    @property
    def rows(self) -> int:
        """Samples of the window."""
        return self.ticks * len(self.seen.outputs)

    @property
    def dof(self) -> int:
        """Masses of the model."""
        return self.ready.coarse.dof


class _Tried(NamedTuple):
    """A description of an event that was fitted, and what it costs."""

    happened: Happened
    cost: float


def fitted_event(
    h: Hypothesis, recording: int, pulses: Sequence[Pulse], source: Source | None = None
) -> Happened:
    """Return an event of some pulses in a recording, as the cheapest description of it has it.

    h: judged on recordings that know of all others. source: where it enters, None for anywhere.
    """
    ticks, settled = h.experiments[recording].ticks, 60
    shapes = sorted({shape for pulse in pulses for shape in pulse.shapes()})
    shapes = [(t, v) for t, v in shapes if t >= settled and t + len(v) < ticks]
    first, last = min(t for t, _ in shapes), max(t + len(v) for t, v in shapes)
    basis = np.zeros((last - first, len(shapes)))
    for column, (t, values) in enumerate(shapes):
        basis[t - first : t - first + len(values), column] = values
    window = Window(h, recording, first, last)
    wide = inflation(h.residual[: h.samples])
    tried: list[_Tried] = []
    for there in [source] if source is not None else sources(h):
        one = Happened(recording, there, first, last, np.zeros(0), np.zeros(0), 0.0, (first, last))
        if there.lasting:
            tried += _slipped(window, one, wide)
        else:
            tried.append(_pushed(window, one, basis, len(pulses), wide))
    best = min(tried, key=lambda one: one.cost)
    own, odds = best.happened.source, 2.0 * math.log(1.0 / EVIDENCE.alpha)
    near = [t.happened.source for t in tried if t.cost < best.cost + odds]
    as_good = [s.place for s in near if s.place != own.place and s.lasting == own.lasting]
    return replace(best.happened, elsewhere=tuple(dict.fromkeys(as_good)), pulses=tuple(pulses))


def _pushed(window: Window, one: Happened, basis: Floats, pulses: int, wide: float) -> _Tried:
    """A force of a shape (ticks, k) from a tick on."""
    whole = np.zeros((window.ticks, basis.shape[1]))
    whole[one.first - window.begins : one.last - window.begins] = basis

    def white(f: Floats) -> Floats:
        return window.along(one.source, whole @ f)

    count = basis.shape[1]
    found = solved(white, window.unknown, units(white, window.unknown, count))
    covariance = wide * basis @ found.covariance @ basis.T
    gain = found.gained / wide - count
    happened = replace(one, force=basis @ found.f, covariance=covariance, gain=gain)
    # What a pulse is by itself is its time and size; the rest of its ticks fit noise as well.
    return _Tried(happened, found.chi2 / wide + count + 2.0 * pulses * math.log(window.rows))


def _slipped(window: Window, one: Happened, wide: float, about: int = 3) -> list[_Tried]:
    """What sets in at one tick for good; none where it could not be seen."""
    begins, last = window.begins, min(one.last, one.first + 32)
    ticks = range(
        max(begins + window.lead // 2, one.first - about), min(window.ends - 2, last + about)
    )
    if not ticks:
        return []
    after = np.arange(begins, window.ends)

    def white(f: Floats, at: int) -> Floats:
        return window.along(one.source, f[0] * (after >= at))

    r, unit = window.unknown, np.full(1, 1e-6)
    taken, each = np.zeros(len(ticks)), list[Floats]()
    for k, at in enumerate(ticks):
        unit = units(partial(white, at=at), r, 1, unit[0])
        slope = (white(unit, at) - r) / unit[0]
        taken[k] = float(slope @ r) ** 2 / max(float(slope @ slope), 1e-300)
        each.append(unit)
    fits: dict[int, Solved] = {}

    def chi2(k: int) -> float:
        if k not in fits:
            fits[k] = solved(partial(white, at=ticks[k]), r, each[k])
        return fits[k].chi2 / wide

    best = int(np.argmax(taken))
    for way in (1, -1):
        k = best
        while 0 <= k + way < len(ticks) and chi2(k + way) < chi2(best) + CHANGES.within:
            k += way
            best = k if chi2(k) < chi2(best) else best
    least, at, found = chi2(best), ticks[best], fits[best]
    near = [ticks[k] for k in fits if chi2(k) < least + CHANGES.within]
    happened = replace(
        one, first=at, last=at + 1, force=found.f, covariance=wide * found.covariance,
        gain=found.gained / wide, between=(min(near) - 1.0, float(max(near))),
    )  # fmt: skip
    return [_Tried(happened, least + 1.0 + 2.0 * math.log(window.rows))]


class Solved(NamedTuple):
    """f (k,) of the least squares, its covariance, the chi-square there and what it gained."""

    f: Floats
    covariance: Floats
    chi2: float
    gained: float


def solved(
    white: Callable[[Floats], Floats], unknown: Floats, unit: Floats, steps: int = 8
) -> Solved:
    """Return the least squares; unknown: the residual of no force; unit (k,): see `units`.

    Steps are as large as noise hides: what sticks under less moves under them. It ends where one
    gains less than 0.05 of chi-square; a force may be 30 times what was seen at first.
    """
    count, f, r = unit.size, np.zeros(unit.size), unknown
    start = least = float(r @ r)
    damping, size = 0.0, np.full(count, np.inf)
    slopes = np.zeros((r.size, count))
    for turn in range(steps):
        slopes = np.column_stack([(white(f + unit[j] * row) - r) / unit[j]
                                  for j, row in enumerate(np.eye(count))])  # fmt: skip
        if turn == 0:
            first = np.linalg.lstsq(slopes, -r, rcond=1e-6)[0]
            size = np.full(count, 30.0 * max(float(np.abs(first).max()), float(unit.max())))
        normal = slopes.T @ slopes + np.diag(1.0 / size**2)
        pull = slopes.T @ r + f / size**2
        while damping < 1e6:
            step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), pull)
            there = white(f + step)
            if float(there @ there) < least:
                break
            damping = max(1e-2, 10.0 * damping)
        else:
            break
        gained = least - float(there @ there)
        f, r, least, damping = f + step, there, float(there @ there), 0.1 * damping
        if gained < 0.05:
            break
    covariance = np.asarray(np.linalg.inv(slopes.T @ slopes + np.diag(1.0 / size**2)), np.float64)
    return Solved(f, covariance, least, start - least)


def units(
    white: Callable[[Floats], Floats], unknown: Floats, count: int, start: float = 1e-6
) -> Floats:
    """Return by how much each number (count,) moves the residual by about one.

    start: from where on that is sought.
    """
    found = np.zeros(count)
    unit = start
    for j, row in enumerate(np.eye(count)):
        for _ in range(3):
            moved = float(np.linalg.norm(white(unit * row) - unknown))
            if moved > 0.0:
                factor = min(1e6, max(1e-6, 1.0 / moved))
                unit *= factor
                if 0.1 < factor < 10.0:
                    break
            else:
                unit *= 1e3
        found[j] = unit
    return found

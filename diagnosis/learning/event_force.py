"""The force of an event, tick by tick with its uncertainty, fitted through the simulation.

An event is a force f(t) = sum_j f_j phi_j(t), with phi_j one tick each for a short event, and hats
for a long one. The kernel simulates the window around it from the observer's state, so that
friction, play and limits act as under that force. Damped steps of Gauss and Newton minimise

    |r(f)|^2 + |f / size|^2,

where r are the whitened innovations of the window and `size` is far larger than the fitted force,
so that the result is defined while a mass sticks (when forces have no effect). A slip is one number
instead, added to a reading or to the force in a spring from its tick on. Of several places and
kinds, the best minimises |r|^2 plus the penalty for its numbers plus 2 ln(rows) for the time and
size of each of its pulses.

The tick of a slip is sought to first order: with s the slope of r by the number and r0 without it,
|r0|^2 - (s'r0)^2 / s's. A fit is made at the tick of least value, and at its neighbours as long as
they fit equally well or better. Limit: if two ticks fit equally well, with worse ones between them,
the one that is better to first order is chosen.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.uncertainty import inflation
from zwidth.diagnosis.noise.predictor import (
    SEARCHING,
    memory_at,
    prepared,
)
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.hypothesis import Hypothesis
from zwidth.diagnosis.settings import EVIDENCE
from zwidth.sim.place import masses_and_links, place_at
from zwidth.sim.predict import Memory, alone, copied

Floats = NDArray[np.float64]
LEAD, TAIL = 60, 150  # ticks before and after an event that its fit includes
POINT = 32  # first ticks of an event, within which a slip is sought
STEPS, WORTH = 8, 0.05  # steps of Gauss and Newton; chi-square that a step must gain
FAR = 30.0  # deviation of forces, over the largest that a first step finds
SHORT, MARGIN = 6, 2  # longest pulse with a force for each tick, and further ticks beside it
HATS = 6  # over a longer pulse
ABOUT = 3  # ticks about its peak, in which a slip is dated


class Pulse(NamedTuple):
    """The first tick of a force in a recording, and its length."""

    first: int
    ticks: int

    @property
    def shapes(self) -> list[tuple[int, tuple[float, ...]]]:
        """First tick and values of each phi."""
        if self.ticks <= SHORT:
            ends = self.first - MARGIN, self.first + self.ticks + MARGIN
            return [(t, (1.0,)) for t in range(*ends)]
        wide = max(1, self.ticks // HATS)
        hat = tuple((1.0 - np.abs(np.arange(1 - wide, wide)) / wide).tolist())
        middles = range(self.first - wide, self.first + self.ticks + wide + 1, wide)
        return [(m + 1 - wide, hat) for m in middles]


@dataclass(frozen=True)
class Source:
    """The place of an event: mass, link or output (its index is `sensor`); lasting: permanent."""

    place: str
    sensor: int | None = None
    lasting: bool = False


@dataclass(frozen=True)
class Happened:
    """One event, in ticks of one of the recordings.

    first, last: the ticks of the event. force (last - first,) at each tick, [N m | N], or the one
    amount of a permanent event (of a reading [rad | m]); covariance: of force. gain: chi-square.
    between: for a permanent event, the earliest and latest tick at which it may have happened.
    elsewhere: other places that explain it equally well. pulses: the pulses that were fitted.
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
    pulses: tuple["Pulse", ...] = ()

    def on(self, e: Experiment) -> Experiment:
        """Return a recording that includes the event's force, or without its slip."""
        if (o := self.source.sensor) is not None:
            measured = e.measured.copy()
            measured[self.first :, o] -= self.force[0]
            return replace(e, measured=measured)
        place = place_at(self.source.place)
        force = np.zeros((e.ticks, 1 + max(place.ends)))
        end = e.ticks if self.source.lasting else self.last
        force[self.first : end] = self.force[:, None] * place.row(force.shape[1])
        return e.pushed_by(force)


@dataclass(frozen=True)
class _Tried:
    """A fitted description of an event, and its cost."""

    happened: Happened
    cost: float


class Window:
    """A recording around an event, from the observer's state before it."""

    def __init__(self, h: Hypothesis, recording: int, first: int, last: int) -> None:
        e = h.problem.experiments[recording]
        model, x = h.model, h.x
        device = model.acting(x)
        self.seen = model.seen(e, x)
        self.ready = prepared(self.seen.on(device), SEARCHING)
        self.observer, self.masses = h.noise.observer, model.nominal.chain.masses.size
        self.begins, self.ends = max(0, first - LEAD), min(e.ticks, last + TAIL)
        self.places = self.seen.places(self.ready.coarse)
        own = np.zeros((e.ticks, 0)) if e.force is None else e.force
        self.forces = self.seen.external(self.ready.coarse.dof, own)
        self.memory, self.full = memory_at(self.ready, self.seen, device, self.observer.gain)
        before = slice(0, self.begins)
        self._through(before, self.seen.readings[before], self.forces[before], self.memory)
        self.unknown = self.white(None, np.zeros(0))

    def white(self, force: Floats | None, row: Floats, shift: Floats | None = None) -> Floats:
        """Return whitened innovations under a force (window,) along a row.

        shift (window, o): subtracted from the measurement.
        """
        there = slice(self.begins, self.ends)
        forces = self.forces[there]
        if force is not None:
            forces = forces.copy()  # columns beyond the masses: motion of the base
            forces[:, : row.size] += force[:, None] * row
        measured = self.seen.readings[there]
        gone = None if self.seen.uncounted is None else self.seen.uncounted[there]
        if shift is not None:
            measured = measured - shift
        with np.errstate(all="ignore"):
            e = self._through(there, measured, forces, copied(self.memory))
        if gone is not None:
            e[gone] = 0.0
        white = self.observer.weigh(e, gone)[LEAD // 2 :]
        return np.nan_to_num(white, nan=1e6, posinf=1e6).ravel()

    def _through(self, part: slice, measured: Floats, forces: Floats, memory: Memory) -> Floats:
        return alone(
            self.ready.coarse, self.ready.fine, self.places, self.seen.command[part], measured,
            self.full, forces, memory, self.seen.strengths_in(part),
        )  # fmt: skip

    @property
    def rows(self) -> int:
        """Number of samples of the window."""
        return (self.ends - self.begins) * len(self.seen.outputs)

    @property
    def dof(self) -> int:
        """Number of masses of the model."""
        return self.ready.coarse.dof


def fitted_event(
    h: Hypothesis, recording: int, pulses: Sequence[Pulse], source: Source | None = None
) -> Happened:
    """Return the cheapest description of an event of some pulses in a recording.

    h: fitted with all other events known. source: the place of the event, None for any.
    """
    ticks = h.experiments[recording].ticks
    shapes = sorted({shape for pulse in pulses for shape in pulse.shapes})
    shapes = [(t, v) for t, v in shapes if t >= LEAD and t + len(v) < ticks]
    first, last = min(t for t, _ in shapes), max(t + len(v) for t, v in shapes)
    basis = np.zeros((last - first, len(shapes)))
    for column, (t, values) in enumerate(shapes):
        basis[t - first : t - first + len(values), column] = values
    window = Window(h, recording, first, last)
    wide = inflation(h.residual[: h.samples])
    tried: list[_Tried] = []
    for there in [source] if source is not None else _sources(window, h):
        if there.lasting:
            slip = _slip(window, recording, first, min(last, first + POINT), there, wide)
            tried += [] if slip is None else [slip]
        else:
            tried.append(_force(window, recording, first, basis, len(pulses), there, wide))
    best = min(tried, key=lambda one: one.cost)
    as_good = [
        t.happened.source.place
        for t in tried
        if t.cost < best.cost + EVIDENCE.as_well
        and t.happened.source.place != best.happened.source.place
        and t.happened.source.lasting == best.happened.source.lasting
    ]
    elsewhere = tuple(dict.fromkeys(as_good))
    return replace(best.happened, elsewhere=elsewhere, pulses=tuple(pulses))


def _sources(window: Window, h: Hypothesis) -> Iterator[Source]:
    """Possible sources: a force at every mass and link, a slip of every position and spring."""
    places = masses_and_links(window.masses)
    for place in places:
        yield Source(str(place))
    for i, o in enumerate(window.seen.outputs):
        if o.quantity == "position":
            yield Source(o.name, sensor=i, lasting=True)
    tied = h.model.build(h.x).chain.ground_spring > 0.0
    for place in places:
        if place.kind == "link" or (place.index == 0 and tied):
            yield Source(str(place), lasting=True)


def _force(
    window: Window,
    recording: int,
    first: int,
    basis: Floats,
    pulses: int,
    source: Source,
    wide: float,
) -> _Tried:
    """Fit a force with a basis (ticks, k) from a tick on."""
    whole = np.zeros((window.ends - window.begins, basis.shape[1]))
    last = first + basis.shape[0]
    whole[first - window.begins : last - window.begins] = basis
    count, row = basis.shape[1], place_at(source.place).row(window.dof)

    def white(f: Floats) -> Floats:
        return window.white(whole @ f, row)

    found = solved(white, window.unknown, np.full(count, 1e-6))
    happened = Happened(
        recording, source, first, last, basis @ found.f, wide * basis @ found.covariance @ basis.T,
        found.gained / wide - count, (first, last),
    )  # fmt: skip
    # ln(rows) for the time and size of each pulse; its other ticks may only fit noise.
    cost = found.chi2 / wide + count + 2.0 * pulses * math.log(window.rows)
    return _Tried(happened, cost)


def _slip(
    window: Window, recording: int, first: int, last: int, source: Source, wide: float
) -> _Tried | None:
    """Fit a permanent event from one tick on; None if the window has no such tick."""
    begins, outputs = window.begins, len(window.seen.outputs)
    ticks = range(max(begins + LEAD // 2, first - ABOUT), min(window.ends - 2, last + ABOUT))
    if not ticks:
        return None
    after = np.arange(begins, window.ends)
    row = np.eye(outputs)[source.sensor] if source.sensor is not None else place_at(
        source.place).row(window.dof)  # fmt: skip

    def white(f: Floats, at: int) -> Floats:
        size = f[0] * (after >= at).astype(np.float64)
        if source.sensor is None:
            return window.white(size, row)
        return window.white(None, row, size[:, None] * row)

    r, unit = window.unknown, 1e-6
    taken, each = np.zeros(len(ticks)), list[Floats]()
    for k, at in enumerate(ticks):
        unit, slope = slope_of(lambda f, at=at: white(np.array([f]), at), r, unit)
        taken[k] = float(slope @ r) ** 2 / max(float(slope @ slope), 1e-300)
        each.append(np.full(1, unit))
    fits: dict[int, Solved] = {}

    def chi2(k: int) -> float:
        if k not in fits:
            fits[k] = solved(partial(white, at=ticks[k]), r, each[k])
        return fits[k].chi2 / wide

    best = int(np.argmax(taken))
    for way in (1, -1):
        k = best
        while 0 <= k + way < len(ticks) and chi2(k + way) < chi2(best) + EVIDENCE.told:
            k += way
            best = k if chi2(k) < chi2(best) else best
    least, at, found = chi2(best), ticks[best], fits[best]
    near = [ticks[k] for k in fits if chi2(k) < least + EVIDENCE.told]
    happened = Happened(
        recording, source, at, at + 1, found.f, wide * found.covariance, found.gained / wide,
        (min(near) - 1.0, float(max(near))),
    )  # fmt: skip
    return _Tried(happened, least + 1.0 + 2.0 * math.log(window.rows))


class Solved(NamedTuple):
    """The least-squares f (k,), its covariance, and the chi-square there and its gain."""

    f: Floats
    covariance: Floats
    chi2: float
    gained: float


def solved(white: Callable[[Floats], Floats], unknown: Floats, unit: Floats) -> Solved:
    """Return the least-squares force; unknown: the residual without it; unit: see `slope_of`."""
    count, f, r = unit.size, np.zeros(unit.size), unknown
    start = least = float(r @ r)
    damping, unit = 0.0, unit.copy()
    size = np.full(count, np.inf)
    slopes = np.zeros((r.size, count))
    for _ in range(STEPS):
        for j, row in enumerate(np.eye(count)):
            begin = unit[j - 1] if j and not np.all(np.isfinite(size)) else unit[j]
            unit[j], slopes[:, j] = slope_of(lambda d, f=f, e=row: white(f + d * e), r, begin)
        if not np.all(np.isfinite(size)):
            first = np.linalg.lstsq(slopes, -r, rcond=1e-6)[0]
            seen = max(float(np.abs(f + first).max()), float(unit.max()))
            size = np.full(count, FAR * seen)
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
        if gained < WORTH:
            break
    covariance = np.asarray(np.linalg.inv(slopes.T @ slopes + np.diag(1.0 / size**2)), np.float64)
    return Solved(f, covariance, least, start - least)


def slope_of(
    moved: Callable[[float], Floats], unknown: Floats, unit: float = 1e-6
) -> tuple[float, Floats]:
    """Return the step of a number that changes the residual by about one, and its slope there.

    unit: the first step that is tried. The step is as large as noise can hide: a mass that sticks
    under a smaller one moves under it.
    """
    change = moved(unit) - unknown
    for _ in range(3):
        size = float(np.linalg.norm(change))
        factor = min(1e6, max(1e-6, 1.0 / size)) if size > 0.0 else 1e3
        if 0.1 < factor < 10.0:
            break
        unit *= factor
        change = moved(unit) - unknown
    return unit, change / unit

"""The initial state of an observer at the first sample of a recording.

An observer that trusts its model forgets a wrong initial state slowly, and the innovations until
then look like physics. These are nearly linear in the initial state, e = e_0 + C x_0, which is
found by least squares over the first `BEGINNING` ticks, with C from differences of the device
without nonsmooth physics. (C of its linear part alone is wrong if damping grows with speed:
starting from rest with a drag, it left 75 in -2 ln likelihood in the first 0.2 s, which Stribeck
friction then explained.) With nonsmooth physics, commonly dry friction, C is only approximate,
since a mass that sticks forgets a speed at once. So the best of one step, two steps, no step and
rest is used. For motors with friction that start at rest, one step cost 77 to 560 more than rest,
and a nonexistent resonance explained the excess. If they start in motion, two steps come within 140
of the best known state, and one within 400.

Play makes innovations more nonlinear: a mass behind it starts on one side or the other, or between
them, and moves when it is hit. So for a device with play, steps of Gauss and Newton start at that
state, and at states with the parts behind the play placed across the gap.

Such motion is chaotic. Two masses with play and friction in positions at 500 Hz, simulated freely
from their true state with another number of substeps, differ by 10 mrad within two seconds. With
true parameters, from each of ten samples as the start, this lowers -2 ln likelihood by 0 to 450
with the most likely noise if only the motor is measured, and by 1100 to 6700 over 50 ms. On the
friction damper, fits that alternate between parameters and a linear initial state ended about 90
higher.

Limits: the state is a least-squares estimate from noisy readings, in one valley for each start.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from zwidth.diagnosis.noise.gaps import Gain, along
from zwidth.diagnosis.noise.predictor import (
    BEGINNING,
    SEARCHING,
    Observer,
    first_motion,
    observer_memories,
    padded,
    substeps_of,
)
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.jobs.parallel import in_parallel, threads
from zwidth.sim.device import Device
from zwidth.sim.members import alike
from zwidth.sim.physics.backlash import backlash
from zwidth.sim.physics.effect import Physics
from zwidth.sim.population import Population, Readings, Recorded

Floats = NDArray[np.float64]
# Most steps of Gauss and Newton. At nine beginnings of the rig above, twice as many
# gained nothing at five, and 12 to 560 in -2 ln at four. Of nine beginnings of two masses with
# play (`tests/test_noise_beginning.py`, from 300 to 700) one stays at the linear answer, on the
# wrong side.
TURNS = 6
NEGLIGIBLE = 1e-6  # of the largest singular value: smaller directions are ignored
STEPS = 2  # with creases, by approximate slopes: a third gained nothing
NEARLY = 1e-3  # relative tolerance of the sum of squares, of x and of the slope
# Starts of parts behind play: positions across the gap, and relative speeds in usual speeds.
ACROSS, FASTER = np.linspace(-0.5, 0.5, 9).tolist(), np.linspace(-2.0, 2.0, 9).tolist()
# The best of these, from which steps begin: at ten beginnings over 50 ms, the grid with two gained
# 35 300 in -2 ln over the linear answer, one of 5 by 5 with one 27 100 and with three 28 500.
FROM_ASIDE = 2
RAN_AWAY = 1e3  # deviations that stand for an overflow


def _population(device: Device, count: int) -> Population:
    few, many = substeps_of(device, SEARCHING)
    return Population(alike(device, count), few, many)


class Beginnings:
    """Initial states of observers of several gains for one device."""

    def __init__(self, device: Device, gains: Sequence[Gain]) -> None:
        self.device, self.gains, self.dof = device, gains, device.chain.masses.size
        self.smooth = smooth(device)
        count, states = len(gains), 2 * self.dof
        self.own = _population(device, count)
        self.still = self.own if self.smooth is device else _population(self.smooth, count)
        self.units = _population(self.smooth, states * count)

    def followed(self, experiment: Experiment, starts: Floats) -> Floats:
        """Return innovations (gains, ticks, o) from an initial state (2n) each."""
        return innovations_each(self.own, experiment, self.device, starts, self.gains)

    def of(self, experiment: Experiment) -> Floats:
        """Return initial states (gains, 2n), which add to the first positions and velocities."""
        first = replace(experiment.part(0, min(BEGINNING, experiment.ticks)), start=None)
        begins = np.zeros((len(self.gains), 2 * self.dof))
        errors = self.followed(first, begins)
        with np.errstate(all="ignore"):  # infinite after an overflow
            scale = np.std(errors, axis=1)
        slopes, units = self._slopes(first, errors, scale)
        if self.smooth is self.device:
            return self._step(begins, errors, slopes, units, scale)
        rest = begins.copy()
        rest[:, self.dof :] = -first_motion(first.outputs, first.measured, first.period)[1]
        tried = [(begins, errors), (rest, self.followed(first, rest))]
        for _ in range(STEPS):
            begins = self._step(begins, errors, slopes, units, scale)
            errors = self.followed(first, begins)
            tried.append((begins, errors))
        with np.errstate(all="ignore"):
            squares = [np.sum((e / scale[:, None]) ** 2, axis=(1, 2)) for _, e in tried]
        best = np.argmin(np.nan_to_num(np.array(squares), nan=np.inf), axis=0)
        return np.array([tried[k][0][i] for i, k in enumerate(best)])

    def _slopes(self, first: Experiment, own: Floats, scale: Floats) -> tuple[Floats, Floats]:
        """Weighted slopes (gains, 2n, ticks o) by units of an initial state; units (gains, 2n)."""
        count, states = len(self.gains), 2 * self.dof
        units = np.repeat([1.0, 1.0 / first.period], self.dof) * scale[:, :1]
        starts = (units[:, :, None] * np.eye(states)).reshape(count * states, states)
        repeated = [gain for gain in self.gains for _ in range(states)]
        if self.smooth is not self.device:
            nothing = np.zeros((count, states))
            own = innovations_each(self.still, first, self.smooth, nothing, self.gains)
        moved = innovations_each(self.units, first, self.smooth, starts, repeated)
        with np.errstate(all="ignore"):
            slopes = (moved.reshape(count, states, *own.shape[1:]) - own[:, None]) / scale[
                :, None, None
            ]
        return slopes.reshape(count, states, -1), units

    def _step(
        self, begins: Floats, errors: Floats, slopes: Floats, units: Floats, scale: Floats
    ) -> Floats:
        """A step of Gauss and Newton; no step if slopes or errors are not finite."""
        found = begins.copy()
        with np.errstate(all="ignore"):
            left = (errors / scale[:, None]).reshape(errors.shape[0], -1)
        for i, (matrix, row) in enumerate(zip(slopes, left, strict=True)):
            if np.all(np.isfinite(matrix)) and np.all(np.isfinite(row)):
                solved, *_ = np.linalg.lstsq(matrix.T, -row, rcond=NEGLIGIBLE)
                found[i] += units[i] * solved
        return found


def begun_as(e: Experiment, other: Experiment) -> Experiment:
    """Return a recording with initial state and motions of another version, without a search."""
    e = replace(e, motions=other.motions)
    if e.before is None or other.before is None:
        return replace(e, start=other.start)
    return replace(e, before=begun_as(e.before, other.before))


def with_play(physics: Iterable[Physics]) -> bool:
    """Whether fits with these effects end in the valley where they begin, as with play."""
    return any(q.valleys for p in physics for q in p.effect.parameters)


def smooth(device: Device) -> Device:
    """Return the device whose differences show how innovations depend on the initial state.

    It has no nonsmooth physics, since differences over a crease are misleading. While dry friction
    holds a mass, speeds have no effect, and least squares would give a huge one.
    """
    kept = tuple(p for p in device.physics if not p.effect.creased)
    return device if len(kept) == len(device.physics) else replace(device, physics=kept)


def by_own_slopes(
    device: Device, experiment: Experiment, observer: Observer, linear: Floats
) -> Floats:
    """Return the initial state (2n,) of a device with play, or `linear` if this is no worse."""
    here = experiment.on(device)
    if not with_play(here.physics):
        return linear
    few, many = substeps_of(here, SEARCHING)

    @cache
    def members(count: int) -> Population:
        return Population(alike(here, count), few, many)

    def weighed(starts: Floats, ticks: int = BEGINNING // 4) -> Floats:
        gains = [observer.gain] * len(starts)
        first = replace(experiment.part(0, min(ticks, experiment.ticks)), start=None)
        errors = innovations_each(members(len(starts)), first, here, starts, gains)
        with np.errstate(all="ignore"):  # infinite after an overflow
            white = observer.weigh(errors).reshape(len(starts), -1)
        return np.clip(np.nan_to_num(white, nan=RAN_AWAY), -RAN_AWAY, RAN_AWAY)

    units = _units(experiment, observer, linear.size // 2)
    near = np.stack([linear, np.zeros(linear.size)])
    at = _least(weighed, near)
    usual = float(np.std(np.diff(experiment.measured[:BEGINNING, 0]))) / experiment.period
    aside = np.concatenate([_aside(here, begin, usual) for begin in near])
    best = np.argsort(np.sum(weighed(aside) ** 2, axis=1))[:FROM_ASIDE]
    found = _least(
        weighed, np.stack([_nearest(weighed, begin, units) for begin in (at, *aside[best])])
    )
    costs = np.sum(weighed(np.stack([linear, found]), BEGINNING) ** 2, axis=1)
    return found if costs[1] < costs[0] else linear


def _least(weighed: Callable[[Floats], Floats], begins: Floats) -> Floats:
    return begins[int(np.argmin(np.sum(weighed(begins) ** 2, axis=1)))]


def _aside(device: Device, begin: Floats, usual: float) -> Floats:
    """Initial states with parts behind play across the gap, at several relative speeds."""
    n, found = begin.size // 2, []
    for physics in device.physics:
        if physics.effect is not backlash:
            continue
        link = physics.place.index
        for side, faster in product(ACROSS, FASTER):
            moved = begin.copy()
            moved[link + 1 : n] = begin[link] + side * physics.values["gap"]
            moved[n + link + 1 :] = begin[n + link] + faster * usual
            found.append(moved)
    return np.array(found)


def _nearest(weighed: Callable[[Floats], Floats], begin: Floats, units: Floats) -> Floats:
    """The result of steps of Gauss and Newton, with wide two-sided slopes because of creases."""
    sides = np.concatenate([np.eye(begin.size), -np.eye(begin.size)])

    def own(u: Floats) -> Floats:
        return weighed((begin + units * u)[None])[0]

    def slopes(u: Floats) -> Floats:
        beside = weighed(begin + units * (u + sides))
        return 0.5 * (beside[: begin.size] - beside[begin.size :]).T

    found = least_squares(
        own, np.zeros(begin.size), slopes, max_nfev=TURNS, x_scale="jac",
        ftol=NEARLY, xtol=NEARLY, gtol=NEARLY,
    )  # fmt: skip
    return begin + units * found.x


def _units(experiment: Experiment, observer: Observer, masses: int) -> Floats:
    """The noise of the measurement as positions, and as velocities that cover it in a tick."""
    return np.repeat([1.0, 1.0 / experiment.period], masses) * float(observer.deviation[0])


def innovations_each(
    population: Population,
    experiment: Experiment,
    device: Device,
    starts: Floats,
    gains: Sequence[Gain],
) -> Floats:
    """Return innovations (members, ticks, o), each with its initial state (2n) and gain.

    Infinite after an overflow. population: one copy of the device for each member.
    """
    dof, period = population.dof, device.interface.period
    force = experiment.external(dof)
    wide, columns = along(gains, experiment.bridged, experiment.motions)
    recorded = Recorded(
        experiment.command, experiment.readings, experiment.places(population), force,
        strengths=experiment.strengths, uncounted=experiment.uncounted, columns=columns,
    )  # fmt: skip
    motion = np.array(first_motion(experiment.outputs, experiment.measured, period))
    motions = np.tile(motion, (population.size, 1))
    memories = observer_memories(population, motions, starts, experiment.begins)
    readings = Readings(np.stack([padded(g, device, population, experiment) for g in wide]))
    with np.errstate(all="ignore"):  # infinite after an overflow
        found = population.follow(
            recorded, memories, readings, keep=True,
            run_all=lambda tasks: in_parallel(tasks, threads()),
        ).innovations  # fmt: skip
    if experiment.uncounted is not None:
        found[:, experiment.uncounted] = 0.0
    return found

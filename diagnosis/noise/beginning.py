"""Where an observer begins: the state at the first sample of a recording.

An observer that trusts its model forgets a wrong beginning slowly, and the innovations until then
look like physics. They are nearly linear in the beginning: e = e_0 + C x_0, solved for x_0 by least
squares over the first `BEGINNING` ticks, C by differences of the device without what has creases.
(Of its linear part alone C is wrong where damping grows with speed: from rest under a drag that
left 75 in -2 ln likelihood in the first 0.2 s, which Stribeck friction bought.) Friction bends the
answer little. Play does: a mass behind it begins on one side or the other, or between, and moves
when it is met. So of a device with play Gauss and Newton's steps begin at that answer, and with
each mass moved aside.

Seen on two masses with play and friction in positions at 500 Hz, at the truth: -2 ln likelihood is
less by 3 to 310 under the likeliest noise where the motor alone is measured, by 380 to 4500 over 50
ms; friction alone 0 to 40 (to 390 where it yields before it slides). On the friction damper fits
that alternate between parameters and a linear beginning ended about 90 above where they end so.

Limits: a least-squares answer of noisy readings, one valley of it for each of the beginnings tried.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from zwidth.diagnosis.noise.predictor import (
    BEGINNING,
    SEARCHING,
    Observer,
    first_motion,
    innovations,
    observer_memories,
    padded,
    prepared,
    substeps_of,
)
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.jobs.parallel import in_parallel, threads
from zwidth.sim.device import Device
from zwidth.sim.members import alike
from zwidth.sim.physics.effect import Physics
from zwidth.sim.population import Population, Readings, Recorded

Floats = NDArray[np.float64]
# Of Gauss and Newton at most, for what they cost: at nine beginnings of the rig above twice as many
# gained nothing at five, and 12 to 560 in -2 ln at four.
TURNS = 6
NEARLY = 1e-3  # of the sum of squares, of x and of the slope, that is worth no further turn
# Deviations, by which each mass is moved: not derived. Play wider than 128 of them has its sides
# beyond; half of its gap would be what it says itself.
ASIDE = (1.0, 4.0, 16.0, 64.0)
RAN_AWAY = 1e3  # deviations that stand for an overflow


def begun(device: Device, experiment: Experiment, observer: Observer) -> Experiment:
    """Return the recording with the state that the observer should begin with."""
    if experiment.before is not None:
        return replace(experiment, before=begun(device, experiment.before, observer))
    first = replace(experiment.part(0, min(BEGINNING, experiment.ticks)), start=None)
    own = innovations(device, first, observer.gain).ravel()
    if not (np.all(np.isfinite(own)) and np.all(np.isfinite(observer.deviation))):
        return replace(experiment, start=None)
    own = (own.reshape(first.measured.shape) / observer.deviation).ravel()
    linear = smooth(device)
    ready = prepared(experiment.on(linear))
    dof = device.chain.masses.size
    still = innovations(linear, first, observer.gain, ready=ready)
    columns: list[Floats] = []
    scale = _units(experiment, observer, dof)
    for i in range(2 * dof):
        unit = np.zeros(2 * dof)
        unit[i] = scale[i]
        moved = innovations(linear, replace(first, start=unit), observer.gain, ready=ready)
        columns.append(((moved - still) / observer.deviation).ravel())
    matrix = np.column_stack(columns)
    if not np.all(np.isfinite(matrix)):
        return replace(experiment, start=None)
    solved, *_ = np.linalg.lstsq(matrix, -own, rcond=1e-6)
    return replace(experiment, start=by_own_slopes(device, experiment, observer, scale * solved))


def begun_as(e: Experiment, other: Experiment) -> Experiment:
    """Return a recording that begins as the same one does elsewhere: no second search for it."""
    if e.before is None or other.before is None:
        return replace(e, start=other.start)
    return replace(e, before=begun_as(e.before, other.before))


def with_play(physics: Iterable[Physics]) -> bool:
    """Whether there is play among it, or what else keeps a fit in the valley where it began."""
    return any(q.valleys for p in physics for q in p.effect.parameters)


def smooth(device: Device) -> Device:
    """Return the device whose differences say how its innovations turn on its beginning.

    Without what has creases: differences over a crease lead nowhere. Under dry friction that holds
    no speed shows, and least squares would begin with a huge one.
    """
    kept = tuple(p for p in device.physics if not p.effect.creased)
    return device if len(kept) == len(device.physics) else replace(device, physics=kept)


def by_own_slopes(
    device: Device, experiment: Experiment, observer: Observer, linear: Floats
) -> Floats:
    """Return the state (2n,) that a device with play begins with, or `linear` where none is better.

    linear: that of one step of Gauss and Newton, which devices without play begin with.
    """
    here = experiment.on(device)
    if not with_play(here.physics):
        return linear
    first = replace(experiment.part(0, min(BEGINNING, experiment.ticks)), start=None)
    few, many = substeps_of(here, SEARCHING)

    @cache
    def members(count: int) -> Population:
        return Population(alike(here, count), few, many)

    def weighed(starts: Floats) -> Floats:
        gains = np.broadcast_to(observer.gain, (len(starts), *observer.gain.shape))
        errors = innovations_each(members(len(starts)), first, here, starts, gains)
        with np.errstate(all="ignore"):  # infinite after an overflow
            white = observer.weigh(errors).reshape(len(starts), -1)
        return np.clip(np.nan_to_num(white, nan=RAN_AWAY), -RAN_AWAY, RAN_AWAY)

    units = _units(experiment, observer, linear.size // 2)
    at = _least(weighed, np.stack([linear, np.zeros(linear.size)]))
    aside = _least(weighed, at + units * _aside(linear.size))
    found = _least(weighed, np.stack([_nearest(weighed, begin, units) for begin in (at, aside)]))
    costs = np.sum(weighed(np.stack([linear, found])) ** 2, axis=1)
    return found if costs[1] < costs[0] else linear


def _least(weighed: Callable[[Floats], Floats], begins: Floats) -> Floats:
    return begins[int(np.argmin(np.sum(weighed(begins) ** 2, axis=1)))]


def _aside(states: int) -> Floats:
    """Each mass moved to both sides, by more and more."""
    sides = np.eye(states)[: states // 2]
    return np.concatenate([far * sides for far in (*ASIDE, *(-a for a in ASIDE))])


def _nearest(weighed: Callable[[Floats], Floats], begin: Floats, units: Floats) -> Floats:
    """Gauss and Newton's answer, its slopes over a unit to both sides: wide beside a crease."""
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
    """A deviation of what is measured, as positions and as velocities that reach it in a tick."""
    return np.repeat([1.0, 1.0 / experiment.period], masses) * float(observer.deviation[0])


def innovations_each(
    population: Population, experiment: Experiment, device: Device, starts: Floats, gains: Floats
) -> Floats:
    """Return innovations (members, ticks, o) from a beginning (2n) and under a gain each.

    Infinite from where one overflows. population: the device as often as there are members.
    """
    dof, period = population.dof, device.interface.period
    force = experiment.external(dof)
    recorded = Recorded(
        experiment.command, experiment.measured, experiment.places(population), force,
        strengths=experiment.strengths,
    )  # fmt: skip
    motion = np.array(first_motion(experiment.outputs, experiment.measured, period))
    motions = np.tile(motion, (population.size, 1))
    memories = observer_memories(population, motions, starts, experiment.begins)
    readings = Readings(np.stack([padded(g, device, population, experiment) for g in gains]))
    with np.errstate(all="ignore"):  # infinite after an overflow
        return population.follow(
            recorded, memories, readings, keep=True,
            run_all=lambda tasks: in_parallel(tasks, threads()),
        ).innovations  # fmt: skip

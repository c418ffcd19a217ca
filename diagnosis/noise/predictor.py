"""Innovations of a device on an experiment with a fixed observer, and its free runs.

The gain comes from a noise model of two numbers, the process force at m1 per tick and the noise of
the measurement, on the linear part of the device (`noise.steady`). Only their ratio matters for the
gain. The ratio is chosen by likelihood (`noise.family`) and fixed inside a fit, which would
otherwise change the noise in place of the parameters.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.noise.gaps import Changing, Gain, along, changing, covariance_after, steadily
from zwidth.diagnosis.noise.steady import NoObserver, settles, steady
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.jobs.parallel import in_parallel, threads
from zwidth.sim.device import Device
from zwidth.sim.equations import Equations, enough_substeps, equations
from zwidth.sim.extended import Filter, Uncertain, driven_along, motions_along
from zwidth.sim.filters import filtered
from zwidth.sim.kernel import Memory
from zwidth.sim.physics.effect import Physics
from zwidth.sim.population import Population, Readings, Recorded
from zwidth.sim.predict import GROUND, Gains, Outputs, alone, freely
from zwidth.sim.run import Start, start_memory

Floats = NDArray[np.float64]
ORDER = 24  # largest order of the filters that whiten
SPARED = 100  # least number of samples for each coefficient
MEMORY = 24.0  # lags over which they account for correlation
SETTLING = 100  # ticks left out at the start, until the observer has found the state
# Weights of the first samples in the slope, at the first, of the parabola through them.
SLOPE = np.linalg.pinv(np.vander(np.arange(10.0), 3, increasing=True))[1]
MOST_SUBSTEPS = 256  # per tick: friction beside a mode of 100 kHz at 1 kHz
FREE_RUN_S = 0.5
SHORTEST_WINDOW = 50  # ticks of a free run


@dataclass(frozen=True)
class Observer:
    """Gain (states, o), or one that accounts for gaps, and deviations (o,) of its innovations.

    ratio: process force variance per tick, over measurement variance, in units of (noise unit per
    force step of the rigid body), as in `observer_for`. whitening: W (o, o, order + 1), for which
    sum_k W_k e_(t-k) is white, of unit variance, and uncorrelated between outputs; None for none.
    deviation: of the part that the past of all outputs does not predict. counts: as how many
    independent samples each sample counts if the innovations stay coloured (`family.as_far_as`);
    deviation is then divided by the root of `counts`, so that all weighted innovations count less.
    told: share of the samples that count; the others are bridged or come after a gap, and have no
    weight.
    """

    gain: Gain
    deviation: Floats
    ratio: float
    whitening: Floats | None = None
    counts: float = 1.0
    told: float = 1.0

    def weigh(self, innovations: Floats, uncounted: NDArray[np.bool_] | None = None) -> Floats:
        """Return whitened innovations (..., ticks, o) in units of deviation, 0 if `uncounted`."""
        if self.whitening is None:
            return innovations / self.deviation
        white = filtered(innovations, self.whitening)
        if uncounted is not None:
            white[..., uncounted, :] = 0.0
        return white

    def cost(self, white: Floats) -> float:
        """Return -2 log likelihood of weighted innovations (samples,), up to a constant.

        Minimised over the covariance: n (ln det S_0 + ln det S) `counts` times, where `weigh`
        divides by S_0, S is the covariance of its result, and n is the number of samples that
        count.
        """
        rows = white.reshape(-1, self.deviation.size)
        return float(self.cost_of((rows.T @ rows)[None], rows.shape[0])[0])

    def cost_of(self, moments: Floats, rows: int) -> Floats:
        """Return `cost` from sums of w w' (members, o, o) over rows of weighted innovations w."""
        if self.whitening is None:
            divided = 2.0 * float(np.sum(np.log(self.deviation)))
        else:
            divided = -2.0 * float(np.linalg.slogdet(self.whitening[:, :, 0])[1])
        known = self.told * rows
        return self.counts * known * (divided + np.linalg.slogdet(moments / known)[1])

    def filters(self) -> Floats:
        """Return the operation of `weigh` as filters (o, o, taps)."""
        if self.whitening is not None:
            return self.whitening
        return np.diag(1.0 / self.deviation)[:, :, None]


def told(experiments: Sequence[Experiment]) -> float:
    """Return the share of the samples after settling that count."""
    if all(e.uncounted is None for e in experiments):
        return 1.0
    counted = sum(e.ticks - SETTLING for e in experiments)
    gone = sum(int(e.uncounted[SETTLING:].sum()) for e in experiments if e.uncounted is not None)
    return max(counted - gone, 1) / max(counted, 1)


def whitened(
    observer: Observer,
    innovations: Sequence[Floats],
    experiments: Sequence[Experiment] = (),
    memory: float = MEMORY,
) -> Observer:
    """Return the observer with the filters that whiten innovations (ticks, o) of recordings.

    experiments: the recordings, with their uncounted samples; by default all samples count.

    This is an autoregression by Yule and Walker over all outputs together, since a disturbance
    moves every mass and would count twice if outputs were independent. Slopes depend on past
    readings only, so truly white innovations bias no parameter, whatever noise the observer was
    made for; coloured ones let an effect explain their colour. Hence the high order: with encoder
    noise of correlation 0.6 to 0.7 and order 8, hysteresis gained a chi-square of 65 and 114
    although nothing was missing. Like the gain, the filter is estimated between fits and never
    inside one. Colour from missing physics is whitened too; this costs some of its weight and none
    of its shape, until the physics is found. So that no single line is removed completely, the
    spectrum is smoothed before it is whitened: correlation at lag k counts exp(-k^2 / 2 memory^2),
    a resolution of 1 / (2 pi memory T), 6.6 Hz at 1 kHz.

    A sample that does not count adds nothing to R_k, and all R_k are divided by the same number as
    R_0, so that they remain the covariance of a process.

    Raises NoObserver if no filter makes the innovations white.
    """
    share = told(experiments)
    uncounted = [e.uncounted for e in experiments] or [None] * len(innovations)
    squares = np.mean(np.concatenate([e[SETTLING:] ** 2 for e in innovations]), axis=0)
    size = np.sqrt(squares / share)
    if not np.all(size > 0.0):
        raise NoObserver("an output is predicted without any error: the device stands still")
    kept = [e[SETTLING:] / size for e in innovations]
    total, o = sum(k.shape[0] for k in kept), size.size
    order = min(ORDER, max(1, total // (SPARED * o)))

    # R_k = E e_t e_(t-k)' and R_k = sum_j A_j R_(k-j)
    def together(lag: int) -> Floats:
        found = np.sum([k[lag:].T @ k[: k.shape[0] - lag] for k in kept], axis=0) / (share * total)
        return found * float(np.exp(-0.5 * (lag / memory) ** 2))

    r = np.stack([together(lag) for lag in range(order + 1)])
    lags = np.arange(order) - np.arange(order)[:, None]
    each = np.where((lags >= 0)[:, :, None, None], r[abs(lags)], r[abs(lags)].swapaxes(2, 3))
    blocks = each.swapaxes(1, 2).reshape(order * o, order * o)
    try:
        a = np.linalg.solve(blocks.T, np.hstack(list(r[1:])).T).T
    except np.linalg.LinAlgError as error:
        raise NoObserver(f"the innovations cannot be whitened: {error}") from error
    filters = np.concatenate([np.eye(o)[:, :, None], -a.reshape(o, order, o).swapaxes(1, 2)], 2)
    plain = replace(observer, whitening=filters, deviation=np.ones(o))
    white = np.concatenate(
        [
            plain.weigh(e / size, gone)[SETTLING:]
            for e, gone in zip(innovations, uncounted, strict=True)
        ]
    )
    covariance = white.T @ white / (share * white.shape[0])
    try:
        mixed = np.linalg.solve(np.linalg.cholesky(covariance), filters.reshape(o, -1))
    except np.linalg.LinAlgError as error:
        raise NoObserver(f"the outputs are not independent measurements: {error}") from error
    whitening = mixed.reshape(filters.shape) / size[None, :, None]
    spread = size * np.sqrt(np.diag(covariance))
    return replace(observer, whitening=whitening, deviation=spread, told=share)


@dataclass(frozen=True)
class Fineness:
    """Substeps per tick: with smooth forces, and when friction turns or play opens or shuts.

    Errors for smooth forces, against 64 substeps, on 20 s at 20 times the limit (100 sigma):
    SEARCHING leaves less than 2 sigma, enough to distinguish effects, FINAL less than 0.5.
    SCREENING is for first fits. For friction and play: `python -m benchmarks.event_substeps`.
    """

    smooth: int
    turning: int


SCREENING, SEARCHING, FINAL = Fineness(2, 2), Fineness(4, 4), Fineness(8, 8)


class Prepared(NamedTuple):
    """A device prepared for prediction: with few substeps per tick, and with many."""

    coarse: Equations
    fine: Equations


def prepared(device: Device, fineness: Fineness = FINAL) -> Prepared:
    """Prepare a device. After a reversal inside a substep, friction is wrong for its rest.

    Raises NoObserver if it needs more than `MOST_SUBSTEPS` substeps per tick (`enough`).
    """
    few, many = substeps_of(device, fineness)
    coarse = equations(device, few)
    return Prepared(coarse, equations(device, many) if many > few else coarse)


def substeps_of(device: Device, fineness: Fineness) -> tuple[int, int]:
    """Return the substeps per tick, and the number in ticks that need more; see `prepared`."""
    return substeps_for(device.physics, fineness, enough(device))


def substeps_for(physics: Sequence[Physics], fineness: Fineness, needed: int) -> tuple[int, int]:
    """Return the same for effects if at least `needed` substeps are necessary."""
    hooks = {p.effect.hook for p in physics if p.effect.name != "backlash"}
    few = max(needed, fineness.smooth if "force" in hooks else 1)
    events = "friction" in hooks or any(p.effect.name == "backlash" for p in physics)
    return few, max(few, fineness.turning) if events else few


def enough(device: Device) -> int:
    """Return the substeps per tick for dry friction, else 1; raises NoObserver if too many."""
    needed = enough_substeps(device)
    if needed > MOST_SUBSTEPS:
        raise NoObserver(
            f"{device.name} has a mode so fast that dry friction needs {needed} substeps per tick"
        )
    return needed


def observer_memory(eq: Equations, experiment: Experiment) -> Memory:
    """Return the memory at the first sample: all masses move as in `first_motion`."""
    position, velocity = first_motion(experiment.outputs, experiment.measured, eq.period)
    return start_memory(eq, Start(position, velocity), began=experiment.begins)


def memory_at(
    ready: Prepared, experiment: Experiment, device: Device, gain: Gain
) -> tuple[Memory, Floats | Gains]:
    """Return the memory with which an observer begins a recording, and its padded gain.

    The rest of a recording begins as the part before it ends.
    """
    eq, fine = ready
    (wide,), columns = along([gain], experiment.lost, experiment.all_motions)
    full = padded(wide, experiment.on(device), eq, experiment)
    full = Gains(full, columns) if columns.size else full
    if experiment.before is None:
        return observer_memory(eq, experiment), full
    before = experiment.before
    memory, _ = memory_at(ready, before, device, gain)
    forces = before.external(eq.dof)
    places = before.places(eq)
    alone(eq, fine, places, before.command, before.readings, full, forces, memory, before.strengths)
    return memory, full


def first_motion(outputs: Sequence[Output], measured: Floats, period: float) -> tuple[float, float]:
    """Return position and velocity at the first sample of outputs measured (ticks, o)."""
    velocity = 0.0
    for o, output in enumerate(outputs):
        y = measured[:, o]
        if output.tells_position:
            return float(y[0]), float(SLOPE @ y[: SLOPE.size]) / period
        if output.less is None:
            velocity = float(y[:5].mean())
    return 0.0, velocity


def observer_memories(population: Population, motions: Floats, began: float) -> tuple[Memory, ...]:
    """Return the memories of `observer_memory` for all members.

    motions (members, 2): of `first_motion`; began [s]: time since the start of the recording.
    """
    whole = np.ones((population.size, population.dof - population.followers.shape[0]))
    return population.start(motions[:, :1] * whole, motions[:, 1:] * whole, began)


def innovations(
    device: Device,
    experiment: Experiment,
    gain: Gain,
    external: Floats | None = None,
    ready: Prepared | None = None,
) -> Floats:
    """Return innovations (ticks, o), infinite after an overflow, zero where uncounted.

    external: forces (ticks, n) in place of those of the recording. ready: the prepared device for
    this recording (`Experiment.on`).
    """
    ready = prepared(experiment.on(device)) if ready is None else ready
    eq, fine = ready
    memory, full = memory_at(ready, experiment, device, gain)
    forces = experiment.external(eq.dof, external)
    found = alone(
        eq, fine, experiment.places(eq), experiment.command, experiment.readings,
        full, forces, memory, experiment.strengths,
    )  # fmt: skip
    if experiment.uncounted is not None:
        found[experiment.uncounted] = 0.0
    return found


def followed(device: Device, experiment: Experiment, gain: Gain) -> Floats:
    """Return positions and velocities (ticks, 2n) of all masses that an observer predicts.

    They are outputs that correct nothing, whose innovation for a measurement of zero is minus the
    state.
    """
    n, o = device.chain.masses.size, len(experiment.outputs)
    sensors = [p.effect.name for p in device.physics if p.effect.hook == "sensor"]
    bare = device.without_physics(*sensors) if sensors else device
    further = tuple(Output(q, i, truly=True) for q in ("position", "velocity") for i in range(n))
    wide = replace(experiment, outputs=(*experiment.outputs, *further))
    eq, fine = ready = prepared(experiment.on(bare))
    memory, full = memory_at(ready, experiment, bare, gain)
    found = alone(
        eq, fine, wide.places(eq), experiment.command,
        np.hstack([experiment.readings, np.zeros((experiment.ticks, 2 * n))]),
        _beside(full, o, 2 * n), experiment.external(eq.dof), memory, experiment.strengths,
    )  # fmt: skip
    return -found[:, o:]


def as_followed(e: Experiment, other: Experiment) -> Experiment:
    """Return a recording with the motions of another version of it, also of the part before it."""
    e = replace(e, motions=other.motions)
    if e.before is None or other.before is None:
        return e
    return replace(e, before=as_followed(e.before, other.before))


def innovations_each(
    population: Population, experiment: Experiment, device: Device, gains: Sequence[Gain]
) -> Floats:
    """Return innovations (members, ticks, o) of one device, each member with its gain.

    Infinite after an overflow. population: one copy of the device for each member.
    """
    period = device.interface.period
    force = experiment.external(population.dof)
    wide, columns = along(gains, experiment.bridged, experiment.motions)
    recorded = Recorded(
        experiment.command, experiment.readings, experiment.places(population), force,
        strengths=experiment.strengths, uncounted=experiment.uncounted, columns=columns,
    )  # fmt: skip
    motion = np.array(first_motion(experiment.outputs, experiment.measured, period))
    memories = observer_memories(
        population, np.tile(motion, (population.size, 1)), experiment.begins
    )
    readings = Readings(np.stack([padded(g, device, population, experiment) for g in wide]))
    with np.errstate(all="ignore"):  # infinite after an overflow
        found = population.follow(
            recorded, memories, readings, keep=True,
            run_all=lambda tasks: in_parallel(tasks, threads()),
        ).innovations  # fmt: skip
    if experiment.uncounted is not None:
        found[:, experiment.uncounted] = 0.0
    return found


def in_motion(device: Device, experiment: Experiment, gain: Changing, unit: float) -> Experiment:
    """Return the recording with its `motions`, along which a filter of the gain's noise follows it.

    unit: deviation of a position's measurement. Sensors read the true motion here, since a reading
    in steps has no slope. Raises NoObserver if the device needs too many substeps.
    """
    before = experiment.before
    if before is not None and before.motions is None:
        experiment = replace(experiment, before=in_motion(device, before, gain, unit))
    sensors = [p.effect.name for p in device.physics if p.effect.hook == "sensor"]
    bare = device.without_physics(*sensors) if sensors else device
    eq, by = _filter(bare, experiment, gain, unit, SEARCHING)
    recorded = Recorded(
        experiment.command, experiment.readings, experiment.places(eq),
        experiment.external(eq.dof), strengths=experiment.strengths,
    )  # fmt: skip
    lost = experiment.bridged
    lost = np.zeros(experiment.ticks, np.bool_) if lost is None else lost
    return replace(experiment, motions=motions_along(by, recorded, lost))


def _filter(
    device: Device, experiment: Experiment, gain: Changing, unit: float, fineness: Fineness
) -> tuple[Equations, Filter]:
    """Return the equations of a device, and the filter of its recording with a gain's noise."""
    there = experiment.on(device)
    few, many = substeps_of(there, fineness)
    ready = prepared(there, fineness)
    begins, _ = memory_at(ready, experiment, device, gain)
    eq, n = ready.coarse, gain.spread.p.shape[0]
    half = n // 2
    own = np.concatenate([np.arange(half), eq.dof + np.arange(half), np.full(n % 2, eq.states - 1)])
    known = Uncertain(
        covariance_after(gain, experiment.before), gain.spread.process, gain.spread.c,
        np.diag(gain.spread.noise).copy(), unit,
    )  # fmt: skip
    into = padded(np.eye(n), device, eq, experiment)
    return eq, Filter(Population([there], few, many), begins, into, own, known)


def driven(device: Device, experiment: Experiment, observer: Observer, errors: Floats) -> Floats:
    """Return the outputs (ticks, o) of a device for a command and given innovations e (ticks, o).

    In innovation form, x_(k+1) = f(x_k + L e_k, u_k) and y_k = h(x_k) + e_k, from an observer's
    initial state, with the steady gain. The innovation of an output that stays zero is its
    measurement, here e; outputs that correct nothing, measured as zero, give -h. With a gain that
    follows the motion, L is that of the motion that results. (With those of the recorded motion,
    masses behind play were moved while nothing touched them, and free runs of simulated recordings
    erred 30 times as much as of the one they were made like.) Infinite after an overflow.
    """
    gain, o = observer.gain, errors.shape[1]
    both = np.hstack([errors, np.zeros(errors.shape)])
    if isinstance(gain, Changing) and gain.follows:
        eq, by = _filter(device, experiment, gain, unit_of(observer, gain), FINAL)
        recorded = Recorded(
            experiment.command, both, _doubled(experiment.places(eq)), experiment.external(eq.dof),
            strengths=experiment.strengths,
        )  # fmt: skip
        return errors + driven_along(by, recorded)
    eq, fine = ready = prepared(experiment.on(device))
    memory, _ = memory_at(ready, experiment, device, gain)
    full = padded(steadily(gain), device, eq, experiment)
    found = alone(
        eq, fine, _doubled(experiment.places(eq)), experiment.command, both,
        _beside(full, o, o), experiment.external(eq.dof), memory, experiment.strengths,
    )  # fmt: skip
    return errors - found[:, o:]


def _doubled(places: Outputs) -> Outputs:
    """Outputs that stay zero, one for each, and then these."""
    o = places.state.size
    return Outputs(
        np.concatenate([np.full(o, GROUND), places.state]),
        np.concatenate([np.zeros(o, dtype=np.bool_), places.sensed]),
        np.concatenate([np.full(o, GROUND), places.less]),
        np.concatenate([np.zeros(o), places.late]),
    )


def unit_of(observer: Observer, gain: Changing) -> float:
    """Return the deviation of a position's measurement, from that of the first innovation."""
    p, _, c, _, noise = gain.spread
    own = float((c @ p @ c.T + noise)[0, 0])
    return float(observer.deviation[0]) * math.sqrt(observer.counts * observer.told / own)


def _beside(gain: Floats | Gains, outputs: int, more: int) -> Floats | Gains:
    """Gains with further outputs that correct nothing, after those of each gain."""
    of, columns = gain if isinstance(gain, Gains) else (gain, None)
    parts = of.reshape(of.shape[0], -1, outputs)
    wide = np.pad(parts, ((0, 0), (0, 0), (0, more))).reshape(of.shape[0], -1)
    return wide if columns is None else Gains(wide, columns // outputs * (outputs + more))


def padded(
    gain: Floats, device: Device, eq: Equations | Population, experiment: Experiment
) -> Floats:
    """Return a gain for a device with other states than its own: a lag, further masses.

    gain: one, or several side by side, the steady one first.

    A further mass is corrected like the mass that it is attached to, otherwise every correction
    would stretch its spring. A gain for readings with a lag compensates the lag, which may
    destabilise a device without it; then the gains of the lagging readings are used.
    """
    full = np.zeros((eq.states, gain.shape[1]))
    known = min(gain.shape[0] // 2, eq.dof)
    full[:known] = gain[:known]
    full[eq.dof : eq.dof + known] = gain[gain.shape[0] // 2 :][:known]
    if gain.shape[0] % 2 and eq.states % 2:
        full[-1] = gain[-1]
    for place, parent in enumerate(device.hosts(), device.chain.masses.size):
        if place >= known:
            full[[place, eq.dof + place]] = full[[parent, eq.dof + parent]]
    made, n = gain.shape[0] // 2, device.chain.masses.size
    if made - eq.dof >= n and not settles(device, experiment, full):
        full[:n], full[eq.dof : eq.dof + n] = gain[made - n : made], gain[2 * made - n : 2 * made]
    return full


def window(experiment: Experiment) -> int:
    """Return the ticks of a free run: half a second or a third, at least `SHORTEST_WINDOW`."""
    wanted = min(round(FREE_RUN_S / experiment.period), experiment.ticks // 3)
    return min(max(SHORTEST_WINDOW, wanted), experiment.ticks)


def settling(experiment: Experiment) -> int:
    """Return the ticks until the observer has settled, less those simulated before."""
    before = experiment.before
    return SETTLING if before is None else max(0, SETTLING - before.ticks)


def free_run_starts(experiment: Experiment, length: int) -> list[int]:
    """Return the first ticks of consecutive free runs of a length [ticks], after settling.

    Windows in which the force of an event begins or ends are left out if others remain, since a
    free run accumulates the error of that force.
    """
    possible = range(0, experiment.ticks - length + 1, length)
    settled = [first for first in possible if first >= settling(experiment)]
    if experiment.force is None:
        return settled
    changes = np.any(np.diff(experiment.force, axis=0, prepend=0.0), axis=1)
    quiet = [first for first in settled if not np.any(changes[first : first + length])]
    return quiet or settled


def free_run_errors(
    device: Device, experiment: Experiment, gain: Gain, window: int
) -> tuple[Floats, Floats]:
    """Return errors, and the measurement about its mean in each window, (windows x window, o).

    Both are zero where nothing was measured. Each window starts in the observer's state, then runs
    free.
    """
    starts = free_run_starts(experiment, window)
    (errors,) = (r.errors for r in free_runs(device, experiment, gain, [window]))
    about = [experiment.readings[k : k + window] - experiment.measured[k : k + window].mean(axis=0)
             for k in starts]  # fmt: skip
    outputs = experiment.measured.shape[1]
    signal = np.nan_to_num(np.reshape(about, (-1, outputs)))
    return errors.reshape(-1, outputs), signal


class FreeRuns(NamedTuple):
    """Errors (runs, length, o) of free runs, and the motion (runs, length, 2n) they predict."""

    errors: Floats
    motion: Floats


def free_runs(
    device: Device,
    experiment: Experiment,
    gain: Gain,
    lengths: Sequence[int],
    most: int | None = None,
) -> list[FreeRuns]:
    """Return free runs of each length, at most `most`, evenly spread (see `free_run_errors`)."""
    eq, fine = ready = prepared(experiment.on(device))
    places, o, n = experiment.places(eq), len(experiment.outputs), device.chain.masses.size
    states = np.concatenate([np.arange(n), np.arange(eq.dof, eq.dof + n)])
    wide = Outputs(
        np.concatenate([places.state, states]),
        np.concatenate([places.sensed, np.zeros(2 * n, dtype=np.bool_)]),
        np.concatenate([places.less, np.full(2 * n, GROUND)]),
        np.concatenate([places.late, np.zeros(2 * n)]),
    )
    readings = experiment.readings
    measured = np.hstack([readings, np.zeros((experiment.ticks, 2 * n))])
    memory, full = memory_at(ready, experiment, device, gain)
    begins: list[list[int]] = []
    for length in lengths:
        possible = free_run_starts(experiment, length)
        if most is not None and len(possible) > most:
            spread = np.linspace(0, len(possible) - 1, most).round().astype(np.int64)
            possible = [possible[i] for i in spread]
        begins.append(possible)
    every = sorted((first, i) for i, own in enumerate(begins) for first in own)
    runs = np.array([(first, lengths[i]) for first, i in every], dtype=np.int64).reshape(-1, 2)
    strengths = experiment.strengths
    seen = freely(
        eq, fine, (places, wide), experiment.command, (readings, measured), full,
        experiment.external(eq.dof), memory, runs, np.zeros(0) if strengths is None else strengths,
    )  # fmt: skip
    of, row = np.repeat([i for _, i in every], runs[:, 1]), np.concatenate(
        [np.arange(first, first + ticks) for first, ticks in runs] or [np.zeros(0, np.int64)]
    )  # fmt: skip
    seen = np.where(np.isnan(measured[row]), 0.0, seen)
    each = [seen[of == i].reshape(-1, length, o + 2 * n) for i, length in enumerate(lengths)]
    return [FreeRuns(own[:, :, :o], -own[:, :, o:]) for own in each]


def observer_for(device: Device, experiment: Experiment, ratio: float) -> Floats:
    """Return the steady gain (states, o) for a ratio of variances; may raise NoObserver."""
    return steady(device, experiment, ratio).gain


def observer_near(device: Device, experiment: Experiment, ratio: float) -> Floats:
    """Return the steady gain for a ratio, or for the nearest ratio with an observer.

    The Riccati equation of a light mass on a stiff link may be too badly scaled for one ratio and
    not for the next. Raises NoObserver if none is possible within six decades.
    """
    return beginning_near(device, [experiment], ratio).steady


def beginning_near(device: Device, experiments: Sequence[Experiment], ratio: float) -> Changing:
    """Return the gain from the first sample on for a ratio, or for one near it, `observer_near`."""
    for decades in (0, 1, -1, 2, -2, 3, -3, 4, -4, 5, -5, 6):
        with suppress(NoObserver):
            near = ratio * 10.0**decades
            return changing(device, experiments, near, observer_for(device, experiments[0], near))
    raise NoObserver(f"no observer exists for a noise ratio within six decades of {ratio:.3g}")


def deviation(device: Device, experiments: Sequence[Experiment], gain: Gain) -> Floats:
    """Return the rms of the innovations that count, (o,), infinite after an overflow."""
    kept = np.concatenate([innovations(device, e, gain)[SETTLING:] for e in experiments])
    with np.errstate(all="ignore"):  # infinite after an overflow
        return np.sqrt(np.mean(kept**2, axis=0) / told(experiments))

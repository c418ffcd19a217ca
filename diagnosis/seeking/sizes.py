"""Typical amplitudes in the recordings; they set the magnitudes at which effects are tried."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.noise.predictor import SETTLING, followed, observer_near
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.sim.device import Device
from zwidth.sim.physics.sizes import Sizes

Floats = NDArray[np.float64]
FOLLOWING = 1e-2  # ratio of the observer for the motion of masses that are not measured


def sizes_of(device: Device, experiments: Sequence[Experiment], gain: float = 1.0) -> Sizes:
    """Return sizes over all recordings: of m1 as measured, of other masses by an observer.

    gain: factor of the command in a model, in addition to the device's. If the scale of a drive is
    free, all forces scale with it, and so do the bounds of forces that may hold a mass.

    If no observer is possible, every mass is assumed to move as m1 does, and every link to deflect
    statically. In a free motion the reference force is that of the spring or gravity, m v^2 / x
    with the rms speed v and position x, since k x = m omega^2 x.
    """
    command = gain * np.concatenate([_force(device, e) for e in experiments])
    positions: list[Floats] = []
    speeds: list[Floats] = []
    for e in experiments:
        for o, output in enumerate(e.outputs):
            if output.less is not None:
                continue
            y = e.measured[:, o]
            if output.quantity == "position":
                smooth = np.convolve(y, np.full(5, 0.2), "valid")
                positions.append(y)
                speeds.append(np.gradient(smooth) / e.period)
            else:
                speeds.append(y)
                positions.append(np.cumsum(y) * e.period)
    q, v = np.concatenate(positions), np.concatenate(speeds)
    force = float(np.sqrt(np.mean(command**2)))
    speed, position, span = float(np.std(v)), float(np.std(q)), float(np.ptp(q))
    chain, n = device.chain, device.chain.masses.size
    peak = float(np.abs(command).max())
    driven = any(np.ptp(e.command) > 0.0 for e in experiments)
    if not driven and position > 0.0:
        force = float(chain.masses.sum()) * speed**2 / position
        peak = force * float(np.abs(q - q.mean()).max()) / position
    own = np.array([speed, position, span, float(np.abs(v).max())])
    by_mass, springs = np.tile(own[:, None], n), np.asarray(chain.link_springs, dtype=np.float64)
    stretches = force / springs
    states = _followed(device, experiments) if n > 1 else None
    if states is not None:
        found = np.std(states[:, : n - 1] - states[:, 1:n], axis=0)
        stretches = _where_sound(found, stretches)
        x, v = states[:, 1:n], states[:, n + 1 : 2 * n]
        others = np.array([v.std(axis=0), x.std(axis=0), np.ptp(x, axis=0), np.abs(v).max(axis=0)])
        by_mass[:, 1:] = _where_sound(others, by_mass[:, 1:])
    speeds_by, positions_by, spans_by, fastest = (tuple(row) for row in by_mass.tolist())
    return Sizes(
        rotary=device.rotary,
        period=experiments[0].period,
        force=force,
        peak=peak,
        speed=speed,
        position=position,
        span=span,
        masses=tuple(chain.masses.tolist()),
        speeds=speeds_by,
        positions=positions_by,
        spans=spans_by,
        fastest=fastest,
        springs=tuple(springs.tolist()),
        stretches=tuple(stretches.tolist()),
        step=device.interface.encoder_step,
        driven=driven,
        rates_beside=_rates_beside(experiments),
        switched=any(e.switched_off for e in experiments),
    )


def _rates_beside(experiments: Sequence[Experiment]) -> bool:
    """Whether velocities of masses are recorded beside positions."""
    kinds = {o.quantity for e in experiments for o in e.outputs if o.less is None}
    return len(kinds) > 1


def _force(device: Device, experiment: Experiment) -> Floats:
    """Force of the drive: the scaled command, minus the servo's own reaction."""
    force = device.interface.command_gain * experiment.command
    counts = 1.0 if experiment.strengths is None else experiment.strengths
    if not (loops := [p for p in device.physics if p.effect.name == "position_servo"]):
        return counts * force
    named = [o.name for o in experiment.outputs]
    if "position_m1" not in named:
        return counts * force
    (loop,) = loops
    there = experiment.measured[:, named.index("position_m1")]
    force = force - loop.values["stiffness"] * (there - device.interface.position_origin)
    limits = [p.values["limit"] for p in device.physics if p.effect.name == "servo_limit"]
    return counts * (np.clip(force, -limits[0], limits[0]) if limits else force)


def _followed(device: Device, experiments: Sequence[Experiment]) -> Floats | None:
    """Positions and velocities (ticks, 2n) of all masses; None if no observer is possible."""
    bare = device.bare()
    try:
        gain = observer_near(bare, experiments[0], FOLLOWING)
    except NoObserver:
        return None
    with np.errstate(all="ignore"):
        return np.concatenate([followed(bare, e, gain)[SETTLING:] for e in experiments])


def _where_sound(found: Floats, otherwise: Floats) -> Floats:
    return np.where(np.isfinite(found) & (found > 0.0), found, otherwise)

"""Concealing physics of no library, at multiples of the strength that stands at five sigma.

No device of the library has such physics, so its sigma is computed from the recordings: innovations
of the true device with the physics, less those without it, with the same noise.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.fit import Problem
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.exam.hidden import SEEN, Hidden, Stage, draw_times, seen
from zwidth.exam.strata import Stratum
from zwidth.planning.limits import crossing
from zwidth.planning.reference import Reference
from zwidth.scenarios.concealed.outside import OUTSIDE, Outside
from zwidth.scenarios.concealed.rig import Rig, RunAway, record
from zwidth.scenarios.concealed.shapes import Motion
from zwidth.sim.device import Device
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
Made = tuple[Rig, Trace, tuple[Hidden, ...]]
COARSE = 20  # steps per tick while a strength is sought


def conceal_outside(
    stratum: Stratum, name: str, random: np.random.Generator, stage: Stage
) -> Made | None:
    """Return rig, recording and the concealed physics; None if no strength is visible enough."""
    rig, known, motion = stage.rig, stage.known, stage.motion
    if name == "swaying_stiffness" and rig.device.chain.masses.size < 2:
        return None
    shape = _shape(random, name, motion, rig.device)
    off = known.off()

    def outside(strength: float) -> Outside | None:
        return _strong(name, strength, shape, motion)

    def sigma_at(strength: float) -> float | None:
        physics = outside(strength)
        if physics is None:
            return None
        try:
            trace = record(replace(rig, outside=physics), COARSE).trace
        except RunAway:
            return None
        return float(np.linalg.norm(off(_difference(known, seen(trace, rig.device)))))

    smallest = crossing(lambda factor: sigma_at(0.01 * factor))
    if smallest is None:
        return None
    times = draw_times(random, stratum)
    strength = 0.01 * smallest * times
    physics = outside(strength)
    if physics is None:
        return None
    rig = replace(rig, outside=physics)
    trace = record(rig).trace
    stands = float(np.linalg.norm(off(_difference(known, seen(trace, rig.device)))))
    if stands < SEEN * stratum.least:
        return None
    place = "command" if name == "sagging_drive" else "link12" if "stiff" in name else "m1"
    hidden = Hidden(name, place, dict(physics.values), strength, times, stands, stands, {})
    return rig, trace, (hidden,)


def _difference(known: Reference, other: Experiment) -> Floats:
    """Return the innovations of another recording of the same noise, less the reference's."""
    model = Model(known.device)
    there = Problem([other], known.problem.observer).weighted(model, np.zeros(model.linear_count))
    moved = there - known.base
    return np.concatenate([moved, np.zeros(known.jacobian.shape[0] - moved.size)])


def _shape(
    random: np.random.Generator, name: str, motion: Motion, device: Device
) -> tuple[float, ...]:
    """Numbers of the effect that are not its strength."""
    match name:
        case "swaying_stiffness":
            return (float(random.uniform(1.0, 10.0)),)
        case "swinging_inertia":
            return (motion.span * float(random.uniform(0.2, 1.0)),)
        case "warming_dampers":
            return (float(random.uniform(2.0, 8.0)),)
        case "hum":
            return float(random.uniform(5.0, 80.0)), float(random.uniform(-math.pi, math.pi))
        case "sagging_drive":
            return (float(random.uniform(0.05, 0.5)),)
        case "hard_stop":
            stiffness = float(device.chain.masses.sum()) * (2 * math.pi * 15.0) ** 2
            return stiffness, 0.02 * stiffness / (2 * math.pi * 15.0)
        case "detent":
            return motion.span * float(random.uniform(0.05, 0.3)), float(random.uniform(2.0, 6.0))
        case _:
            return ()


def _strong(name: str, s: float, shape: tuple[float, ...], motion: Motion) -> Outside | None:
    """Return the effect at a strength, 0.01 being about a percent of the motion."""
    keys = OUTSIDE[name][1]
    if name == "hard_stop":
        values = ((1.0 - s) * motion.farthest, *shape)
    elif name == "sagging_drive":
        values = (s / motion.force**2, *shape)
    elif name == "cubic_drag":
        values = (s * motion.force / motion.speed**3,)
    elif name in ("hum", "detent"):
        values = (s * motion.force, *shape)
    else:
        values = (s, *shape)
    unbounded = ("cubic_drag", "hum", "detent", "warming_dampers", "sagging_drive")
    most = math.inf if name in unbounded else 0.9
    if not 0.0 < s <= most:
        return None
    return Outside(name, dict(zip(keys, values, strict=True)))

"""Effects to conceal, sized by the motion they meet; what no magnitude tells is drawn."""

import math
from dataclasses import dataclass

import numpy as np

from zwidth.scenarios.concealed.rig import Made
from zwidth.sim.device import Device, masses_needed
from zwidth.sim.physics import EFFECTS, make_physics
from zwidth.sim.physics.effect import Physics


@dataclass(frozen=True)
class Motion:
    """How a recording moves.

    rms force, largest command and largest change of it per second; of m1 rms speed, rms position,
    span and farthest position; rms stretch of each link.
    """

    force: float
    peak: float
    slew: float
    speed: float
    position: float
    span: float
    farthest: float
    stretch: tuple[float, ...]


def motion_of(made: Made, device: Device) -> Motion:
    """Return the sizes of a recording's motion."""
    n = device.chain.masses.size
    q, v = made.states[:, 0], made.states[:, n]
    command = made.trace["command"]
    links = made.states[:, : n - 1] - made.states[:, 1:n]
    return Motion(
        _rms(command), float(np.abs(command).max()),
        float(np.abs(np.diff(command)).max()) / device.interface.period,
        _rms(v), _rms(q - q.mean()), float(np.ptp(q)), float(np.abs(q).max()),
        tuple(_rms(links[:, i]) for i in range(n - 1)),
    )  # fmt: skip


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def places(device: Device) -> list[tuple[str, str]]:
    """Return every (effect, place) that can be concealed in a device.

    A spring to ground makes a constant force a shift of the recording's origin and a further spring
    to ground a mistaken one: neither is missing physics there. A known encoder step leaves none to
    find.
    """
    found: list[tuple[str, str]] = []
    sprung = device.chain.ground_spring > 0.0
    for name, effect in EFFECTS.items():
        if effect.rotary_only and not device.rotary:
            continue
        if name == "encoder_step" and device.interface.encoder_step > 0.0:
            continue
        for at in effect.places:
            if masses_needed(at) > device.chain.masses.size:
                continue
            if sprung and (name, at) in (("constant_force", "m1"), ("ground_spring", "m1")):
                continue
            found.append((name, at))
    return found


def draw_physics(
    random: np.random.Generator, name: str, at: str, device: Device, motion: Motion
) -> Physics:
    """Return an effect of about one percent of the motion, its other numbers drawn."""

    def spread(low: float, high: float) -> float:
        return float(np.exp(random.uniform(math.log(low), math.log(high))))

    f, v, q = 0.01 * motion.force, motion.speed, motion.position
    sign = float(random.choice((-1.0, 1.0)))
    phase = float(random.uniform(-math.pi, math.pi))
    reach = motion.stretch[int(at[4]) - 1] if at.startswith("link") else q
    values: dict[str, float]
    match name:
        case "stribeck_friction":
            static = f * float(random.uniform(1.3, 2.5))
            values = {"level": f, "static_level": static, "velocity": v * spread(0.03, 0.5)}
        case "presliding_friction":
            values = {"level": f, "stiffness": f / (q * spread(1e-3, 3e-2))}
        case "directional_friction":
            minus, plus = f * spread(0.3, 3.0), f / v * float(random.uniform(0.2, 1.0))
            values = {"level_plus": f, "level_minus": minus, "viscous_plus": plus,
                      "viscous_minus": plus * spread(0.3, 3.0)}  # fmt: skip
        case "quadratic_drag":
            values = {"coefficient": f / v**2}
        case "constant_force":
            values = {"level": sign * f}
        case "ground_spring":
            values = {"stiffness": f / q}
        case "gravity_pendulum":
            values = {"level": f, "angle": phase}
        case "force_ripple":
            period = motion.span * spread(0.03, 0.5)
            values = {"amplitude": f, "period": period, "phase": phase}
        case "backlash":
            values = {"gap": 0.1 * reach}
        case "cubic_stiffness":
            k = f / q if at == "ground" else 0.01 * device.chain.link_springs[int(at[4]) - 1]
            values = {"coefficient": (1.0 if at == "ground" else sign) * float(k) / reach**2}
        case "hysteresis":
            values = {"stiffness": f / (reach * spread(0.03, 0.5)), "level": f,
                      "shape": float(random.uniform(1.0, 3.0))}  # fmt: skip
        case "extra_mode":
            mass = 0.03 * float(device.chain.masses.sum())
            rate = 2.0 * math.pi * spread(8.0, 150.0)
            damping = 2.0 * float(random.uniform(0.02, 0.2)) * mass * rate
            values = {"mass": mass, "stiffness": mass * rate**2, "damping": damping}
        case "saturation":
            values = {"limit": 0.95 * motion.peak}
        case "gain_asymmetry":
            values = {"ratio": 1.0 + 0.01 * sign}
        case "actuator_lag" | "loop_delay":
            (parameter,) = EFFECTS[name].parameters
            values = {parameter.name: 1e-4}
        case "dropped_samples":
            values = {"rate": 1e-3}
        case "encoder_step":
            values = {"step": 1e-5 * motion.span}
        case "encoder_eccentricity":
            period = motion.span * spread(0.05, 1.0)
            values = {"amplitude": 1e-3 * motion.span, "period": period, "phase": phase}
        case "rectified_sensor":
            values = {}
        case _:  # one parameter, a force: Coulomb friction, dead band, command step
            (parameter,) = EFFECTS[name].parameters
            values = {parameter.name: f}
    # A link that hardly moves asks for more than a device file may say; its size is sought anyway.
    bounds = {p.name: (p.lower, p.upper) for p in EFFECTS[name].parameters}
    within = {key: min(max(value, bounds[key][0]), bounds[key][1]) for key, value in values.items()}
    return make_physics(name, at, **within)

"""Which effects a machine of full size may have, how often each comes, and how large it is.

Odds are what one meets on small drives: dry friction nearly always, then free play, weight, cogging
and the amplifier's limits. Sizes are a share of what the machine is driven by: forces of the rms
command, a limit of the largest one, free play of the rms travel, a mass of all masses.
"""

import numpy as np

from zwidth.diagnosis.magnitude import strengthened
from zwidth.scenarios.concealed.shapes import Motion, draw_physics, places
from zwidth.sim.device import Device
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics

ODDS = {
    "coulomb_friction": 6.0,
    "stribeck_friction": 2.0,
    "presliding_friction": 1.5,
    "directional_friction": 1.5,
    "backlash": 3.0,
    "gravity_pendulum": 2.5,
    "force_ripple": 2.5,
    "saturation": 2.0,
    "dead_band": 2.0,
    "cubic_stiffness": 2.0,
    "actuator_lag": 1.5,
    "loop_delay": 1.5,
    "quadratic_drag": 1.5,
    "hysteresis": 1.0,
    "constant_force": 1.5,
    "command_step": 0.7,
    "extra_mode": 1.0,
    "ground_spring": 0.7,
    "gain_asymmetry": 0.7,
    "dropped_samples": 0.4,
    "encoder_eccentricity": 0.7,
}
SHARES = (0.03, 0.3)
# Of these a device has one at a place: two would be one and the same thing.
ALIKE = (
    ("coulomb_friction", "stribeck_friction", "presliding_friction", "directional_friction"),
    ("ground_spring", "gravity_pendulum"),
)
LATE = ("actuator_lag", "loop_delay")  # of which a device has one
LONGEST_LAG, LONGEST_DELAY = 0.05, 0.03  # s, of which the share is taken
DRAWN_AT = 0.01  # the share at which `draw_physics` draws


def choose(
    random: np.random.Generator, device: Device, taken: list[tuple[str, str]]
) -> tuple[str, str] | None:
    """Return an effect and a place that goes beside those taken, None where nothing does."""
    possible: dict[str, list[str]] = {}
    for name, at in places(device):
        if name in ODDS and not any(_clash((name, at), other) for other in taken):
            possible.setdefault(name, []).append(at)
    if not possible:
        return None
    weights = np.array([ODDS[name] for name in possible])
    name = str(random.choice(list(possible), p=weights / weights.sum()))
    return name, str(random.choice(possible[name]))


def _clash(one: tuple[str, str], other: tuple[str, str]) -> bool:
    if one == other or (one[0] in LATE and other[0] in LATE):
        return True
    return one[1] == other[1] and any(one[0] in a and other[0] in a for a in ALIKE)


def sized(
    random: np.random.Generator, name: str, at: str, device: Device, motion: Motion, share: float
) -> Physics | None:
    """Return an effect at a share of the motion; None where it cannot be as large."""
    drawn = draw_physics(random, name, at, device, motion)
    step = device.interface.encoder_step
    match name:
        case "backlash":
            return make_physics(name, at, gap=share * motion.position)
        case "actuator_lag":
            return make_physics(name, at, time_constant=share * LONGEST_LAG)
        case "loop_delay":
            return make_physics(name, at, delay=share * LONGEST_DELAY)
        case "saturation":
            return make_physics(name, at, limit=(1.0 - share) * motion.peak)
        case "dropped_samples":
            return make_physics(name, at, rate=0.2 * share)
        case "encoder_eccentricity":
            values = dict(drawn.values) | {"amplitude": 0.1 * share * motion.position}
            return make_physics(name, at, **values)
        case "extra_mode":
            return strengthened(drawn, share / 0.03)
        case "presliding_friction":
            # Bent by less than some steps, a bristle is Coulomb friction.
            level = share * motion.force
            bend = max(motion.position * float(random.uniform(0.01, 0.1)), 3.0 * step)
            return make_physics(name, at, level=level, stiffness=level / bend)
        case _:
            return strengthened(drawn, share / DRAWN_AT)

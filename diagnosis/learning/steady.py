"""The force of a law in steady motion over one state, for comparison with other curves.

The force at a place over velocity is the sum of all laws there that depend on it: friction, a drag,
a table. Sliding dry friction is at its bound, and a fully bent bristle has the force of its level.
A law that also depends on another state, or on the path, is left out.
"""

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.learning.tables import law_at
from zwidth.sim.physics.dispatch import (
    amplified,
    force_over_states,
    friction_bounds,
    is_over_states,
    sensed,
    smooth_force,
)
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_law import is_table
from zwidth.sim.physics.points import named_states

Floats = NDArray[np.float64]
STATES = {"free_spring": "q", "free_damper": "v", "free_amplifier": "u", "free_sensor": "q"}
HOOKS = {"free_amplifier": "command", "free_sensor": "sensor"}
SLIDES = ("presliding_friction",)  # laws with memory, which is constant in steady sliding
ASIDE = ((0.0, 0.0, 0.0), (0.7, -0.4, 0.9), (-1.3, 0.8, -0.5))  # trial values of the other states
SAME = 1e-9


def along(law: Physics, curve: str, at: Floats) -> Floats | None:
    """Return the force of a law at states (points,) of a curve, such as "free_damper".

    None if the law enters elsewhere than such a curve, or depends on more than that state.
    """
    if is_table(law.effect.parameters):
        return law_at(law, at) if law.effect.name == curve else None
    over = named_states(law)
    if len(over) > 1 or "time" in over:
        return None
    force = law.effect.hook in ("force", "friction")
    if law.effect.borrows or (HOOKS.get(curve, "force") != law.effect.hook and not force):
        return None
    if force and curve in HOOKS:
        return None
    state = STATES[curve]
    if law.effect.name in SLIDES:
        return -law.values["level"] * np.sign(at) if state == "v" else None
    if law.effect.code == 0 or law.effect.name in ("hysteresis", "backlash"):
        return None
    p = law.vector()
    found = [np.array([_gives(law, state, s, aside, p) for s in at]) for aside in ASIDE]
    size = float(np.abs(found[0]).max())
    alike = all(np.abs(other - found[0]).max() <= SAME * size for other in found[1:])
    return found[0] if alike else None


def _gives(
    law: Physics, state: str, value: float, aside: tuple[float, float, float], p: Floats
) -> float:
    """A law at one state, ignoring the others."""
    q, v, u = (value if name == state else other for name, other in zip("qvu", aside, strict=True))
    code = law.effect.code
    match law.effect.hook:
        case "friction":
            lower, upper, _, _ = friction_bounds(code, q, v, u, 1.0, p)
            return float(lower if v > 0.0 else upper if v < 0.0 else 0.0)
        case "command":
            return float(amplified(code, u, p)) - u
        case "sensor":
            return float(sensed(code, q, p)) - q
        case _ if is_over_states(code):  # over one state, and not time
            return float(force_over_states(code, q, v, u, 0.0, p))
        case _:
            return float(smooth_force(code, q, v, 0.0, u, u, 1.0, p))

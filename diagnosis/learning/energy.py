"""Whether a learned law generates energy: its force times the velocity at its place.

A force over velocity generates energy if f(v) v > 0. Its straight part cannot be distinguished from
the damper b at its place, so f(v) - b v is tested, with the named effects there. A force over
position, or over the deflection of a link, is the slope of an energy, and generates none round any
closed path. A law in the command or the reading belongs to the drive, which need not be passive.
"""

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.learning.curves import Learned
from zwidth.diagnosis.learning.tables import law_at
from zwidth.sim.readable import with_unit

Floats = NDArray[np.float64]
FINE = 401  # velocities that are tested
SEEN = (0.005, 0.995)  # quantiles of the samples between which these lie
LITTLE = 1e-3  # of the largest power, below which no energy is generated


def makes_energy(curve: Learned, rotary: bool) -> str:
    """Say whether a law ever generates energy over the states that were seen."""
    match curve.physics.effect.name:
        case "free_spring":
            return (
                "this force depends on position alone, so it generates no energy over a closed path"
            )
        case "free_damper":
            return _fed(curve, rotary)
        case _:
            return "this law acts through the drive, which supplies energy"


def _fed(curve: Learned, rotary: bool) -> str:
    """Say the same for a force over a velocity."""
    low, high = (float(q) for q in np.quantile(curve.seen, SEEN))
    v = np.linspace(low, high, FINE)
    own, all_of = law_at(curve.physics, v) * v, powers(curve, v)
    with_it = "its damper" + (
        f" and {' and '.join(curve.together.names)}" if curve.together is not None else ""
    )
    if float(own.max()) <= LITTLE * float(np.abs(own).max()):
        return "this force dissipates energy at every velocity in the recording"
    if float(all_of.max()) <= LITTLE * float(np.abs(all_of).max()):
        return (
            "alone, this force generates energy at some velocities; together with"
            f" {with_it}, at none"
        )
    most = int(np.argmax(all_of))
    at = with_unit(float(v[most]), "rad/s" if rotary else "m/s", 2)
    power = with_unit(float(all_of[most]), "W", 2)
    return f"this force generates energy, even together with {with_it}: up to {power} at {at}"


def powers(curve: Learned, v: Floats) -> Floats:
    """Return the power of a law, its damper and the effects beside it at velocities (n,)."""
    h, place = curve.hypothesis, curve.physics.place
    chain = h.model.build(h.x).chain
    dampers = chain.link_dampers if place.kind == "link" else chain.ground_dampers
    damped = float(dampers[place.index]) * v
    return (law_at(curve.physics, v) + curve.named_at(v) - damped) * v

"""Weight of a pendulum on the axis of m1: f = -level sin(q + angle).

level: weight times lever; angle: how far from hanging straight down it is at q = 0.
"""

import math

from zwidth.sim.elementary import sin
from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Effect, Parameter

gravity_pendulum = Effect(
    name="gravity_pendulum",
    summary="weight on a lever that turns with the axis",
    places=("m1",),
    parameters=(
        Parameter("level", "f_g", "N m", 0.0, 1e6, 0.0),
        Parameter("angle", "phi_g", "rad", -2.0 * math.pi, 2.0 * math.pi, None),
    ),
    hook="force",
    code=6,
    reference="plane pendulum",
    rotary_only=True,
)


@part
def pendulum_force(q, p):
    """Force at position q."""
    return -p[0] * sin(q + p[1])

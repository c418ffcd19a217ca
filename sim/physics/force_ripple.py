"""A force that comes and goes with position, as a motor's cogging or a cable drum's runout.

    f = amplitude sin(2 pi q / period + phase)

It has the potential amplitude period / (2 pi) cos(2 pi q / period + phase). A substep must be short
against the time period / |v| in which the mass crosses a period.
"""

import math

from zwidth.sim.elementary import sin
from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Effect, Parameter

force_ripple = Effect(
    name="force_ripple",
    summary="a force periodic in position",
    places=("m1",),
    parameters=(
        Parameter("amplitude", "a_r", "N m", 0.0, 1e6, 0.0),
        Parameter("period", "lambda_r", "rad", 1e-9, 1e6, None),
        Parameter("phase", "phi_r", "rad", -2.0 * math.pi, 2.0 * math.pi, None, "rad"),
    ),
    hook="force",
    code=7,
    reference="Holtz & Springob, IEEE T. Industrial Electronics 43(2), 1996",
)


@part
def ripple_force(q, p):
    """Force at position q."""
    return p[0] * sin(2.0 * math.pi * q / p[1] + p[2])

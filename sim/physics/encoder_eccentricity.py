"""The encoder's disk runs off centre: it reads q + amplitude sin(2 pi q / period + phase).

amplitude: eccentricity over the disk's radius (in rad on a rotary device); period: what one turn of
the disk is of m1's position.
"""

import math

from zwidth.sim.elementary import sin
from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Effect, Parameter

encoder_eccentricity = Effect(
    name="encoder_eccentricity",
    summary="the reading errs periodically in position",
    places=("sensor",),
    parameters=(
        Parameter("amplitude", "a_e", "rad", 0.0, 1e3, 0.0),
        Parameter("period", "lambda_e", "rad", 1e-9, 1e6, None),
        Parameter("phase", "phi_e", "rad", -2.0 * math.pi, 2.0 * math.pi, None, "rad"),
    ),
    hook="sensor",
    code=1,
    reference="first harmonic of an off-centre disk, to first order in the eccentricity",
)


@part
def off_centre(position, p):
    """Return the reading of a position."""
    return position + p[0] * sin(2.0 * math.pi * position / p[1] + p[2])

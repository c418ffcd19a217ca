"""Dry friction that is highest at rest and falls with speed, to a level.

    g(v) = level + (static_level - level) exp(-(v / velocity)^2),    |f| <= g(0) at rest,
    f = -g(v) sign(v) in motion.

g is continuous at v = 0, so breaking away needs no jump. Over a substep the bound is the mean of g
at its start and at its predicted end (second order while sliding); sticking and stopping are those
of `coulomb_friction`. g falls steepest at v = velocity / sqrt(2), by 0.86 (static_level - level) /
velocity: the substep must be short against the time m velocity / (static_level - level) in which
the mass runs away there.
"""

from zwidth.sim.elementary import exp
from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Effect, Parameter

stribeck_friction = Effect(
    name="stribeck_friction",
    summary="dry friction that falls with speed from a higher level at rest",
    places=("m1", "m2", "m3"),
    parameters=(
        Parameter("level", "f_c", "N m", 0.0, 1e6, 0.0),
        Parameter("static_level", "f_s", "N m", 0.0, 1e6, 0.0),
        Parameter("velocity", "v_s", "rad/s", 1e-12, 1e6, None),
    ),
    hook="friction",
    code=2,
    reference="Armstrong-Helouvry, Dupont & Canudas de Wit, Automatica 30(7), 1994, eq. (4)",
    varies_with_speed=True,
)


@part
def stribeck_bounds(v, p):
    """Bounds at velocity v: (lower, upper) sliding, (lower, upper) sticking (read at v = 0)."""
    ratio = v / p[2]
    g = p[0] + (p[1] - p[0]) * exp(-ratio * ratio)
    return -g, g, -g, g

"""Friction that differs between the two directions, dry and viscous.

    f = -(level_plus + viscous_plus v) for v > 0,    f = level_minus + viscous_minus |v| for v < 0,
    -level_plus <= f <= level_minus at rest.

The viscous part is part of the bound, not a force of its own: friction of any size then stops a
mass and never throws it back, so no viscosity is unstable at any substep. The bound is the mean of
its values at the start and at the predicted end of a substep: second order for h << m / viscous,
also across v = 0 without dry levels, where the bound is continuous.
"""

from zwidth.sim.jit import part
from zwidth.sim.lane_type import greatest
from zwidth.sim.physics.effect import Effect, Parameter

directional_friction = Effect(
    name="directional_friction",
    summary="dry and viscous friction that differ between the two directions",
    places=("m1",),
    parameters=(
        Parameter("level_plus", "f_c+", "N m", 0.0, 1e6, 0.0),
        Parameter("level_minus", "f_c-", "N m", 0.0, 1e6, 0.0),
        Parameter("viscous_plus", "b_+", "N m s/rad", 0.0, 1e6, 0.0),
        Parameter("viscous_minus", "b_-", "N m s/rad", 0.0, 1e6, 0.0),
    ),
    hook="friction",
    code=3,
    reference="Armstrong-Helouvry, Control of Machines with Friction, Kluwer 1991",
    varies_with_speed=True,
)


@part
def directional_bounds(v, p):
    """Bounds at velocity v: (lower, upper) sliding, (lower, upper) sticking."""
    lower = -(p[0] + p[2] * greatest(v, 0.0))
    upper = p[1] + p[3] * greatest(-v, 0.0)
    return lower, upper, -p[0], p[1]

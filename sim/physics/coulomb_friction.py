"""Dry friction of constant level: |f| <= level at rest, f = -level sign(v) in motion."""

from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Effect, Parameter

coulomb_friction = Effect(
    name="coulomb_friction",
    summary="dry friction of constant level",
    places=("m1", "m2", "m3"),
    parameters=(Parameter("level", "f_c", "N m", 0.0, 1e6, 0.0),),
    hook="friction",
    code=1,
    reference="Coulomb 1785; implicit as in Moreau, Unilateral contact and dry friction, 1988",
)


@part
def coulomb_bounds(p):
    """Bounds: (lower, upper) sliding, (lower, upper) sticking."""
    return -p[0], p[0], -p[0], p[0]

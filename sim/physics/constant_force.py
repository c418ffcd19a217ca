"""A constant force on m1: weight, an amplifier's offset, a cable's pull."""

from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Effect, Parameter

constant_force = Effect(
    name="constant_force",
    summary="a constant force or offset",
    places=("m1",),
    parameters=(Parameter("level", "f_0", "N m", -1e6, 1e6, 0.0),),
    hook="force",
    code=3,
    reference="-",
)


@part
def constant_level(p):
    """Return the force."""
    return p[0]

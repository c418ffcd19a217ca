"""Drag of a mass against its surroundings, growing with the square of speed: f = -c v |v|."""

from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Effect, Parameter

quadratic_drag = Effect(
    name="quadratic_drag",
    summary="drag that grows with the square of speed",
    places=("m1", "m2", "m3"),
    parameters=(Parameter("coefficient", "c_2", "N m s2/rad2", 0.0, 1e6, 0.0),),
    hook="force",
    code=2,
    reference="turbulent drag, Rayleigh",
)


@part
def drag_force(v, p):
    """Force at velocity v."""
    return -p[0] * v * abs(v)

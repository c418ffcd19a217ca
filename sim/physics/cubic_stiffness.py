"""A spring that hardens (coefficient > 0) or softens: f = -k3 q^3 of the relative position."""

from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Effect, Parameter

cubic_stiffness = Effect(
    name="cubic_stiffness",
    summary="cubic part of a spring",
    places=("ground", "link12", "link23"),
    parameters=(Parameter("coefficient", "k_3", "N m/rad3", -1e15, 1e15, 0.0),),
    hook="force",
    code=1,
    reference="G. Duffing, Erzwungene Schwingungen, 1918",
)


@part
def cubic_force(q, p):
    """Force at relative position q."""
    return -p[0] * q * q * q

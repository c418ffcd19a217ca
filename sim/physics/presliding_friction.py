"""Friction as a bristle that bends before it slips: Dahl's model.

With z the force over its level,

    dz/dq = (stiffness / level) (1 - z sign(dq)),    f = -level z.

This is LuGre (Canudas de Wit et al., IEEE T. Automatic Control 40(3), 1995) without the two terms
that a level and a stiffness cannot carry, its micro-damping and its Stribeck curve: the same
presliding spring, the same steady sliding. z depends on the path alone, and along a path of one
direction

    z_1 = s + (z_0 - s) exp(-stiffness |q_1 - q_0| / level),    s = sign(q_1 - q_0),

exactly: |z| <= 1 for any step. A path that turns is cut at its turning point. As a force it is held
over the substep at the mean of both ends: second order, stable for h < 2 sqrt(m / stiffness) and
below that far from it. Like every such model it creeps under a load that trembles; what must stick
for good is `coulomb_friction`.
"""

from zwidth.sim.elementary import exp
from zwidth.sim.jit import part
from zwidth.sim.lane_type import any_lane, select, signed
from zwidth.sim.physics.effect import Effect, Parameter
from zwidth.sim.physics.path import out_and_back

presliding_friction = Effect(
    name="presliding_friction",
    summary="friction that yields like a spring before it slips",
    places=("m1", "m2", "m3"),
    parameters=(
        Parameter("level", "f_c", "N m", 0.0, 1e6, 0.0),
        Parameter("stiffness", "sigma_0", "N m/rad", 0.0, 1e12, None),
    ),
    hook="force",
    code=4,
    reference="P. R. Dahl, A solid friction model, Aerospace Corporation TOR-0158(3107-18)-1, 1968",
)


@part
def dahl_force(z, p):
    """Force of a bristle bent to z."""
    return -p[0] * z


@part
def dahl_along(z, way, p):
    """Bristle after a way in one direction."""
    side = signed(1.0, way)
    level = select(p[0] == 0.0, 1.0, p[0])
    return side + (z - side) * exp(-p[1] * abs(way) / level)


@part
def next_bristle(z, q0, q1, v0, v1, h, p):
    """Bristle after a substep."""
    out, back = out_and_back(q0, q1, v0, v1, h)
    after = dahl_along(z, out, p)
    if any_lane(back != 0.0):
        after = select(back != 0.0, dahl_along(after, back, p), after)
    return select(p[0] == 0.0, z, after)

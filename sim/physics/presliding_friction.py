"""Friction as a bristle that bends before it slips: Dahl's model.

With z the force over its level,

    dz/dq = (stiffness / level) (1 - z sign(dq)),    f = -level z.

This is the LuGre model (Canudas de Wit et al., IEEE T. Automatic Control 40(3), 1995) without
micro-damping and without a Stribeck curve: the spring before slipping and the steady sliding are
the same.

Limits: under a load that vibrates, a mass creeps, as with every model of this kind; with
`coulomb_friction` it stays where it is. A substep must be shorter than 2 sqrt(m / stiffness).
"""

from collections.abc import Iterator

import numpy as np

from zwidth.sim.elementary import exp
from zwidth.sim.jit import part
from zwidth.sim.lane_type import any_lane, select, signed
from zwidth.sim.physics.effect import Effect, Parameter, Scaled, Values
from zwidth.sim.physics.path import out_and_back
from zwidth.sim.physics.sizes import Sizes, spread, up_to
from zwidth.sim.place import MASSES, Place


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    for share in (0.01, 0.06, 0.2):
        for reach in (0.01, 0.1):
            level = share * z.force
            values = {"level": level, "stiffness": level / (reach * z.position)}
            yield values, {k: 0.5 * x for k, x in values.items()}


def _sweep(z: Sizes, place: Place) -> Iterator[Scaled]:
    for level in up_to(z.peak):
        for reach in (0.01, 0.1):
            values = {"level": level, "stiffness": level / (reach * z.positions[place.index])}
            yield values, {k: 0.5 * x for k, x in values.items()}


def _drawn(random: np.random.Generator, z: Sizes, _: Place) -> Values:
    level = 0.01 * z.force
    return {"level": level, "stiffness": level / (z.position * spread(random, 1e-3, 3e-2))}


def _at_share(random: np.random.Generator, z: Sizes, _: Place, share: float) -> Values:
    """A bristle that bends by less than some steps of the encoder is Coulomb friction."""
    level = share * z.force
    bend = max(z.position * float(random.uniform(0.01, 0.1)), 3.0 * z.step)
    return {"level": level, "stiffness": level / bend}


# No bound from the recording: a bristle that never slips is a spring, whatever its level, which is
# a limit of the law and none of physics; a wall there turned fits of a real device aside.
presliding_friction = Effect(
    name="presliding_friction",
    summary="friction that yields like a spring before it slips",
    formula="f = -level z,  dz/dq = (stiffness / level) (1 - z sign(dq))",
    places=MASSES,
    parameters=(
        Parameter(
            "level", "f_c", "N m", 0.0, 1e6, 0.0, role="magnitude", meaning="force in sliding"
        ),
        Parameter(
            "stiffness",
            "sigma_0",
            "N m/rad",
            0.0,
            1e12,
            None,
            role="magnitude",
            meaning="of the bristles, before it slips",
        ),
    ),
    hook="force",
    code=4,
    mistaken_for=("coulomb_friction", "hysteresis", "ground_spring"),
    reference="P. R. Dahl, A solid friction model, Aerospace Corporation TOR-0158(3107-18)-1, 1968",
    prior=0.05,  # of dry friction, where the motion is so small that its bristles show
    contains=("coulomb_friction",),
    family="dry friction",
    creased=True,
    starts=_starts,
    sweep=_sweep,
    drawn=_drawn,
    odds=1.5,
    at_share=_at_share,
)


# z depends on the path alone. Along a path of one direction, exactly,
#
#     z_1 = s + (z_0 - s) exp(-stiffness |q_1 - q_0| / level),    s = sign(q_1 - q_0),
#
# so that |z| <= 1 for any step. A path that turns is cut at its turning point. The force is held
# over the substep at the mean of both ends: second order, stable for h < 2 sqrt(m / stiffness), and
# accurate for h far below that.


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

"""A servo without force close to its goal: f = -clip(k (goal - q), -k half, k half).

half: of the zone, to each side; k: the stiffness of the `position_servo`, whose force is then k
(goal - q -+ half) outside. Play in series with a spring whose other end is moved is the same law.

Limits: with a `servo_limit` the force at the limit is too low by k half.
"""

import math
from collections.abc import Iterator

import numpy as np

from zwidth.sim.jit import part
from zwidth.sim.lane_type import greatest, least
from zwidth.sim.physics.effect import Bounds, Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import Sizes, up_to
from zwidth.sim.place import Place


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    for share in (0.01, 0.05, 0.2):
        yield {"half": share * z.position}, {"half": 0.5 * share * z.position}


def _sweep(z: Sizes, _: Place) -> Iterator[Scaled]:
    for half in up_to(z.position):
        yield {"half": half}, {"half": 0.5 * half}


def _bounds(z: Sizes, _: Place) -> Bounds:
    return {"half": (0.0, z.span)}


def _natural(z: Sizes, _: Place) -> float:
    return z.position


def _drawn(_: np.random.Generator, z: Sizes, __: Place) -> Values:
    return {"half": 0.01 * z.position}


servo_dead_zone = Effect(
    name="servo_dead_zone",
    summary="a zone around a servo's goal in which it gives no force, or play at a moved end",
    formula=(
        "force of the servo: 0 for |goal - q| <= half,  "
        "k (goal - q -+ half) beyond it,  "
        "k: its stiffness"
    ),
    places=("m1",),
    parameters=(
        Parameter(
            "half",
            "q_d",
            "rad",
            0.0,
            math.inf,
            0.0,
            role="magnitude",
            meaning="half of the zone: to each side of the goal",
        ),
    ),
    hook="force",
    code=13,
    mistaken_for=("backlash", "coulomb_friction"),
    reference="ideal dead zone inside the loop",
    borrows=("servo",),
    needs="position_servo",
    prior=0.1,  # many hobby servos have one of a step or two
    creased=True,
    starts=_starts,
    sweep=_sweep,
    bounds=_bounds,
    natural=_natural,
    drawn=_drawn,
)


@part
def within_zone(u, q, s, p):
    """The part of the demanded force that the zone removes, under command u and at strength s."""
    most = p[0] * p[1]
    return -s * least(greatest(u - p[1] * q, -most), most)

"""A limit of the drive's force that falls with speed: |f| <= limit - slope |v| while it drives.

    -limit - slope v <= f <= limit - slope v

is what a current loop gives on a supply of U volts: the winding takes a current of at most (U - g
k_e v) / R, so that limit = g k_t U / R and slope = g^2 k_t k_e / R. When it brakes, the back-EMF
helps, and the limit rises. f is the held command or, with a `position_servo`, the force that its
loop asks for within its `servo_limit`.

Limits: the command is the held one, before an `actuator_lag`; beyond limit / slope the supply
brakes, as it does through the diodes of a bridge.
"""

import math
from collections.abc import Iterator

import numpy as np

from zwidth.sim.jit import part
from zwidth.sim.lane_type import greatest, least
from zwidth.sim.physics.effect import Bounds, Effect, Parameter, Scaled, Values
from zwidth.sim.physics.position_servo import asked
from zwidth.sim.physics.sizes import Sizes
from zwidth.sim.place import Place

MOST, LEAST = 5.0, 0.025  # of the largest command: hardly seen, and hardly anything is left


def _of(limit: float, free: float, part: float) -> Scaled:
    values = {"limit": limit, "slope": limit / free}
    return values, {name: part * value for name, value in values.items()}


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    if z.fastest[0] > 0.0:
        for share in (1.2, 0.8, 0.5):
            for beyond in (1.05, 1.5):
                yield _of(share * z.peak, beyond * z.fastest[0], 0.2)


def _sweep(z: Sizes, _: Place) -> Iterator[Scaled]:
    if z.fastest[0] > 0.0:
        for share in (MOST, 2.0, 1.2, 0.8, 0.5, 0.3, 0.1, LEAST):
            yield _of(share * z.peak, 1.2 * z.fastest[0], 0.3)


def _bounds(z: Sizes, _: Place) -> Bounds:
    """A motor whose limit is many times the largest command is not seen at it."""
    return {"limit": (0.0, MOST * z.peak)}


def _natural(z: Sizes, _: Place) -> float:
    return 1.0 / (LEAST * z.peak)


def _drawn(random: np.random.Generator, z: Sizes, _: Place) -> Values:
    """By a quarter to two thirds lower at the largest speed: without a slope it is a saturation."""
    limit, free = 0.95 * z.peak, random.uniform(1.5, 4.0) * z.fastest[0]
    return {"limit": limit, "slope": limit / free if free > 0.0 else 0.0}


falling_limit = Effect(
    name="falling_limit",
    summary="a limit of the drive's force that falls with speed",
    formula="-limit - slope v <= force <= limit - slope v",
    places=("m1",),
    parameters=(
        Parameter(
            "limit",
            "f_max",
            "N m",
            1e-12,
            math.inf,
            math.inf,
            role="strength",
            least=0.3,
            inverse=True,
            meaning="largest force of the drive at rest",
        ),
        Parameter(
            "slope",
            "c",
            "N m s/rad",
            0.0,
            1e12,
            0.0,
            meaning="by which it falls for each unit of speed: back-EMF times force a volt",
        ),
    ),
    hook="force",
    code=17,
    mistaken_for=("saturation", "servo_limit", "quadratic_drag"),
    reference="torque-speed line of a DC motor on a supply",
    of_drive=True,
    borrows=("servo",),
    contains=("saturation",),  # without a slope
    prior=0.03,  # of every motor on a supply; few recordings go there
    creased=True,
    weakens=True,
    starts=_starts,
    sweep=_sweep,
    bounds=_bounds,
    natural=_natural,
    drawn=_drawn,
)


@part
def beyond_falling_limit(w, q, v, s, p):
    """The reduction of the drive's force by the limit, at strength s of the drive."""
    a = s * least(greatest(asked(w, q, v, p, 2), -p[5]), p[5])
    return least(greatest(a, -p[0] - p[1] * v), p[0] - p[1] * v) - a

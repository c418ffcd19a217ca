"""A servo that follows its goal no faster than a fixed speed.

    g_k = g_(k-1) + clip(goal_k - g_(k-1), -rate T, rate T)

is the goal of its loop. After a step of the commanded goal, the force is small at first and grows
as this goal moves ahead of the shaft; in a log of the servo's force it looks like a torque limit at
the beginning of every step. The goal is in units of position (`position_servo`), so the rate does
not depend on gains.

Limits: the goal is moved at the ticks, and its acceleration is not limited.
"""

import math
from collections.abc import Iterator

import numpy as np

from zwidth.sim.physics.effect import Bounds, Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import Sizes
from zwidth.sim.place import Place

SLOWEST = 0.3  # of the highest recorded speed: a servo may be faster than its goal


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    for share in (0.7, 1.0, 1.5, 3.0):
        rate = share * z.fastest[0]
        yield {"rate": rate}, {"rate": 0.2 * rate}


def _sweep(z: Sizes, _: Place) -> Iterator[Scaled]:
    for share in (SLOWEST, 0.6, 1.0, 1.5, 3.0, 6.0, 20.0, 60.0):
        rate = min(share * z.fastest[0], 2.0 * z.span / z.period)
        yield {"rate": rate}, {"rate": 0.3 * rate}


def _bounds(z: Sizes, _: Place) -> Bounds:
    """No device covers its whole travel within one tick."""
    return {"rate": (0.0, 2.0 * z.span / z.period)}


def _natural(z: Sizes, _: Place) -> float:
    return 1.0 / (SLOWEST * z.fastest[0]) if z.fastest[0] > 0.0 else 1.0


def _drawn(_: np.random.Generator, z: Sizes, __: Place) -> Values:
    return {"rate": z.fastest[0]}


goal_rate_limit = Effect(
    name="goal_rate_limit",
    summary="a limit of the speed at which a servo moves its own goal",
    formula="|goal'| <= rate,  goal: that of the loop",
    places=("command",),
    parameters=(
        Parameter(
            "rate",
            "r_g",
            "rad/s",
            1e-12,
            math.inf,
            math.inf,
            role="strength",
            least=0.3,
            inverse=True,
            meaning="largest speed of the goal",
        ),
    ),
    hook="command",
    code=5,
    mistaken_for=("loop_delay", "servo_limit"),
    reference="profile velocity of a position servo, without a profile acceleration",
    needs="position_servo",
    prior=0.2,  # a register of most serial servos
    creased=True,
    starts=_starts,
    sweep=_sweep,
    bounds=_bounds,
    natural=_natural,
    drawn=_drawn,
)

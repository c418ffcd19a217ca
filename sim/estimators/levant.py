"""Levant's differentiator: a sliding mode that follows the reading.

    z0' = z1 - 1.5 sqrt(L) |z0 - y|^(1/2) sign(z0 - y),    z1' = -1.1 L sign(z0 - y)

by Euler's forward step of the period h, estimate z1. In continuous time, without noise and with
|y''| <= L, it is exact after a finite time; in steps its error stays within a multiple of L h, and
with noise of size e within one of sqrt(L e): no differentiator does better in order. In the code
w = h z1, so that all is in units of the reading.

Limits: a reading that accelerates beyond L is followed late. At rest it oscillates with an
amplitude of L h^2 in w, that is L h in velocity, like every explicit discretisation of a sign. No
response in z.

Reference: A. Levant, Robust exact differentiation via sliding mode technique, Automatica 34, 379,
1998, with its gains; in steps: M. Livne, A. Levant, Proper discretization of homogeneous
differentiators, Automatica 50, 2007, 2014, which for this order is Euler's. In haptics: V. Chawda,
O. Celik, M. K. O'Malley, Application of Levant's differentiator for velocity estimation and
increased Z-width in haptic interfaces, World Haptics 2011.
"""

# pyright: reportMissingParameterType=false, reportUnknownParameterType=false

import math
from collections.abc import Callable

from zwidth.sim.estimators.estimator import Estimator, Settings
from zwidth.sim.jit import part
from zwidth.sim.lane_type import root, select

LEVANT = 3
ROOT_GAIN, SIGN_GAIN = 1.5, 1.1


def _numbers(settings: Settings) -> tuple[float, ...]:
    h, bound = settings.period, settings.acceleration
    return h * ROOT_GAIN * math.sqrt(bound), h * h * SIGN_GAIN * bound


def _begin(settings: Settings, read: Callable[[int], float], speed: float) -> list[float]:
    return [read(0), settings.period * speed]


@part
def slid(y, by_root, by_sign, kept, first):
    """Return w after the reading y; kept[first:] holds z0, w."""
    error, w = kept[first] - y, kept[first + 1]
    sign = select(error > 0.0, 1.0, select(error < 0.0, -1.0, 0.0 * error))
    kept[first] = kept[first] + (w - by_root * root(abs(error)) * sign)
    w = w - by_sign * sign
    kept[first + 1] = w
    return w


levant = Estimator(
    name="levant",
    code=LEVANT,
    settings=("acceleration",),
    meaning="Levant's differentiator, a sliding mode: exact up to an acceleration",
    reference="A. Levant, Automatica 34, 379, 1998",
    room=lambda settings: 2,
    numbers=_numbers,
    begin=_begin,
)

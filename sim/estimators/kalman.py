"""The steady Kalman filter of a constant velocity that is disturbed by accelerations.

    p' = p + h v + h^2/2 a,   v' = v + h a,   y = p + e

with a new, independent acceleration a of standard deviation q in each period, and readings that are
off by e of standard deviation r. In the steady state it is the alpha-beta filter, v = v^ + beta/h
(y - p^), whose gains follow from the tracking index alone,

    lambda = q h^2 / r,   s = (4 + lambda - sqrt(8 lambda + lambda^2)) / 4,
    alpha = 1 - s^2,      beta = 2 (1 - s)^2.

Over the backward difference the estimate has the response beta / (1 - (2 - alpha - beta)/z +
(1 - alpha)/z^2).

Limits: an encoder's rounding is taken as noise of D / sqrt(12), which it is not when nothing moves.
For lambda far above 1 beta nears 2, and the estimate alternates from period to period.

Reference: P. R. Kalata, The tracking index: a generalized parameter for alpha-beta and
alpha-beta-gamma target trackers, IEEE Trans. Aerospace and Electronic Systems 20, 174, 1984.
P. R. Belanger, P. Dobrovolny, A. Helmy, X. Zhang, Estimation of angular velocity and acceleration
from shaft-encoder measurements, Int. J. Robotics Research 17, 1225, 1998.
"""

# pyright: reportMissingParameterType=false, reportUnknownParameterType=false

import math
from collections.abc import Callable

import numpy as np

from zwidth.sim.estimators.estimator import Complexes, Estimator, Floats, Linear, Settings
from zwidth.sim.jit import part

KALMAN = 4


def _numbers(settings: Settings) -> tuple[float, ...]:
    index = settings.acceleration * settings.period * settings.period / settings.noise
    # 1 - s without cancellation: s is near 1 for a small index, near 0 for a large one.
    spread = math.sqrt(8.0 * index + index * index)
    less = 2.0 * index / (spread + index)  # (sqrt(8 i + i^2) - i) / 4
    return less * (2.0 - less), 2.0 * less * less


def _begin(settings: Settings, read: Callable[[int], float], speed: float) -> list[float]:
    return [read(1), settings.period * speed]


@part
def corrected(y, alpha, beta, kept, first):
    """Return h v after the reading y; kept[first:] holds p, h v."""
    ahead = kept[first] + kept[first + 1]
    error = y - ahead
    v = kept[first + 1] + beta * error
    kept[first] = ahead + alpha * error
    kept[first + 1] = v
    return v


def observer(moves: Floats, gains: Floats) -> Linear:
    """Return the equations of p, h v, .. corrected by gains (n,), which move by `moves` (n, n)."""
    kept: Floats = moves - gains[:, None] * moves[0]
    rest = np.zeros(gains.size)
    rest[0] = 1.0
    return Linear(kept, gains, kept[1], float(gains[1]), rest)


def _linear(settings: Settings) -> Linear:
    return observer(np.array([[1.0, 1.0], [0.0, 1.0]]), np.array(_numbers(settings)))


def _response(settings: Settings, z: Complexes) -> Complexes:
    alpha, beta = _numbers(settings)
    behind = 1.0 / z
    return beta / (1.0 - (2.0 - alpha - beta) * behind + (1.0 - alpha) * behind * behind)


kalman = Estimator(
    name="kalman",
    code=KALMAN,
    settings=("noise", "acceleration"),
    meaning="the steady Kalman filter of a constant velocity",
    reference="P. R. Kalata, IEEE Trans. Aerospace and Electronic Systems 20, 174, 1984",
    room=lambda settings: 2,
    numbers=_numbers,
    begin=_begin,
    linear=_linear,
    response=_response,
)

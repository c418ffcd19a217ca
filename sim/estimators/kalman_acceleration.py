"""The steady Kalman filter of a constant acceleration that is changed from period to period.

    p' = p + h v + h^2/2 a',   v' = v + h a',   a' = a + w,   y = p + e

with changes w of standard deviation q, and readings off by e of standard deviation r. In the steady
state it is the alpha-beta-gamma filter, with a = a^ + gamma / h^2 (y - p^). Its gains follow from
the tracking index lambda = q h^2 / r and one number u, from 0 to 1,

    u^3 = lambda/2 (1 - u) (2 - u),   alpha = u (2 - u),   beta = 2 u^2,   gamma = 2 u^3 / (2 - u),

which is the cubic of Gray and Murray in s = 1 - u, without its cancellation. It follows a constant
acceleration without error, where that of a constant velocity lags. Over the backward difference the
estimate has the response, with x = 1/z,

    (beta + (gamma - beta) x) / D,
    D = (1 - x)^3 + x (alpha (1 - x)^2 + beta (1 - x) + gamma (1 + x)/2) .

Limits: as `kalman.py`.

Reference: J. E. Gray, W. Murray, A derivation of an analytic expression for the tracking index for
the alpha-beta-gamma filter, IEEE Trans. Aerospace and Electronic Systems 29, 1064, 1993.
"""

# pyright: reportMissingParameterType=false, reportUnknownParameterType=false

from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq

from zwidth.sim.estimators.estimator import Complexes, Estimator, Linear, Settings
from zwidth.sim.estimators.kalman import observer
from zwidth.sim.jit import part

KALMAN_ACCELERATION = 5


def _numbers(settings: Settings) -> tuple[float, ...]:
    half = 0.5 * settings.acceleration * settings.period * settings.period / settings.noise
    u = float(brentq(lambda u: u**3 - half * (1.0 - u) * (2.0 - u), 0.0, 1.0, xtol=1e-300))
    return u * (2.0 - u), 2.0 * u * u, 2.0 * u**3 / (2.0 - u)


def _begin(settings: Settings, read: Callable[[int], float], speed: float) -> list[float]:
    return [read(1), settings.period * speed, 0.0]


@part
def corrected_with_acceleration(y, alpha, beta, gamma, kept, first):
    """Return h v after the reading y; kept[first:] holds p, h v, h^2 a."""
    p, v, a = kept[first], kept[first + 1], kept[first + 2]
    ahead = p + v + 0.5 * a
    error = y - ahead
    v = v + a + beta * error
    kept[first] = ahead + alpha * error
    kept[first + 1] = v
    kept[first + 2] = a + gamma * error
    return v


def _linear(settings: Settings) -> Linear:
    moves = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    return observer(moves, np.array(_numbers(settings)))


def _response(settings: Settings, z: Complexes) -> Complexes:
    alpha, beta, gamma = _numbers(settings)
    behind = 1.0 / z
    less = 1.0 - behind
    whole = less**3 + behind * (alpha * less**2 + beta * less + 0.5 * gamma * (1.0 + behind))
    return (beta + (gamma - beta) * behind) / whole


kalman_acceleration = Estimator(
    name="kalman_acceleration",
    code=KALMAN_ACCELERATION,
    settings=("noise", "acceleration"),
    meaning="the steady Kalman filter of a constant acceleration",
    reference="J. E. Gray, W. Murray, IEEE Trans. Aerospace and Electronic Systems 29, 1064, 1993",
    room=lambda settings: 3,
    numbers=_numbers,
    begin=_begin,
    linear=_linear,
    response=_response,
)

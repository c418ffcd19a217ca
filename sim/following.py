"""How a filtered reading follows a motion: the equations of the reading and of its rate.

From a motion q with speed v, the reading s and its rate g = s' follow by

    s' = rate (q - s) + straight g,        g' = rate (v - g) + square (q - s) - damping g,

first order with rate = 1 / T, second order with straight = 1, square = w^2, damping = 2 zeta w. At
a steady speed the reading lags by v L, with L = T or 2 zeta / w.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Number = float | NDArray[np.float64]
FASTEST = 1e-7  # s, below which a filter has no effect


class Following(NamedTuple):
    """Rates [1/s], [1/s^2], [1/s] of the equations above; straight is 0 or 1. For many, (...)."""

    rate: Number
    straight: float
    square: Number
    damping: Number


def first_order(time_constant: Number) -> Following:
    """Return the equations of T s' = q - s; T [s]."""
    return Following(1.0 / np.maximum(time_constant, FASTEST), 0.0, 0.0, 0.0)


def second_order(time_constant: Number, damping: Number) -> Following:
    """Return the equations of T^2 s'' + 2 zeta T s' + s = q; T [s] is 1 / (2 pi f)."""
    rate = 1.0 / np.maximum(time_constant, FASTEST)
    return Following(0.0, 1.0, rate * rate, 2.0 * damping * rate)

"""Filters of several outputs at once: w_t = sum_j W_j e_(t-j), of many members in one call."""

# pyright: reportMissingParameterType=false, reportUnknownParameterType=false

import math

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.jit import jit

Floats = NDArray[np.float64]


def filtered(errors: Floats, filters: Floats) -> Floats:
    """Return errors (..., ticks, o) through filters (o, o, taps); before the first all is zero.

    The first index of the filters is that of the output. Infinite values stay in their own member.
    """
    whole = errors.reshape(math.prod(errors.shape[:-2]), *errors.shape[-2:])
    rows = np.ascontiguousarray(np.swapaxes(whole, 1, 2))
    found = np.zeros_like(rows)
    _filter(rows, np.ascontiguousarray(filters), found)
    return np.ascontiguousarray(np.swapaxes(found, 1, 2)).reshape(errors.shape)


@jit
def _filter(rows, filters, found):
    """Add rows (members, o, ticks), delayed and weighed, to found, of the same shape."""
    members, outputs, ticks = rows.shape
    for m in range(members):
        for a in range(outputs):
            for b in range(outputs):
                for j in range(filters.shape[2]):
                    weight = filters[a, b, j]
                    if weight != 0.0:
                        for t in range(j, ticks):
                            found[m, a, t] += weight * rows[m, b, t - j]

"""Rounding to steps, the same for encoder and converter."""

import math

import numpy as np

from zwidth.sim.jit import part


@part
def to_nearest(value, step):
    """Round to the nearest multiple of step > 0, ties away from zero."""
    count = np.floor(abs(value) / step + 0.5)  # not math.floor: that is an integer, and overflows
    return math.copysign(step * count, value)

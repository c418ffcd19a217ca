"""Rounding to steps, the same for encoder and converter."""

import math

from sim.jit import part


@part
def to_nearest(value, step):
    """Round to the nearest multiple of step > 0, ties away from zero."""
    count = math.floor(abs(value) / step + 0.5)
    return math.copysign(step * count, value)

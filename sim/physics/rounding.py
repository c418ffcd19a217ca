"""Rounding to steps, the same for encoder and converter."""

from zwidth.sim.jit import part
from zwidth.sim.lane_type import floor, signed


@part
def to_nearest(value, step):
    """Round to the nearest multiple of step > 0, ties away from zero."""
    return signed(step * floor(abs(value) / step + 0.5), value)

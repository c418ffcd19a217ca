# pyright: reportMissingParameterType=false, reportUnknownParameterType=false
"""Which estimator makes the velocity: the compiled choice among the files beside this one."""

from zwidth.sim.estimators.foaw import FOAW, FOAW_END, windowed
from zwidth.sim.estimators.kalman import KALMAN, corrected
from zwidth.sim.estimators.kalman_acceleration import corrected_with_acceleration
from zwidth.sim.estimators.levant import LEVANT, slid
from zwidth.sim.jit import part


@part
def slope_of(code, window, numbers, count, y, kept, first):
    """Return the estimate times its period, of any estimator but the backward difference.

    numbers: of its step; count: of estimates before; kept[first:]: its memory, changed in place.
    """
    if code in (FOAW, FOAW_END):
        return windowed(code == FOAW, window, count, y, numbers[0], kept, first)
    if code == LEVANT:
        return slid(y, numbers[0], numbers[1], kept, first)
    if code == KALMAN:
        return corrected(y, numbers[0], numbers[1], kept, first)
    return corrected_with_acceleration(y, numbers[0], numbers[1], numbers[2], kept, first)

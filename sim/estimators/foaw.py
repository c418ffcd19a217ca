"""First-order adaptive windowing: the longest straight line that the last readings allow.

Of the lines through the last reading y_k, with n readings before it, one fits if it passes all of
them within a band d,

    |y_{k-i} - (y_k - i h b_n)| <= d    for i = 1 .. n,

and the estimate is b_n for the largest n, up to the window N, to which all shorter ones fit too.
The line is that of the ends, b_n = (y_k - y_{k-n}) / (n h), or that of least squares,

    b_n = 6 (n sum_i y_{k-i} - 2 sum_i i y_{k-i}) / (h n (n + 1) (n + 2)),    i = 0 .. n.

With n = 1 it is the backward difference, which always fits. The slopes that pass a reading form an
interval, (y_k - y_{k-i} -+ d) / (i h), so that of n readings is the intersection, and each n costs
the same.

At a constant velocity an encoder of step D errs by up to D / (N h), N times less than the
difference; where the velocity changes the window closes. d must be D for that: the line passes
through a reading that is itself off by up to D / 2, with others off by as much the other way.

Limits: what a line does not fit within d for two periods is the difference again. As gain and delay
depend on the motion it has no response in z.

Reference: F. Janabi-Sharifi, V. Hayward, C.-S. J. Chen, Discrete-time adaptive windowing for
velocity estimation, IEEE Trans. Control Systems Technology 8, 1003, 2000.
"""

# pyright: reportMissingParameterType=false, reportUnknownParameterType=false

from collections.abc import Callable

from zwidth.sim.estimators.estimator import Estimator, Settings
from zwidth.sim.jit import part
from zwidth.sim.lane_type import any_lane, greatest, least, select

FOAW, FOAW_END = 1, 2
MOST_WINDOW = 64
ROUNDING = 1e-6  # of the band: readings at its very edge are within it, whatever their last bits


def _numbers(settings: Settings) -> tuple[float, ...]:
    return (settings.band * (1.0 + ROUNDING),)


def _begin(settings: Settings, read: Callable[[int], float], _: float) -> list[float]:
    """The ring of the last N readings, that of n periods ago at place -n modulo N."""
    return [read(settings.window - place) for place in range(settings.window)]


@part
def windowed(best, window, count, y, band, ring, first):
    """Return the slope a period of the longest line that fits; ring[first:] the last readings.

    count: of estimates before this one; the reading y takes its place in the ring afterwards.
    """
    slope = y - ring[first + (count + window - 1) % window]
    low, high = slope - band, slope + band
    found = slope
    total = weighted = -slope
    fits = slope == slope
    for n in range(2, window + 1):
        back, m = ring[first + (count + window - n) % window] - y, 1.0 * n
        low = greatest(low, (-back - band) / m)
        high = least(high, (-back + band) / m)
        if best:
            total = total + back
            weighted = weighted + m * back
            slope = 6.0 * (m * total - 2.0 * weighted) / (m * (m + 1.0) * (m + 2.0))
        else:
            slope = -back / m
        fits = fits & (low <= slope) & (slope <= high)
        if not any_lane(fits):
            break
        found = select(fits, slope, found)
    ring[first + count % window] = y
    return found


def _of(name: str, code: int, line: str) -> Estimator:
    return Estimator(
        name=name,
        code=code,
        settings=("window", "band"),
        meaning=f"the longest straight line within a band of the last readings, {line}",
        reference="F. Janabi-Sharifi, V. Hayward, C.-S. J. Chen, IEEE Trans. Control Systems"
        " Technology 8, 1003, 2000",
        room=lambda settings: settings.window,
        numbers=_numbers,
        begin=_begin,
        may_be_zero=("band",),
    )


foaw = _of("foaw", FOAW, "of least squares (FOAW, best fit)")
foaw_end = _of("foaw_end", FOAW_END, "through its ends (FOAW, end fit)")

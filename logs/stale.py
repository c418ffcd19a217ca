"""Readings that repeat the one before because no new one was there.

There are two kinds. A sensor that is read more slowly than the log is written repeats every reading
equally often: its value then changes only at every h-th sample, unlike any motion. A reading may
also be late only sometimes: while a position moves by several steps per sample, more than noise
could cancel, two values that are equal to the last digit are one reading. But an uneven motion may
by chance not move in a sample, as often as it moves by one step, or by two. So there must be more
equal readings than that.

A recording of the first kind is refused, with the rate to use instead; the second is corrected by a
spline through the new readings.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.special import pdtrc

from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
SLOWEST = 100  # most samples for which a sensor repeats a reading
TOGETHER = 0.99  # share of the changes that are at every h-th sample
ENOUGH = 50  # least changes for such a statement
AROUND = 8  # samples on each side that determine the speed of a position
RUNS = 4.0  # steps or noise deviations per sample, above which equal readings are one
MOST = 0.3  # largest share of repeated readings that a spline may replace
CHANCE = 1e-4  # probability of equally many equal readings by chance


def repeated(values: Floats) -> int:
    """Return for how many samples each reading (samples,) is repeated; 1 if each is new."""
    changes = np.flatnonzero(np.diff(values) != 0.0) + 1
    if changes.size < ENOUGH or changes.size > 0.6 * values.size:
        return 1
    for h in range(min(SLOWEST, values.size // ENOUGH), 1, -1):
        if np.bincount(changes % h).max() >= TOGETHER * changes.size:
            return h
    return 1


def renewed(trace: Trace, positions: Sequence[str], name: str) -> tuple[Trace, str]:
    """Return a trace without stale readings of positions, and a sentence on them; "" if none."""
    channels, said = dict(trace.channels), list[str]()
    for channel in positions:
        stale = _stale(trace[channel])
        count = int(stale.sum())
        if count == 0 or count > MOST * len(trace):
            continue
        new, index = ~stale, np.arange(len(trace), dtype=np.float64)
        channels[channel] = trace[channel].copy()
        channels[channel][stale] = CubicSpline(index[new], trace[channel][new])(index[stale])
        first = trace.t[int(np.argmax(stale))]
        said.append(f"{count} of {len(trace)} readings of {channel}, the first at {first:.6g} s")
    if not said:
        return trace, ""
    return trace.with_channels(channels), (
        f"{' and '.join(said)}, of {name} repeat the one before while it moves: they are taken as"
        " stale, and filled in from the others"
    )


def _stale(values: Floats) -> NDArray[np.bool_]:
    """Which readings (samples,) are the one before once more."""
    stale = np.zeros(values.size, dtype=np.bool_)
    if values.size < 4 * AROUND:
        return stale
    steps = np.abs(np.diff(values))
    moved = steps[steps > 0.0]
    if moved.size == 0:
        return stale
    step = float(np.quantile(moved, 0.01))
    noise = float(np.median(np.abs(np.diff(values, 2))))
    wide = np.abs(values[2 * AROUND :] - values[: -2 * AROUND]) / (2 * AROUND)
    around = np.concatenate([np.zeros(AROUND), wide, np.zeros(AROUND)])
    least = RUNS * max(step, noise)
    runs = np.minimum(around, _across(values)) > least
    stale[1:] = (steps == 0.0) & runs[1:]
    # Changes up to `least` that are not zero take 2 least / s values, if s is the smallest change.
    small = int(np.sum(runs[1:] & (steps > 0.0) & (steps <= least)))
    by_chance = small * float(moved.min()) / (2.0 * least)
    equal = int(np.count_nonzero(stale))
    if equal and float(pdtrc(equal - 1, by_chance)) > CHANCE:  # probability of a Poisson count
        stale[:] = False
    return stale


def _across(values: Floats) -> Floats:
    """How fast (samples,) a position runs from before equal readings to after them, per sample.

    Where a mass sets out or turns, it is slower there than around.
    """
    firsts = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
    count = np.diff(firsts, append=values.size)
    jump = np.abs(np.diff(values[firsts], append=values[-1]))
    return np.repeat(jump / count, count)

"""Positions that jump where a counter or an angle starts again, made continuous.

    y_k - y_(k-1) = (q_k - q_(k-1)) - M or + M,    M the range of the counter, or a turn.

A wrap is distinguished from a motion by four signs: all such steps have the same size; before and
after it the motion continues at the same speed; all readings lie within M; and both ends and the
middle of M are visited, unlike for a single wrong reading or a switch. M is a turn if it agrees
with one to 1 %, else a power of two of the reading's steps if it agrees with this to 1 %, else the
mean of the steps.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zwidth.logs.steps import step_seen
from zwidth.logs.timing import times
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
FAR = 0.5  # of the range: least step from one end to the other
ALIKE = 0.02  # of M: largest difference of such steps
ON = 5.0  # steps of the neighbouring motion: largest change at a wrap
BESIDE = 4  # samples on each side that show the motion
VISITED = 0.02  # least share of the samples at each end of the range, and in the middle
NEAR = 0.01  # of M: tolerance for a turn or a power of two


def gone_on(raw: Floats, modulus: float) -> tuple[Floats, int]:
    """Return a counter (samples,) of known modulus without its wraps, and their number.

    Each step is the smallest possible one, less than half of the modulus; over a gap, that between
    the readings around it.
    """
    found, known = raw.copy(), np.isfinite(raw)
    found[known] = np.unwrap(raw[known], period=modulus)
    turns = np.diff(np.round((found[known] - raw[known]) / modulus))
    return found, int(np.count_nonzero(turns))


def unwrapped(trace: Trace, positions: Sequence[str], name: str) -> tuple[Trace, str]:
    """Return a trace with continuous positions, and a sentence on its wraps; "" for none."""
    said: list[str] = []
    channels = dict(trace.channels)
    for channel in positions:
        values = trace[channel]
        if (found := _wraps(values)) is None:
            continue
        at, size = found
        turns = np.zeros(values.size)
        turns[at + 1] = -np.sign(np.diff(values)[at])
        channels[channel] = values + size * np.cumsum(turns)
        unit = f" {trace.units[channel]}" if trace.units[channel] else ""
        said.append(f"{channel} of {name} starts again every {size:.6g}{unit}, {times(at.size)}")
    if not said:
        return trace, ""
    return trace.with_channels(channels), f"{'; '.join(said)}: it is continued"


def _wraps(values: Floats) -> tuple[NDArray[np.int64], float] | None:
    """The samples before which a position wraps, and M; None if it does not."""
    steps, span = np.diff(values), float(np.ptp(values))
    at = np.flatnonzero(np.abs(steps) > FAR * span)
    if at.size == 0:
        return None
    visits, _ = np.histogram(values, 3)
    if visits.min() < VISITED * values.size:
        return None
    usual = np.ma.masked_array(steps, np.isin(np.arange(steps.size), at))
    beside = [usual[max(0, k - BESIDE) : k + BESIDE + 1] for k in at.tolist()]
    pace = np.array([float(np.ma.median(b)) if b.count() else math.nan for b in beside])
    spread = np.array([float(np.ma.max(np.ma.abs(b))) if b.count() else math.nan for b in beside])
    sizes = np.abs(steps[at] - pace)
    size = float(np.mean(sizes))
    if not np.isfinite(size) or span > size * (1.0 + NEAR):
        return None
    goes_on = np.abs(sizes - size) <= ON * spread + ALIKE * size
    return (at, _meant(values, size)) if np.all(goes_on) else None


def _meant(values: Floats, size: float) -> float:
    """The exact range of a counter whose range seems to be `size`."""
    for turn in (2.0 * math.pi, math.pi):
        if abs(size / turn - 1.0) < NEAR:
            return turn
    step = step_seen(values)
    if step is not None:
        whole = 2.0 ** round(math.log2(size / step)) * step
        if abs(size / whole - 1.0) < NEAR:
            return whole
    return size

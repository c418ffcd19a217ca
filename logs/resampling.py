"""Brings streams onto one time axis, only on request.

A sensor's value is interpolated between the samples around the instant. A command is held: its
value is the last one given. Where the axis is coarser than the command's own period,
holding would skip commands, so its mean over each tick is taken, which has the same impulse.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

COARSER = 1.05  # axis period over stream period from which a command is averaged
MOST_SAMPLES = 1 << 28


def forward_only(t: Floats) -> NDArray[np.bool_]:
    """Return which stamps are later than all before them, (samples,)."""
    latest = np.maximum.accumulate(t)
    return np.concatenate(([True], t[1:] > latest[:-1]))


def axis(starts: list[float], stops: list[float], period: float) -> Floats:
    """Return the multiples of the period [s], from the latest start, that all streams cover.

    Raises ValueError if streams do not overlap, or the axis would be endless.
    """
    start, stop = max(starts), min(stops)
    if stop < start:
        raise ValueError(
            f"the streams do not overlap: one ends at {stop:.9g} s, another begins at {start:.9g}"
            " s; correct it with shift_s"
        )
    count = (stop - start) / period + 1e-6
    if count >= MOST_SAMPLES:
        raise ValueError(
            f"resample = {period:g} turns {stop - start:.6g} s into {count:.3g} samples; at most"
            f" {MOST_SAMPLES} are allowed"
        )
    return start + period * np.arange(int(count) + 1, dtype=np.float64)


def interpolated(at: Floats, t: Floats, values: Floats) -> Floats:
    """Return values at the instants, linear between samples; t rises strictly."""
    return np.interp(at, t, values).astype(np.float64, copy=False)


def held(at: Floats, t: Floats, values: Floats, period: float) -> Floats:
    """Return the command in force over each tick [at, at + period); t rises strictly.

    A stream finer than the ticks gives its mean, from the integral of the held signal.
    """
    # An instant that is below a stamp only by rounding counts as that stamp.
    last = np.searchsorted(t, at + 1e-9 * period, "right") - 1
    own = float(np.median(np.diff(t))) if t.size > 1 else period
    if period < COARSER * own:
        return values[np.maximum(last, 0)]
    integral = np.concatenate(([0.0], np.cumsum(values[:-1] * np.diff(t))))
    ends = np.concatenate((at, at[-1:] + period))
    before = np.clip(np.searchsorted(t, ends, "right") - 1, 0, t.size - 1)
    until = integral[before] + values[before] * (ends - t[before])
    return np.diff(until) / period

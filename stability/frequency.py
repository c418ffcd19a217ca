"""The frequency at which a run near the boundary oscillates.

Of all spectral peaks of m1's velocity in the last quarter of a run, the one that has grown most
since the second quarter: at the boundary every other mode has died down by then. Of those that have
grown alike, as the harmonics of a limit cycle do, it is the largest. A four-term
Blackman-Harris window keeps its sidelobes (-92 dB) below the peaks that are looked at, and a
parabola through the logarithm of three bins places the peak to about a hundredth of a bin.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len, rfft

Floats = NDArray[np.float64]
FLOOR = 1e-3  # amplitude of a peak over the largest one's
PADDING = 4
FEWEST_TICKS = 8  # of a quarter of a run
ALIKE = 0.95  # growth of a peak over that of the one that has grown most


@cache
def blackman_harris(size: int) -> Floats:
    """Return the four-term window (Harris, Proc. IEEE 66, 1978), periodic.

    scipy.signal has it too, and takes half a second to import.
    """
    phase = 2.0 * np.pi * np.arange(size) / size
    terms = (0.35875, -0.48829, 0.14128, -0.01168)
    return np.sum([a * np.cos(k * phase) for k, a in enumerate(terms)], axis=0)


def ultimate_frequencies(velocities: Floats, period: float) -> Floats:
    """Return the frequency [Hz] of the oscillation that has grown most in each run, (runs,).

    velocities (runs, ticks) at the sampling period [s], NaN after the end of a run that is shorter.
    NaN where nothing oscillates.
    """
    lengths = np.count_nonzero(~np.isnan(velocities), axis=1)
    found = np.full(lengths.size, np.nan)
    for length in np.unique(lengths):
        if length >= 4 * FEWEST_TICKS:
            some = lengths == length
            found[some] = _frequencies(velocities[some, :length]) / period
    return found


def _frequencies(velocities: Floats) -> Floats:
    """Cycles a tick of runs (runs, ticks) of one length."""
    quarter = velocities.shape[1] // 4
    size = next_fast_len(PADDING * quarter, real=True)
    parts = np.stack([velocities[:, quarter : 2 * quarter], velocities[:, -quarter:]])
    centred = parts - parts.mean(axis=2, keepdims=True)
    early, late = np.abs(rfft(centred * blackman_harris(quarter), size))
    inner = late[:, 1:-1]
    peak = (inner > late[:, :-2]) & (inner >= late[:, 2:])
    peak &= inner > FLOOR * late.max(axis=1, keepdims=True)
    growth = np.where(peak, inner / np.maximum(early[:, 1:-1], 1e-300), 0.0)
    alike = peak & (growth >= ALIKE * growth.max(axis=1, keepdims=True))
    best = 1 + np.argmax(np.where(alike, inner, 0.0), axis=1)
    runs = np.arange(best.size)
    with np.errstate(all="ignore"):  # without a peak there is no logarithm, and no frequency
        left, middle, right = (np.log(late[runs, best + i]) for i in (-1, 0, 1))
        offset = 0.5 * (left - right) / (left - 2.0 * middle + right)
    return np.where(peak.any(axis=1), (best + offset) / size, np.nan)

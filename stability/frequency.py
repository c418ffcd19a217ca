"""The frequency at which a run near the boundary oscillates.

On a linear device this is, of all spectral peaks of m1's velocity in the last quarter of a run, the
one that has grown most since the second quarter: at the boundary every other mode has died down by
then. If several have grown equally, as the harmonics of a limit cycle do, it is the largest of
them. A four-term Blackman-Harris window has sidelobes (-92 dB) below the peaks that are considered,
and a parabola through the logarithms of three bins locates the peak to about a hundredth of a bin.

With steps and friction this rule misleads: an encoder's steps make lines all over the spectrum,
which grow and fade while the oscillation itself hardly grows. There the run is followed until it is
known to grow or to cycle, and the largest peak at its end is used.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len, rfft

Floats = NDArray[np.float64]
FLOOR = 1e-3  # amplitude of a peak over the largest one's
PADDING = 4
FEWEST_TICKS = 8  # least ticks in a quarter of a run
PARTS = 8  # parts of the end of a run from which its growth is estimated
ALIKE = 0.95  # growth of a peak over the largest growth


@cache
def blackman_harris(size: int) -> Floats:
    """Return the four-term window (Harris, Proc. IEEE 66, 1978), periodic.

    scipy.signal has this window as well, but takes half a second to import.
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


def largest_frequencies(velocities: Floats, most: int, period: float) -> Floats:
    """Return the frequency [Hz] of the largest oscillation at the end of each run, (runs,).

    velocities (runs, ticks) at the sampling period [s], NaN where a run was not followed; most: the
    number of ticks at its end that are used. NaN where nothing oscillates.
    """
    found = np.full(velocities.shape[0], np.nan)
    for i, row in enumerate(velocities):
        end = row[~np.isnan(row)][-most:]
        if end.size >= 4 * FEWEST_TICKS:
            found[i] = _largest(end) / period
    return found


def _level(velocity: Floats) -> Floats:
    """Return a velocity (ticks,) without its exponential growth, which would blur every peak."""
    scaled = velocity / max(float(np.abs(velocity).max()), 1e-300)
    parts = np.array_split(scaled, PARTS)
    rms = np.log(np.sqrt([np.mean(part * part) + 1e-300 for part in parts]))
    slope, middle = np.polyfit(np.linspace(-0.5, 0.5, PARTS) * (1.0 - 1.0 / PARTS), rms, 1)
    time = (np.arange(velocity.size) + 0.5) / velocity.size - 0.5
    return scaled * np.exp(-slope * time - middle)


def _largest(velocity: Floats) -> float:
    """Cycles per tick of the largest peak of a velocity (ticks,), NaN without a peak."""
    size = next_fast_len(PADDING * velocity.size, real=True)
    level = _level(velocity)
    spectrum = np.abs(rfft((level - level.mean()) * blackman_harris(level.size), size))
    best = 1 + int(np.argmax(spectrum[1:-1]))
    if not spectrum[best - 1] < spectrum[best] >= spectrum[best + 1]:
        return np.nan
    left, middle, right = np.log(spectrum[best - 1 : best + 2])
    return (best + 0.5 * (left - right) / (left - 2.0 * middle + right)) / size


def _frequencies(velocities: Floats) -> Floats:
    """Cycles per tick of the peak that has grown most in each run (runs, ticks)."""
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

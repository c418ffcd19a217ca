"""What repeats over position or command: its period, by a spectrum over that quantity.

A force f_k (or an error of the sensor s_k) moves the weighted innovations r by F f, F the linear
response of observer and device. So with g = F' r, <r, F f> = <g, f>, and for a wave f = a cos(2 pi
q_k / period + phase) over a quantity q the chi-square gained is 2 |G|^2 / n with

    G(1 / period) = sum g_k exp(-2 pi i q_k / period),    n = |F exp(2 pi i q / period)|^2.

Under white r the expectation of |G|^2 is n, so the spectrum's own running median tells n. All
periods at once by one FFT over bins of q: it finds lattices of steps and waves that no list of
starting values would meet. Limits: what a refit absorbs is not taken off (it has long periods), and
r must be nearly white.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.signal import fftconvolve

from diagnosis.fit import Fitted, Problem
from diagnosis.predictor import SETTLING, innovations, prepared

Floats = NDArray[np.float64]
LONGEST = 2000  # ticks of response kept
MEDIAN = 201  # lines of the running median that stands for the noise
MEDIAN_OF_EXPONENTIAL = float(np.log(2.0))


@dataclass(frozen=True)
class Peak:
    """A wave over a quantity: period, and the chi-square that it would gain, about."""

    period: float
    gained: float


def response(problem: Problem, fitted: Fitted, place: str) -> Floats:
    """Return the weighted innovations (ticks, o) after a unit at "m1".., "command" or "sensor".

    The response is that of the device without its nonlinear physics.
    """
    device = fitted.model.acting(fitted.x)
    device = device.without_physics() if device.physics else device
    first = problem.experiments[0]
    length = min(LONGEST, first.ticks)
    command, measured = np.zeros(length), np.zeros((length, len(first.outputs)))
    ready = prepared(device)
    force = np.zeros((length, ready.coarse.dof))
    if place == "command":
        command[0] = 1.0
    elif place == "sensor":
        measured[0, 0] = 1.0
    else:
        force[0, int(place[1]) - 1] = 1.0
    still = replace(
        first, command=command, measured=measured, sensor_error=None, dropped=None, start=None
    )
    answer = innovations(device, still, problem.observer.gain, force, ready)
    return problem.observer.weigh(answer)


def matched(problem: Problem, fitted: Fitted, place: str) -> list[Floats]:
    """Return g (ticks,) of every experiment for what enters at a place, as in `response`."""
    answer = response(problem, fitted, place)
    found: list[Floats] = []
    first = 0
    for e in problem.experiments:
        white = np.zeros((e.ticks, len(e.outputs)))
        last = first + (e.ticks - SETTLING) * len(e.outputs)
        white[SETTLING:] = fitted.white[first:last].reshape(-1, len(e.outputs))
        first = last
        g = np.zeros(e.ticks)
        for o in range(white.shape[1]):
            g += fftconvolve(white[::-1, o], answer[:, o])[: e.ticks][::-1]
        found.append(g)
    return found


def peaks(
    pulls: list[Floats], over: list[Floats], finest: float, count: int = 3
) -> tuple[list[Peak], int]:
    """Return the strongest waves over a quantity with periods above `finest`, and lines looked at.

    pulls: `matched`; over: the quantity at every tick, as long. A wave is seen at least twice.
    """
    low = min(float(q.min()) for q in over)
    span = max(float(q.max()) for q in over) - low
    if not span > 4.0 * finest:
        return [], 0
    bins = 1 << int(np.ceil(np.log2(4.0 * span / finest)))
    total = np.zeros(bins)
    for g, q in zip(pulls, over, strict=True):
        index = np.minimum(((q - low) / span * (bins // 2)).astype(np.int64), bins - 1)
        total += np.bincount(index, g, bins)
    power = np.abs(np.fft.rfft(total)) ** 2  # lines at k / (2 span)
    lines = np.arange(power.size)
    usable = (lines >= 4) & (lines <= 2.0 * span / finest)
    level = median_filter(power, min(MEDIAN, power.size), mode="nearest") / MEDIAN_OF_EXPONENTIAL
    gained = np.where(usable & (level > 0.0), 2.0 * power / np.where(level > 0.0, level, 1.0), 0.0)
    found: list[Peak] = []
    for _ in range(count):
        k = int(np.argmax(gained))
        if gained[k] <= 0.0:
            break
        found.append(Peak(2.0 * span / k, float(gained[k])))
        gained[max(0, k - 3) : k + 4] = 0.0
    return found, int(np.count_nonzero(usable))

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

from sim.controller import Controller
from sim.equations import Equations
from sim.kernel import advance, scratch
from sim.run import Start, start_memory

Floats = NDArray[np.float64]
FLOOR = 1e-3  # amplitude of a peak over the largest one's
PADDING = 4
ALIKE = 0.95  # growth of a peak over that of the one that has grown most


@cache
def blackman_harris(size: int) -> Floats:
    """Return the four-term window (Harris, Proc. IEEE 66, 1978), periodic.

    scipy.signal has it too, and takes half a second to import.
    """
    phase = 2.0 * np.pi * np.arange(size) / size
    terms = (0.35875, -0.48829, 0.14128, -0.01168)
    return np.sum([a * np.cos(k * phase) for k, a in enumerate(terms)], axis=0)


def blank_record(eq: Equations, seconds: float) -> Floats:
    """Return the room for the record of a run of that length, to be used again and again."""
    return np.zeros((round(seconds / eq.period), eq.states + 6))


def velocity_record(
    eq: Equations, controller: Controller, start: Start, bound: float, record: Floats
) -> Floats:
    """Return the velocity of m1 at every tick of a run, up to where it left the bound.

    record: from `blank_record`; the result is a view of it.
    """
    done, _ = advance(
        eq, controller.step, controller.parameters, start_memory(eq, controller, start, 0),
        scratch(eq), record.shape[0], np.zeros((0, eq.dof)), bound, record,
        np.zeros((0, eq.states)), False,
    )  # fmt: skip
    return record[:done, eq.dof]


def ultimate_frequency(velocity: Floats, period: float) -> float:
    """Return the frequency [Hz] of the oscillation that has grown most, NaN where there is none.

    velocity (ticks,) at the sampling period [s].
    """
    quarter = velocity.size // 4
    if quarter < 8 or not np.any(velocity):
        return float("nan")
    window = blackman_harris(quarter)
    size = next_fast_len(PADDING * quarter, real=True)
    parts = np.stack([velocity[quarter : 2 * quarter], velocity[-quarter:]])
    early, late = np.abs(rfft((parts - parts.mean(axis=1)[:, None]) * window, size))
    inner = np.arange(1, late.size - 1)
    peaks = inner[(late[inner] > late[inner - 1]) & (late[inner] >= late[inner + 1])]
    peaks = peaks[late[peaks] > FLOOR * late.max()]
    if peaks.size == 0:
        return float("nan")
    growth = late[peaks] / np.maximum(early[peaks], 1e-300)
    alike = peaks[growth >= ALIKE * growth.max()]
    best = alike[np.argmax(late[alike])]
    left, middle, right = np.log(late[best - 1 : best + 2])
    offset = 0.5 * (left - right) / (left - 2.0 * middle + right)
    return float((best + offset) / (size * period))

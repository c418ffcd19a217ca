"""The frequency at which a run near the boundary oscillates.

Of all spectral peaks of m1's velocity in the last quarter of a run, the one that has grown most
since the second quarter: at the boundary every other mode has died down by then. A four-term
Blackman-Harris window keeps its sidelobes (-92 dB) below the peaks that are looked at, and a
parabola through the logarithm of three bins places the peak to about a hundredth of a bin.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len, rfft
from scipy.signal.windows import blackmanharris

from sim.controller import Controller
from sim.equations import Equations
from sim.kernel import advance, scratch
from sim.run import Start, start_memory

Floats = NDArray[np.float64]
FLOOR = 1e-3  # amplitude of a peak over the largest one's
PADDING = 4


def velocity_record(
    eq: Equations, controller: Controller, start: Start, seconds: float, bound: float
) -> Floats:
    """Return the velocity of m1 at every tick of a run, up to where it left the bound."""
    ticks = round(seconds / eq.period)
    record = np.zeros((ticks, eq.states + 6))
    done, _ = advance(
        eq, controller.step, controller.parameters, start_memory(eq, controller, start, 0),
        scratch(eq), ticks, np.zeros((0, eq.dof)), bound, record, np.zeros((0, eq.states)), False,
    )  # fmt: skip
    return record[:done, eq.dof]


def ultimate_frequency(velocity: Floats, period: float) -> float:
    """Return the frequency [Hz] of the oscillation that has grown most, NaN where there is none.

    velocity (ticks,) at the sampling period [s].
    """
    quarter = velocity.size // 4
    if quarter < 8 or not np.any(velocity):
        return float("nan")
    window = blackmanharris(quarter)
    size = next_fast_len(PADDING * quarter, real=True)
    parts = np.stack([velocity[quarter : 2 * quarter], velocity[-quarter:]])
    early, late = np.abs(rfft((parts - parts.mean(axis=1)[:, None]) * window, size))
    inner = np.arange(1, late.size - 1)
    peaks = inner[(late[inner] > late[inner - 1]) & (late[inner] >= late[inner + 1])]
    peaks = peaks[late[peaks] > FLOOR * late.max()]
    if peaks.size == 0:
        return float("nan")
    best = peaks[np.argmax(late[peaks] / np.maximum(early[peaks], 1e-300))]
    left, middle, right = np.log(late[best - 1 : best + 2])
    offset = 0.5 * (left - right) / (left - 2.0 * middle + right)
    return float((best + offset) / (size * period))

"""A command that was not held from sample to sample, but smooth between them.

A controller holds its command. A command recorded by other equipment is often a sample of a smooth,
band-limited signal u(t). Holding the samples then delays it by half a tick and reduces its
amplitude by sinc(f T). The held values that act like u(t) in the band are

    c = F^-1[ U(f) exp(+i pi f T) / sinc(f T) ].
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def held_for(u: Floats) -> Floats:
    """Return the command (ticks,) whose hold acts like the smooth signal with the samples u."""
    if u.size < 2:
        return u
    line = np.linspace(u[0], u[-1], u.size)
    slope = (u[-1] - u[0]) / (u.size - 1)
    frequency = np.fft.rfftfreq(u.size)
    turned = np.fft.rfft(u - line) * np.exp(1j * np.pi * frequency) / np.sinc(frequency)
    return np.fft.irfft(turned, u.size) + line + 0.5 * slope

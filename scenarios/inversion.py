"""A measured value of the sampled plant, computed from a critical oscillation.

Where a wall (K, B) sustains an oscillation of frequency f, 1 + z^-d (K + B w) Z[H G] = 0, so

    Z[H G](z) = -z^d / (K + B w),    z = exp(2 pi j f T),    w = (1 - 1/z) / T.

Limit: the delay is d whole periods, and the velocity a backward difference.
"""

from typing import NamedTuple, Protocol

import numpy as np

from zwidth.sim.modal import ModalModel
from zwidth.sim.sampled import sampled_frequency_response


class Row(Protocol):
    """A critical oscillation: delay [s], B, K in the device's units, frequency [Hz]."""

    @property
    def delay(self) -> float:
        """Delay of the loop [s]."""
        ...

    @property
    def damping(self) -> float:
        """Virtual damping B."""
        ...

    @property
    def stiffness(self) -> float:
        """Critical stiffness K."""
        ...

    @property
    def frequency(self) -> float:
        """Ultimate frequency [Hz]."""
        ...


class Inverted(NamedTuple):
    """The plant measured by a row, at its frequency.

    rate: 2 pi f [rad/s]; delayed: z^d; velocity: w [1/s]; model: the wall K + B w that the model of
    the plant needs for this oscillation.
    """

    rate: float
    delayed: complex
    velocity: complex
    model: complex

    def ratio(self, stiffness: float, damping: float) -> complex:
        """Return measured plant over model for the wall of the row."""
        return self.model / (stiffness + damping * self.velocity)

    def excess_damping(self, stiffness: float, damping: float) -> float:
        """Return the damper to ground by which the measured plant exceeds the model."""
        wall = stiffness + damping * self.velocity
        return ((self.model - wall) / self.delayed / self.rate).imag


def inverted(row: Row, model: ModalModel, period: float) -> Inverted:
    """Return the plant that a row measures, with the model's."""
    rate = 2.0 * np.pi * row.frequency
    z = complex(np.exp(1j * rate * period))
    delayed = z ** round(row.delay / period)
    plant = complex(sampled_frequency_response(model, period, row.frequency))
    return Inverted(rate, delayed, (1.0 - 1.0 / z) / period, -delayed / plant)

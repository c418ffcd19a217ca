"""A weighted least-squares problem: measured H1 minus H1 of a model, and its covariance by noise.

The free motion (unknown start, constant force) is projected out of error and derivative.

Let g_p be the estimator's row for parameter p, dp = Re sum g_p conj(dH). Since dH is linear in the
output's noise (`identification/response.py`), dp = sum_t c_p(t) n(t) with c_p the adjoint of g_p,
and cov(p, q) = sum_f conj(C_p) C_q S_n(f) / N for noise of spectrum S_n. Overlap, taper and
neighbouring bins are thereby accounted for exactly, to first order in the parameters. Limits: the
command is assumed exact and the noise stationary; physics that the model lacks biases the result.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from zwidth.identification.coordinates import Coordinates
from zwidth.identification.prediction import Predicted, free_motion, predict
from zwidth.identification.response import FrequencyResponse

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
MOST_STEPS = 60


class Data(NamedTuple):
    """Data common to all fits of a recording: command and output (ticks,), and their H1."""

    command: Floats
    output: Floats
    measured: FrequencyResponse


class Problem:
    """The error at given coordinates in units of its standard deviation, real parts first.

    start: the coordinates whose free motion is projected out; variance (bins,) of H1.
    """

    def __init__(
        self, data: Data, coordinates: Coordinates, start: Floats, variance: Floats
    ) -> None:
        self.data, self.coordinates = data, coordinates
        self.windows = data.measured.windows
        self.weight = 1.0 / np.sqrt(variance)
        free = free_motion(start, coordinates, data.output.size, self.windows)
        self.basis = np.linalg.qr(_stacked(free * self.weight[:, None]))[0]
        self._known: tuple[bytes, Predicted] | None = None

    def error(self, x: Floats) -> Floats:
        """Return the weighted error, (2 bins,)."""
        left = self._predicted(x).response - self.data.measured.value
        return self._projected(_stacked(left * self.weight))

    def slope(self, x: Floats) -> Floats:
        """Return the derivative of the error, (2 bins, coordinates)."""
        return self._projected(_stacked(self._predicted(x).slope * self.weight[:, None]))

    def left(self, x: Floats) -> Complexes:
        """Return measured H1 minus model and free motion, (bins,), unweighted."""
        bins = self.weight.size
        error = self.error(x)
        return -(error[:bins] + 1j * error[bins:]) / self.weight

    def minimised(self, x: Floats, tolerance: float) -> Floats:
        """Return coordinates of least squared error; tolerance: relative, of that error."""
        return least_squares(
            self.error, x, jac=self.slope,  # pyright: ignore[reportArgumentType]
            method="trf", x_scale="jac",
            bounds=self.coordinates.bounds(x), ftol=tolerance, xtol=1e-12, gtol=1e-12,
            max_nfev=MOST_STEPS,
        ).x  # fmt: skip

    def covariance(self, x: Floats, spectrum: Floats) -> Floats:
        """Return the covariance (p, p) of ln(parameter), but of the delay [s] itself.

        spectrum: E|N(k)|^2 / samples of the output's noise at the bins of rfft(samples).
        """
        bins, samples = self.weight.size, self.data.output.size
        rows = self.coordinates.slope(x) @ np.linalg.pinv(self.slope(x))
        weights = (rows[:, :bins] + 1j * rows[:, bins:]) * self.weight
        shapes = np.array([np.fft.rfft(self.windows.adjoint(g, samples)) for g in weights])
        twice = np.full(shapes.shape[1], 2.0)
        twice[0] = 1.0
        return np.real((np.conj(shapes) * (spectrum * twice)) @ shapes.T) / samples

    def _predicted(self, x: Floats) -> Predicted:
        """Return the model's H1 and derivative, cached for the next call at the same point."""
        key = x.tobytes()
        if self._known is None or self._known[0] != key:
            self._known = key, predict(x, self.coordinates, self.data.command, self.windows)
        return self._known[1]

    def _projected(self, values: Floats) -> Floats:
        return values - self.basis @ (self.basis.T @ values)


def _stacked(values: Complexes) -> Floats:
    return np.concatenate([values.real, values.imag])

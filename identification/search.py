"""The search for a fit: starting values and noise are both estimated from the data.

The first variance of H1 comes from the coherence. It is too large at low frequencies, where leakage
counts as noise, but independent of any model. Then, twice, the variance is computed from the noise
spectrum in the last fit's residual. If noise does not explain the error of a fit, other starts are
tried. If none is better, the model is wrong, and its own error counts as variance, so that the fit
is a compromise over the band.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.identification.coordinates import Coordinates
from zwidth.identification.noise import noise_spectrum
from zwidth.identification.output import position
from zwidth.identification.prediction import free_signals
from zwidth.identification.problem import Data, Problem
from zwidth.identification.start import moved, starting_model

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
REJECTED = 1.5  # misfit above which noise does not explain the error of a fit
ROUNDS = 3  # rounds in which a wrong model's error becomes its variance
BETTER = 0.9  # ratio of errors after and before a mode was moved that counts as progress
COARSE, FINE = 1e-4, 1e-9  # least relative gain of a step in the squared error
SMOOTHED = 25  # bins over which squares are averaged into a variance
DELAYS = (0, 1, 2, 3, 4, 6, 8, 12, 16)  # periods at which an unknown delay is started


@dataclass(frozen=True)
class Found:
    """The result of a search.

    spectrum: of the output's noise at the bins of rfft(samples); noise (bins,): variance of H1 by
    this noise; left (bins,): measured minus fitted H1.
    """

    x: Floats
    problem: Problem
    spectrum: Floats
    noise: Floats
    left: Complexes

    @property
    def misfit(self) -> float:
        """Mean squared error over the noise's variance, near 1 if the model is right."""
        return float(np.mean(np.abs(self.left) ** 2 / self.noise))


class Search:
    """The search for the best coordinates of one recording."""

    def __init__(self, data: Data, coordinates: Coordinates) -> None:
        self.data, self.coordinates = data, coordinates
        self.windows = data.measured.windows
        coherence = np.clip(data.measured.coherence, 1e-6, 1.0 - 1e-9)
        self.rough = smoothed(np.abs(data.measured.value) ** 2 * (1.0 / coherence - 1.0))

    def run(self) -> Found:
        """Return the best fit."""
        x = self._minimised(self._start(), self.rough, COARSE)
        found = self._refined(x)
        for _ in range(self.coordinates.modes):
            if found.misfit <= REJECTED:
                return found
            better = self._moved(x)
            if better is None:
                break
            x, found = better, self._refined(better)
        return found if found.misfit <= REJECTED else self._compromise(x)

    def _start(self) -> Floats:
        measured, period = self.data.measured, self.coordinates.period
        known = self.coordinates.delay
        delays = [period * d for d in DELAYS] if known is None else [known]
        starts = [
            starting_model(
                measured.frequency_hz, measured.value, 1.0 / np.sqrt(self.rough),
                self.coordinates.modes, period, delay,
            )
            for delay in delays
        ]  # fmt: skip
        points = [self.coordinates.of(*pair) for pair in zip(starts, delays, strict=True)]
        if len(points) == 1:
            return points[0]
        return min(points, key=lambda x: self._cost(x))

    def _cost(self, x: Floats) -> float:
        error = Problem(self.data, self.coordinates, x, self.rough).error(x)
        return float(error @ error)

    def _minimised(self, x: Floats, variance: Floats, tolerance: float) -> Floats:
        return Problem(self.data, self.coordinates, x, variance).minimised(x, tolerance)

    def _refined(self, x: Floats) -> Found:
        """Fit repeatedly, each time with the variance of the noise in the last fit's residual."""
        found = self._judged(x, self.rough)
        for tolerance in (COARSE, FINE):
            x = self._minimised(found.x, found.noise, tolerance)
            found = self._judged(x, found.noise)
        return found

    def _moved(self, x: Floats) -> Floats | None:
        """Move the mode with the least effect to the largest error; None if that is worse."""
        left = Problem(self.data, self.coordinates, x, self.rough).left(x)
        error = smoothed(np.abs(left) ** 2 / self.rough)
        model, delay = self.coordinates.model(x)
        omega = 2.0 * np.pi * float(self.windows.frequencies[np.argmax(error)])
        start = self.coordinates.of(moved(model, omega), delay)
        again = self._minimised(start, self.rough, COARSE)
        return again if self._cost(again) < BETTER * self._cost(x) else None

    def _compromise(self, x: Floats) -> Found:
        """Fit with the error of the model counted as variance."""
        found = self._judged(x, self.rough)
        for _ in range(ROUNDS):
            variance = found.noise + smoothed(np.abs(found.left) ** 2)
            found = self._judged(self._minimised(found.x, variance, FINE), variance)
        return found

    def _rest(self, residual: Floats, x: Floats) -> Floats:
        """Return the residual without free motion and mean."""
        free = free_signals(x, self.coordinates, residual.size)
        basis = np.linalg.qr(np.column_stack([np.ones(residual.size), free]))[0]
        return residual - basis @ (basis.T @ residual)

    def _judged(self, x: Floats, variance: Floats) -> Found:
        """Return the error of a fit, and the noise in it."""
        problem = Problem(self.data, self.coordinates, x, variance)
        command, period = self.data.command, self.windows.period
        fitted = position(*self.coordinates.model(x), command, period)
        residual = self._rest(self.data.output - fitted, x)
        band = self.windows.frequencies
        spectrum = noise_spectrum(command, residual, period, float(band[0]), float(band[-1]))
        noise = np.interp(band, np.fft.rfftfreq(residual.size, period), spectrum)
        return Found(x, problem, spectrum, noise * self.windows.noise_gain(), problem.left(x))


def smoothed(values: Floats, width: int = SMOOTHED) -> Floats:
    """Return the running mean over bins, shorter at the ends."""
    kernel = np.ones(min(width, values.size))
    return np.convolve(values, kernel, "same") / np.convolve(np.ones(values.size), kernel, "same")

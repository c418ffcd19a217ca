"""The ten parameters of eq. (1) from a frequency response, with intervals that hold.

The model's response is computed as the data's: simulate the position under the recorded command,
put it through the same windows. Leakage is then in both and cancels. Weighted least squares,
minimising sum |H1 - H1_model|^2 / var(H1), over logarithms of all parameters in an order that keeps
the modes stable and interlacing (v1 < w1 < v2 < w2 < ...).

Let g_p be the estimator's row for parameter p, dp = Re sum g_p conj(dH). Since dH is linear in the
output's noise (`identification/response.py`), dp = sum_t c_p(t) n(t) with c_p the adjoint of g_p, and
cov(p, q) = sum_f conj(C_p) C_q S_n(f) / N for noise of spectrum S_n, estimated from the residual in
time. Overlap, taper and neighbouring bins are thereby accounted for exactly, to first order in the
parameters. Limits: the command is known without error, and the noise is stationary.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import welch

from identification.output import position
from identification.response import FrequencyResponse, RecordingError, Windows, frequency_response
from identification.start import starting_model
from sim.modal import Mode, ModalModel
from sim.trace import Trace

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
MAX_MODES = 3
MIN_COHERENCE = 0.5
ROUNDS = 3
STEP = 1e-6  # of a logarithm, for differences
Z95 = 1.959963984540054


@dataclass(frozen=True)
class Fit:
    """A fitted modal model.

    covariance (p, p) of the natural logarithms of `names`; misfit: sum of squared errors over their
    variances; bins: how many complex numbers were fitted; noise_rms of the output [rad | m].
    """

    model: ModalModel
    names: tuple[str, ...]
    covariance: Floats
    misfit: float
    bins: int
    noise_rms: float
    response: FrequencyResponse
    fitted: Complexes

    @property
    def values(self) -> Floats:
        """The parameters in the order of `names`."""
        return model_vector(self.model)

    def intervals(self) -> dict[str, tuple[float, float, float]]:
        """Return name -> (value, lower, upper) at 95 %, symmetric in the logarithm."""
        spread = np.exp(Z95 * np.sqrt(np.diag(self.covariance)))
        rows = zip(self.names, self.values, spread, strict=True)
        return {name: (float(v), float(v / s), float(v * s)) for name, v, s in rows}


def parameter_names(modes: int) -> tuple[str, ...]:
    """Return m, b, omega_1, c_1, v_1, d_1, ..."""
    each = [f"{name}_{i + 1}" for i in range(modes) for name in Mode._fields]
    return ("m", "b", *each)


def model_vector(model: ModalModel) -> Floats:
    """Return the parameters in the order of `parameter_names`."""
    return np.array([model.inertia, model.damping, *(x for mode in model.modes for x in mode)])


def fit_response(
    trace: Trace,
    modes: int | None = None,
    *,
    output: str = "position_m1",
    command: str = "command",
    delay: float = 0.0,
    from_hz: float = 0.7,
    to_hz: float = 300.0,
) -> Fit:
    """Fit eq. (1) with a number of modes (None: as many as the data show) to a recording.

    delay [s] from command to force, known beforehand. Raises RecordingError with what to record
    instead where the recording does not carry the fit.
    """
    measured = frequency_response(trace, output, command, from_hz=from_hz, to_hz=to_hz)
    if float(np.median(measured.coherence)) < MIN_COHERENCE:
        raise RecordingError(
            f"the coherence between {command!r} and {output!r} is {np.median(measured.coherence):.2f}"
            f" in the median; at least {MIN_COHERENCE} is needed: drive harder, record longer, or"
            " average repeated recordings"
        )
    data = _Data(trace[command], trace[output], measured, delay)
    if modes is not None:
        if not 1 <= modes <= MAX_MODES:
            raise ValueError(f"modes is {modes}; allowed is 1 to {MAX_MODES}")
        return data.fit(modes)
    fits = [data.fit(count) for count in range(1, MAX_MODES + 1)]
    return fits[propose(fits)]


def propose(fits: "list[Fit]") -> int:
    """Return the index of the fit with the fewest modes that the data do not reject.

    Bayesian criterion: misfit + p ln(2 n), all misfits against the noise of the richest fit.
    Half-overlapping Hann windows leave about two thirds of the bins independent.
    """
    finest = fits[-1]
    weight = 1.0 / _bin_variance(finest)
    independent = 2.0 * finest.bins * 2.0 / 3.0
    scores = [
        (2.0 / 3.0) * 2.0 * float(np.sum(np.abs(f.response.value - f.fitted) ** 2 * weight))
        + len(f.names) * np.log(independent)
        for f in fits
    ]
    return int(np.argmin(scores))


def _bin_variance(fit: Fit) -> Floats:
    residual = np.abs(fit.response.value - fit.fitted) ** 2
    return _smooth(residual)


def _smooth(values: Floats, width: int = 25) -> Floats:
    """Running mean over bins, shorter at the ends."""
    kernel = np.ones(min(width, values.size))
    return np.convolve(values, kernel, "same") / np.convolve(np.ones(values.size), kernel, "same")


class _Data:
    """A recording, and what every fit to it shares."""

    def __init__(
        self, command: Floats, output: Floats, measured: FrequencyResponse, delay: float
    ) -> None:
        self.command, self.output, self.measured, self.delay = command, output, measured, delay
        self.windows: Windows = measured.windows

    def predicted(self, model: ModalModel) -> tuple[Floats, Complexes]:
        y = position(model, self.command, self.windows.period, self.delay)
        return y, self.windows.response(y)

    def fit(self, modes: int) -> Fit:
        coherence = np.clip(self.measured.coherence, 1e-6, 1.0 - 1e-9)
        variance = _smooth(np.abs(self.measured.value) ** 2 * (1.0 / coherence - 1.0))
        model = starting_model(
            self.measured.frequency_hz, self.measured.value, 1.0 / np.sqrt(variance), modes,
            self.windows.period, self.delay,
        )  # fmt: skip
        x = to_free(model)
        for _ in range(ROUNDS):
            x = self._minimised(x, 1.0 / np.sqrt(variance), modes)
            y, _ = self.predicted(from_free(x, modes))
            noise = self.windows.transform(self.output - y)
            variance = _smooth(np.sum(np.abs(noise) ** 2, axis=0)) / self.windows.power
            variance /= self.windows.starts.size
        return self._summary(x, variance, modes)

    def _residual(self, x: Floats, weight: Floats, modes: int) -> Floats:
        _, h = self.predicted(from_free(x, modes))
        error = (h - self.measured.value) * weight
        return np.concatenate([error.real, error.imag])

    def _minimised(self, x: Floats, weight: Floats, modes: int) -> Floats:
        result = least_squares(
            self._residual, x, jac=self._jacobian, args=(weight, modes), method="trf",
            x_scale="jac", loss="linear", bounds=free_bounds(x, self.windows), max_nfev=60,
        )  # fmt: skip
        return result.x

    def _jacobian(self, x: Floats, weight: Floats, modes: int) -> Floats:
        columns = []
        for i in range(x.size):
            step = np.zeros(x.size)
            step[i] = STEP
            ahead = self._residual(x + step, weight, modes)
            columns.append((ahead - self._residual(x - step, weight, modes)) / (2.0 * STEP))
        return np.column_stack(columns)

    def _summary(self, x: Floats, variance: Floats, modes: int) -> Fit:
        weight = 1.0 / np.sqrt(variance)
        model = from_free(x, modes)
        y, h = self.predicted(model)
        residual = self.output - y
        jacobian = self._jacobian(x, weight, modes)
        rows = np.linalg.pinv(jacobian)
        bins = h.size
        log_of_free = _log_derivative(x, modes)
        samples = residual.size
        shapes = np.array(
            [
                np.fft.rfft(self.windows.adjoint((r[:bins] + 1j * r[bins:]) * weight, samples))
                for r in log_of_free @ rows
            ]
        )
        spectrum = _noise_spectrum(residual, samples, self.windows)
        twice = np.full(shapes.shape[1], 2.0)
        twice[0] = 1.0
        covariance = np.real((np.conj(shapes) * (spectrum * twice)) @ shapes.T) / samples
        error = np.abs(h - self.measured.value) ** 2
        return Fit(
            model, parameter_names(modes), covariance, float(np.sum(error / variance)), bins,
            float(np.std(residual)), self.measured, h,
        )  # fmt: skip


def _noise_spectrum(residual: Floats, samples: int, windows: Windows) -> Floats:
    """Two-sided power spectrum of the output's noise at the transform's bins, per sample."""
    length = min(windows.length // 4, residual.size)
    frequency, density = welch(residual, 1.0, nperseg=length, detrend="linear")
    density[1:] *= 0.5
    density[0] = density[1]
    return np.interp(np.fft.rfftfreq(samples), frequency, density)


def to_free(model: ModalModel) -> Floats:
    """Return free coordinates: logarithms of m, b, c, d, and of v1, w1 - v1, v2 - w1, w2 - v2 ..."""
    x = [np.log(model.inertia), np.log(model.damping)]
    last = 0.0
    for omega, c, v, d in model.modes:
        x += [np.log(omega - v), np.log(c), np.log(v - last), np.log(d)]
        last = omega
    return np.array(x)


def from_free(x: Floats, modes: int) -> ModalModel:
    """Return the model of free coordinates."""
    values = np.exp(x)
    built: list[Mode] = []
    last = 0.0
    for i in range(modes):
        above, c, over, d = values[2 + 4 * i : 6 + 4 * i]
        v = last + over
        built.append(Mode(v + above, min(c, 1.99 * (v + above)), v, d))
        last = v + above
    return ModalModel(values[0], values[1], tuple(built))


def free_bounds(x: Floats, windows: Windows) -> tuple[Floats, Floats]:
    """Bounds of the free coordinates: a factor 1e3 around the start, modes inside the band."""
    top = np.log(2.0 * np.pi * 0.5 / windows.period)
    lower, upper = x - 7.0, x + 7.0
    for i in range((x.size - 2) // 4):
        for j in (2, 4):
            upper[4 * i + j] = max(min(upper[4 * i + j], top), x[4 * i + j] + 1e-3)
    return lower, upper


def _log_derivative(x: Floats, modes: int) -> Floats:
    """Derivative of the parameters' logarithms by the free coordinates, (p, p)."""
    columns = []
    for i in range(x.size):
        step = np.zeros(x.size)
        step[i] = STEP
        ahead = np.log(model_vector(from_free(x + step, modes)))
        columns.append((ahead - np.log(model_vector(from_free(x - step, modes)))) / (2.0 * STEP))
    return np.column_stack(columns)

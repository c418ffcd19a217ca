"""The ten parameters of eq. (1) from a frequency response, with valid confidence intervals.

The model's response is computed like the data's, from the position under the recorded command in
the same windows, so leakage cancels (`identification/prediction.py`). The fit is weighted least
squares over stable, interlacing modes (`identification/coordinates.py`), started and repeated as in
`identification/search.py`, with the covariance of `identification/problem.py`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from zwidth.identification.coordinates import MAX_MODES, Coordinates, parameters
from zwidth.identification.problem import Data
from zwidth.identification.response import FrequencyResponse, RecordingError, frequency_response
from zwidth.identification.search import REJECTED, Found, Search
from zwidth.logs.stretches import longest_stretch
from zwidth.shown import Valued
from zwidth.sim.modal import ModalModel
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
MIN_COHERENCE = 0.5
INDEPENDENT = 2.0 / 3.0  # share of the bins of half-overlapping Hann windows
Z95 = 1.959963984540054
LEAST_CHANGE = 0.03  # least change of the response, somewhere in the band, by a real mode


@dataclass(frozen=True)
class Fit(Valued):
    """A fitted modal model.

    covariance (p, p): of the natural logarithms of `names`, but of the delay [s] itself if it was
    fitted. misfit: mean of |H1 - H1_model|^2 over the noise's variance, 1 if the model explains all
    but noise. noise_rms: of the output within the band [rad | m]. fitted: the model's H1; variance
    (bins,): of H1 by noise. note: a sentence on missing samples, "" if none are missing.
    """

    model: ModalModel
    delay: float
    names: tuple[str, ...]
    covariance: Floats
    misfit: float
    noise_rms: float
    response: FrequencyResponse
    fitted: Complexes
    variance: Floats
    note: str = ""

    @property
    def values(self) -> Floats:
        """The parameters in the order of `names`, (p,)."""
        return parameters(self.model, self.delay if "delay" in self.names else None)

    def intervals(self) -> dict[str, tuple[float, float, float]]:
        """Return name -> (value, lower, upper) at 95 %, symmetric in the logarithm."""
        spread = Z95 * np.sqrt(np.diag(self.covariance))
        found: dict[str, tuple[float, float, float]] = {}
        for name, value, s in zip(self.names, self.values.tolist(), spread.tolist(), strict=True):
            linear, factor = name == "delay", float(np.exp(min(s, 700.0)))
            low, high = (value - s, value + s) if linear else (value / factor, value * factor)
            found[name] = (value, low, high)
        return found


def fit_response(
    trace: Trace,
    modes: int | None = None,
    *,
    output: str = "position_m1",
    command: str = "command",
    delay: float | None = 0.0,
    from_hz: float = 0.7,
    to_hz: float = 300.0,
    say: Callable[[str], object] = lambda _: None,
) -> Fit:
    """Fit eq. (1) with a number of modes (None: as many as the data show) to a recording.

    0 modes are a rigid body with a damper. If the number is chosen from the data, a mode that
    changes the response by less than 3 % everywhere is dropped: friction and steps leave errors of
    this size, which a zero beside a pole would reduce.

    delay: from command to force [s] if it is known; None fits it too. say: called with what is
    fitted next. Short gaps are filled in (`logs/stretches.py`). If there are longer ones, or the
    clock jumps, or a value is not finite, the longest stretch without any of these is fitted, since
    the force in a gap is unknown. Raises RecordingError, with what to record instead, if the
    recording does not support the fit, ValueError for bad arguments.
    """
    if modes is not None and not 0 <= modes <= MAX_MODES:
        raise ValueError(f"modes is {modes}; it must be from 0 (a rigid body) to {MAX_MODES}")
    if delay is not None and not 0.0 <= delay < np.inf:
        raise ValueError(f"delay is {delay}; it must be >= 0 and finite [s]")
    note = ""
    if command in trace.channels and output in trace.channels:
        trace, note = longest_stretch(trace, (command, output), "the recording")
    try:
        measured = frequency_response(trace, output, command, from_hz=from_hz, to_hz=to_hz)
    except RecordingError as error:
        raise (RecordingError(f"{note}; {error}") if note else error) from None
    middle = float(np.median(measured.coherence))
    if middle < MIN_COHERENCE:
        raise RecordingError(
            f"the coherence between {command!r} and {output!r} is {middle:.2f} in the median; at"
            f" least {MIN_COHERENCE} is needed: drive harder, record longer, or lower the noise"
        )
    fit = fit_data(Data(trace[command], trace[output], measured), modes, delay, say)
    return replace(fit, note=note)


def fit_data(
    data: Data,
    modes: int | None = None,
    delay: float | None = 0.0,
    say: Callable[[str], object] = lambda _: None,
) -> Fit:
    """Fit a recording whose frequency response is already known; see `fit_response`."""
    period = data.measured.windows.period
    if modes is not None:
        say(_with_modes(modes))
        return _fit(data, Coordinates(modes, period, delay))
    fits: list[Fit] = []
    for count in range(MAX_MODES + 1):
        say(f"{100.0 * count / (MAX_MODES + 1):.0f} %, {_with_modes(count)}")
        fits.append(_fit(data, Coordinates(count, period, delay)))
        richer_is_rejected = len(fits) > 1 and propose(fits) < len(fits) - 1
        if richer_is_rejected and fits[-2].misfit <= REJECTED:
            break
    chosen = propose(fits)
    while chosen and _least_change(fits[chosen]) < LEAST_CHANGE:
        chosen -= 1
    return fits[chosen]


def _with_modes(count: int) -> str:
    if count == 0:
        return "as a rigid body"
    return "with 1 vibration mode" if count == 1 else f"with {count} vibration modes"


def _least_change(fit: Fit) -> float:
    """Return the largest relative change of the response by the least important mode.

    A mode is the factor (w/v)^2 (s^2 + d s + v^2) / (s^2 + c s + w^2) of G.
    """
    s = 2j * np.pi * fit.response.frequency_hz
    factors = [
        (w / v) ** 2 * (s * s + d * s + v * v) / (s * s + c * s + w * w)
        for w, c, v, d in fit.model.modes
    ]
    return min(float(np.abs(factor / factor[0] - 1.0).max()) for factor in factors)


def propose(fits: list[Fit]) -> int:
    """Return the index of the fit with the fewest modes that the data do not reject.

    Bayesian information criterion: misfit over noise + p ln(2 n), with the noise of the fit with
    the most modes.
    """
    noise = fits[-1].variance
    independent = 2.0 * INDEPENDENT * noise.size
    squares = [np.abs(f.response.value - f.fitted) ** 2 for f in fits]
    scores = [
        2.0 * INDEPENDENT * float(np.sum(square / noise)) + len(f.names) * np.log(independent)
        for f, square in zip(fits, squares, strict=True)
    ]
    return int(np.argmin(scores))


def _fit(data: Data, coordinates: Coordinates) -> Fit:
    found: Found = Search(data, coordinates).run()
    model, delay = coordinates.model(found.x)
    windows, measured = data.measured.windows, data.measured
    band = windows.frequencies[-1] - windows.frequencies[0]
    return Fit(
        model,
        delay,
        coordinates.names,
        found.problem.covariance(found.x, found.spectrum),
        found.misfit,
        float(np.sqrt(np.mean(found.spectrum) * 2.0 * windows.period * band)),
        measured,
        measured.value - found.left,
        found.noise,
    )

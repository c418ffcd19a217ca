"""A measured frequency response with its noise band, the fitted model, and the coherence."""

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from numpy.typing import NDArray

from zwidth.figures.style import AFTER, FILE, INTERVAL, STYLE, headed
from zwidth.identification.fit import Fit
from zwidth.sim.sampled import sampled_frequency_response

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
DOTS = FILE  # darker than a measured line: points are smaller
TWO_SIGMA = 1.96
POINTS = 800  # points of the model's line


def fit_figure(fit: Fit) -> Figure:
    """Return a fit over the response that it was fitted to, up to half the sampling rate."""
    period = fit.response.windows.period
    frequency = np.geomspace(fit.response.frequency_hz[0], 0.499 / period, POINTS)
    turn = np.exp(-2j * np.pi * frequency * fit.delay)
    model = sampled_frequency_response(fit.model, period, frequency) * turn
    return identified_figure(
        fit.response.frequency_hz,
        fit.response.value,
        fit.response.coherence,
        np.sqrt(fit.variance),
        (frequency, model),
    )


def identified_figure(
    frequency: Floats,
    measured: Complexes,
    coherence: Floats,
    deviation: Floats,
    model: tuple[Floats, Complexes],
) -> Figure:
    """Return magnitude, phase and coherence; deviation: standard deviation of H1, all (bins,)."""
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 7.2), layout="constrained")
        top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=[3, 2, 1])
        size = np.abs(measured)
        half = TWO_SIGMA * deviation / np.sqrt(2.0)  # along the response: half of the variance
        low = np.maximum(size - half, 1e-3 * size)
        top.fill_between(frequency, _db(low), _db(size + half), color=INTERVAL,
                         linewidth=0.0, label="95 % by noise")  # fmt: skip
        top.plot(frequency, _db(size), ".", markersize=3, color=DOTS, label="measured")
        top.plot(model[0], _db(np.abs(model[1])), color=AFTER, label="fitted")
        middle.plot(frequency, _phase(measured), ".", markersize=3, color=DOTS)
        middle.plot(model[0], _phase(model[1]), color=AFTER)
        bottom.plot(frequency, coherence, color="0.3", linewidth=0.8)
        bottom.set_ylim(0.0, 1.05)
        headed(figure, "Measured frequency response and fitted model")
        top.set_ylabel("magnitude [dB]")
        middle.set_ylabel("phase [deg]")
        bottom.set_ylabel("coherence")
        bottom.set_xlabel("frequency [Hz]")
        bottom.set_xscale("log")
        bottom.set_xlim(float(frequency[0]), float(model[0][-1]))
        bottom.xaxis.set_major_formatter("{x:g}")
        handles, labels = top.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def _db(values: Floats) -> Floats:
    return 20.0 * np.log10(values)


def _phase(response: Complexes) -> Floats:
    """Phase [deg], unwrapped, the low frequencies between -360 and 0."""
    angle = np.degrees(np.unwrap(np.angle(response)))
    return angle - 360.0 * np.round((angle[angle.size // 4] + 180.0) / 360.0)

"""Fig. 3: a recorded frequency response with models of it."""

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from zwidth.figures.curves import THEIRS
from zwidth.figures.style import COLOURS, STYLE

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Response = tuple[Floats, Complexes]


def bode_figure(measured: Response, ours: Response, theirs: Response) -> Figure:
    """Return magnitude [dB] and phase [deg] over frequency; each response: (Hz, complex)."""
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 6.4), layout="constrained")
        magnitude, phase = figure.subplots(2, 1, sharex=True)
        _both(magnitude, phase, measured, linestyle="none", marker="o", markersize=5,
              color=COLOURS[2], label="simulated device under white noise")  # fmt: skip
        _both(magnitude, phase, ours, color=COLOURS[0], linewidth=1.8, label="fitted, ours")
        _both(magnitude, phase, theirs, color="black", linestyle=THEIRS, linewidth=1.1,
              label="Table I, theirs")  # fmt: skip
        magnitude.set_ylabel("magnitude [dB re 1 rad/(N m)]")
        phase.set_ylabel("phase [deg]")
        phase.set_yticks(np.arange(-360, 1, 45))
        phase.set_ylim(-270.0, 0.0)
        phase.set_xscale("log")
        phase.set_xlabel("frequency [Hz]")
        phase.set_xlim(0.7, 500.0)
        phase.set_xticks([1, 2, 5, 10, 20, 50, 100, 200, 500], minor=False)
        phase.xaxis.set_major_formatter("{x:g}")
        handles, labels = magnitude.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper left", ncols=3)
    return figure


def _both(magnitude: Axes, phase: Axes, response: Response, **style: object) -> None:
    frequency, value = response
    angle = np.degrees(np.unwrap(np.angle(value)))
    angle -= 360.0 * np.round((angle[angle.size // 4] + 180.0) / 360.0)
    magnitude.plot(frequency, 20.0 * np.log10(np.abs(value)), **style)  # pyright: ignore
    phase.plot(frequency, angle, **style)  # pyright: ignore

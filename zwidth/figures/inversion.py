"""A measured plant over its model: size and phase over frequency."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from numpy.typing import NDArray

from zwidth.figures.style import STYLE


@dataclass(frozen=True)
class PlantPoints:
    """One series: frequency [Hz] and measured over model, both (n,)."""

    label: str
    colour: str
    shape: str
    frequency_hz: NDArray[np.float64]
    ratio: NDArray[np.complex128]


def inversion_figure(series: Sequence[PlantPoints]) -> Figure:
    """Return the figure, with a colour and shape per series."""
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 5.0), layout="constrained")
        size, phase = figure.subplots(2, 1, sharex=True)
        for axes, level in ((size, 1.0), (phase, 0.0)):
            axes.axhline(level, color="black", linewidth=0.8)
        for one in series:
            for axes, values in (
                (size, np.abs(one.ratio)),
                (phase, np.degrees(np.angle(one.ratio))),
            ):
                axes.plot(one.frequency_hz, values, linestyle="none", marker=one.shape,
                          markersize=6.5, markerfacecolor="white", markeredgecolor=one.colour,
                          markeredgewidth=1.4, label=one.label)  # fmt: skip
        size.set_ylabel("size over the model's")
        size.set_ylim(0.6, 1.3)
        phase.set_ylabel("phase lead [deg]")
        phase.set_xlabel("frequency [Hz]")
        phase.set_xscale("log")
        phase.set_xlim(4.0, 320.0)
        phase.set_xticks([5, 10, 20, 50, 100, 200], ["5", "10", "20", "50", "100", "200"])
        phase.set_xticks([], minor=True)
        handles, labels = size.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper left", ncols=3)
    return figure

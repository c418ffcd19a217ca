"""The corner of the region over continuous delay."""

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from numpy.typing import NDArray

from zwidth.figures.curves import frequency_axis
from zwidth.figures.style import COLOURS, STYLE

Floats = NDArray[np.float64]
PAPER_MS = (2.0, 4.0, 8.0)


def delay_figure(
    delay_ms: Floats, damping: Floats, last: Floats, stiffness: Floats, above_hz: Floats
) -> Figure:
    """Return B_t with the last stable B, K_max, and f beyond B_t; all (n,)."""
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 7.0), layout="constrained")
        panels = figure.subplots(3, 1, sharex=True)
        panels[0].plot(
            delay_ms, last, color=COLOURS[1], linewidth=1.0, label="last $B$ with a stable $K$"
        )
        panels[0].plot(delay_ms, damping, color=COLOURS[0], label="corner $B_t$")
        panels[0].set_ylabel("$B$ [N m s/rad]")
        panels[0].set_ylim(bottom=0.0)
        panels[0].legend(loc="upper right")
        panels[1].plot(delay_ms, stiffness, color=COLOURS[0])
        panels[1].set_ylabel("$K_\\mathrm{max}$ [N m/rad]")
        panels[1].set_yscale("log")
        panels[1].set_yticks([5, 10, 20, 50, 100, 200], ["5", "10", "20", "50", "100", "200"])
        panels[2].plot(delay_ms, above_hz, color=COLOURS[0])
        panels[2].set_ylabel("$f$ beyond $B_t$ [Hz]")
        frequency_axis(panels[2])
        panels[2].set_xlabel("delay [ms]")
        panels[2].set_xlim(0.0, float(delay_ms[-1]))
        for axes, values in zip(panels, (damping, stiffness, above_hz), strict=True):
            axes.plot(PAPER_MS, np.interp(PAPER_MS, delay_ms, values), linestyle="none",
                      marker="o", markersize=6, markerfacecolor="white",
                      markeredgecolor=COLOURS[0], markeredgewidth=1.4, zorder=4)  # fmt: skip
    return figure

"""A measured boundary beside linear theory and simulations from several starts."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from numpy.typing import NDArray

from zwidth.figures.style import DARK, STYLE

Floats = NDArray[np.float64]
GREYS = (("0.4", "-"), ("0.4", (0, (2, 1.2))))


@dataclass(frozen=True)
class Simulated:
    """A boundary in the time domain: K for each damping, both (n,), nan if no K is stable."""

    label: str
    damping: Floats
    stiffness: Floats


def paddle_figure(
    damping: Floats,
    measured: Floats,
    grid: Floats,
    linear: Sequence[tuple[str, Floats]],
    simulated: Sequence[Simulated],
) -> Figure:
    """Return the figure.

    damping, measured (m,): the points; grid (n,) with linear (label, K (n,)): theory.
    """
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 4.8), layout="constrained")
        axes = figure.subplots()
        for (label, stiffness), (grey, dashes) in zip(linear, GREYS, strict=True):
            axes.plot(grid, stiffness, color=grey, linestyle=dashes, label=label)
        for one, colour in zip(simulated, DARK, strict=True):
            axes.plot(one.damping, one.stiffness, color=colour, label=one.label)
        axes.plot(damping, measured, linestyle="none", marker="o", markersize=7,
                  markerfacecolor="white", markeredgecolor="black", markeredgewidth=1.5,
                  zorder=4, clip_on=False, label="measured")  # fmt: skip
        axes.set_xlim(left=0.0)
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel("virtual damping $B$ [N m s/rad]")
        axes.set_ylabel("critical stiffness $K_\\mathrm{CR}$ [N m/rad]")
        figure.legend(loc="outside upper left", ncols=3)
    return figure

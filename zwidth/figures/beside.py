"""A boundary with bands for the spread of hands and of parameters, and with the passive walls."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from zwidth.figures.style import STYLE

Floats = NDArray[np.float64]
HAND, SURE, PASSIVE = 0.18, 0.5, "0.2"


@dataclass(frozen=True)
class Band:
    """One delay: line (B, K, f), each (n,); over grid (m,): bands hand and sure (m, 2); passive."""

    label: str
    colour: str
    line: tuple[Floats, Floats, Floats]
    grid: Floats
    hand: Floats
    sure: Floats
    passive: Floats
    walls: Floats


def beside_figure(bands: Sequence[Band]) -> Figure:
    """Return one panel per delay, each with the origin enlarged."""
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 3.9), layout="constrained")
        for axes, band in zip(figure.subplots(1, len(bands), squeeze=False)[0], bands, strict=True):
            _draw(axes, band)
            axes.set_title(band.label)
            axes.set_xlim(left=0.0)
            axes.set_ylim(0.0, 2.1 * float(np.nanmax(band.hand)))
            axes.set_xlabel("$B$ [N m s/rad]")
            inset = axes.inset_axes((0.3, 0.63, 0.66, 0.34))
            _draw(inset, band)
            inset.set_xlim(0.0, 2.0 * float(band.passive[-1]))
            inset.set_ylim(0.0, 2.2 * float(band.walls[0]))
            inset.tick_params(labelsize=7)
            inset.locator_params(nbins=3)
        figure.axes[0].set_ylabel("$K_\\mathrm{CR}$ [N m/rad]")
        handles = [
            Line2D([], [], color="0.3", label="free device"),
            Patch(color="0.3", alpha=HAND, label="held by a finger"),
            Patch(color="0.3", alpha=SURE, label="95 % by parameters"),
            Patch(facecolor=PASSIVE, label="passive walls"),
        ]
        figure.legend(handles=handles, loc="outside upper left", ncols=4)
    return figure


def _draw(axes: Axes, band: Band) -> None:
    axes.fill_between(band.grid, *band.hand.T, color=band.colour, alpha=HAND, linewidth=0.0)
    axes.fill_between(band.grid, *band.sure.T, color=band.colour, alpha=SURE, linewidth=0.0)
    axes.plot(band.line[0], band.line[1], color=band.colour, linewidth=1.2)
    axes.fill_between(band.passive, band.walls, color=PASSIVE, linewidth=0.0)

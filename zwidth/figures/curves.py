"""Critical stiffness and ultimate frequency over damping, for any named curves and points."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullLocator
from numpy.typing import NDArray

from zwidth.figures.boundary import JUMP
from zwidth.figures.style import STYLE

Floats = NDArray[np.float64]
THEIRS = (0, (5, 2))


@dataclass(frozen=True)
class Curve:
    """A line over damping; NaN where no K is stable. style: "-" ours, `THEIRS` dashed."""

    damping: Floats
    stiffness: Floats
    frequency_hz: Floats
    colour: str
    style: Any = "-"
    width: float = 1.6


@dataclass(frozen=True)
class Points:
    """Single values over damping, open unless filled; crossed ones are misprints."""

    damping: Floats
    stiffness: Floats
    frequency_hz: Floats
    colour: str
    shape: str = "o"
    crossed: tuple[int, ...] = ()


def curves_figure(
    curves: Sequence[Curve],
    points: Sequence[Points] = (),
    legend: Sequence[Line2D] = (),
    units: tuple[str, str] = ("N m", "rad"),
) -> Figure:
    """Return stiffness above, frequency below, the legend outside both."""
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 7.0), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": (3, 2)})
        for line in curves:
            style: dict[str, Any] = {
                "color": line.colour, "linestyle": line.style, "linewidth": line.width,
            }  # fmt: skip
            above.plot(line.damping, line.stiffness, **style)
            broken(below, line, style)
        for group in points:
            _points(above, group, group.stiffness)
            _points(below, group, group.frequency_hz)
        force, length = units
        above.set_ylabel(f"critical stiffness $K_\\mathrm{{CR}}$ [{force}/{length}]")
        above.set_ylim(bottom=0.0)
        below.set_ylabel("ultimate frequency [Hz]")
        below.set_xlabel(f"virtual damping $B$ [{force} s/{length}]")
        below.set_xlim(left=0.0)
        frequency_axis(below)
        if legend:
            figure.legend(handles=list(legend), loc="outside upper left", ncols=min(4, len(legend)))
    return figure


def frequency_axis(axes: Axes) -> None:
    """Set the vertical axis for frequencies over decades, labelled in plain numbers."""
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(NullLocator())


def broken(axes: Axes, line: Curve, style: dict[str, Any]) -> None:
    """Draw frequency over damping, with a thin vertical line where the branch changes."""
    x, y = [float(line.damping[0])], [float(line.frequency_hz[0])]
    for b, f in zip(line.damping[1:].tolist(), line.frequency_hz[1:].tolist(), strict=True):
        if y[-1] == y[-1] and not 1 / JUMP < f / y[-1] < JUMP and f == f:
            axes.plot([x[-1], b], [y[-1], f], color=style["color"], linewidth=0.5, linestyle=":")
            x.append(b)
            y.append(math.nan)
        x.append(b)
        y.append(f)
    axes.plot(x, y, **style)


def _points(axes: Axes, group: Points, values: Floats) -> None:
    axes.plot(group.damping, values, linestyle="none", marker=group.shape, markersize=6.5,
              markerfacecolor="white", markeredgecolor=group.colour, markeredgewidth=1.4,
              zorder=4, clip_on=False)  # fmt: skip
    if group.crossed:
        chosen = list(group.crossed)
        axes.plot(group.damping[chosen], values[chosen], linestyle="none", marker="x",
                  markersize=3.5, color=group.colour, zorder=5)  # fmt: skip


def key(label: str, colour: str = "0.3", style: Any = "-", marker: str = "") -> Line2D:
    """Return an entry of a legend: a line, or with style "none" a marker."""
    return Line2D([], [], color=colour, linestyle=style, marker=marker, markerfacecolor="white",
                  label=label)  # fmt: skip

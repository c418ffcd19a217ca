"""Root loci by mode, the boundary by critical mode, and how a delayed damper acts on a mode."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from zwidth.figures.curves import frequency_axis
from zwidth.figures.style import COLOURS, STYLE

Floats = NDArray[np.float64]
MODE_COLOURS = {
    "rigid body": "0.5",
    "mode 1": COLOURS[0],
    "mode 2": COLOURS[1],
    "mode 3": COLOURS[5],
    "delay": COLOURS[2],
}
MODE_WIDTHS = {"rigid body": 1.2, "mode 1": 2.6, "mode 2": 2.6, "mode 3": 2.6, "delay": 2.6}
MODE_LABELS = {"delay": "the loop's own (delay line)"}
SHOWN = (-120.0, 420.0)  # decay rates [1/s] of the loci


@dataclass(frozen=True)
class Piece:
    """A boundary (n,) whose points are named by the mode that goes unstable there."""

    label: str
    damping: Floats
    stiffness: Floats
    frequency_hz: Floats
    names: tuple[str, ...]


@dataclass(frozen=True)
class Locus:
    """Branches over damping: decay [1/s] and frequency [Hz], both (steps, branches)."""

    label: str
    names: tuple[str, ...]
    damping: Floats
    decay: Floats
    frequency_hz: Floats
    last: float


def critical_figure(pieces: Sequence[Piece]) -> Figure:
    """Return K_CR and f over B, one column per delay, coloured by the critical mode."""
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 5.2), layout="constrained")
        panels = figure.subplots(2, len(pieces), sharex="col", sharey="row", squeeze=False)
        seen: list[str] = []
        for column, piece in enumerate(pieces):
            above, below = panels[:, column]
            for first, last in _runs(piece.names):
                name = piece.names[first]
                seen.append(name)
                part = slice(first, last)
                style = {"color": _colour(name), "linewidth": MODE_WIDTHS.get(name, 1.6)}
                above.plot(piece.damping[part], piece.stiffness[part], **style)
                below.plot(piece.damping[part], piece.frequency_hz[part], **style)
            above.set_title(piece.label)
            above.set_ylim(bottom=0.0)
            above.set_xlim(left=0.0)
            below.set_xlabel("$B$ [N m s/rad]")
        panels[0, 0].set_ylabel("$K_\\mathrm{CR}$ [N m/rad]")
        panels[1, 0].set_ylabel("$f$ [Hz]")
        frequency_axis(panels[1, 0])
        _mode_legend(figure, sorted(set(seen), key=lambda n: (n != "rigid body", n)))
    return figure


def loci_figure(loci: Sequence[Locus]) -> Figure:
    """Return frequency over decay rate as B rises, one panel per delay."""
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 3.9), layout="constrained")
        panels = figure.subplots(1, len(loci), sharey=True, squeeze=False)[0]
        for axes, locus in zip(panels, loci, strict=True):
            for column, name in enumerate(locus.names):
                _branch(axes, locus, column, _colour(name))
            axes.axvline(0.0, color="black", linewidth=0.8)
            axes.set_title(locus.label)
            axes.set_xlabel("decay rate [1/s]")
            axes.set_xlim(*SHOWN)
            axes.set_ylim(0.0, 400.0)
        panels[0].set_ylabel("frequency [Hz]")
        _mode_legend(figure, sorted({n for locus in loci for n in locus.names}))
    return figure


def damper_figure(
    effects: Sequence[tuple[str, str, Floats, Floats]], modes_hz: Sequence[float]
) -> Figure:
    """Return the damper's real part over frequency, a line per delay, the modes marked."""
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 3.6), layout="constrained")
        axes = figure.subplots()
        axes.axhspan(-1.0, 0.0, color="0.94", zorder=0)
        axes.text(396.0, -0.96, "drives the motion", ha="right", va="bottom", fontsize=9)
        axes.text(396.0, 0.96, "damps it", ha="right", va="top", fontsize=9)
        for label, colour, frequency, effect in effects:
            axes.plot(frequency, effect, color=colour, label=label)
            axes.plot(modes_hz, np.interp(modes_hz, frequency, effect), linestyle="none",
                      marker="o", markersize=5, color=colour)  # fmt: skip
        for i, f in enumerate(modes_hz):
            axes.axvline(f, color="black", linewidth=0.8, linestyle=":")
            axes.text(f, 1.03, f"mode {i + 1}", ha="center", va="bottom", fontsize=9)
        axes.set_xlim(0.0, 400.0)
        axes.set_ylim(-1.0, 1.0)
        axes.set_xlabel("frequency [Hz]")
        axes.set_ylabel("force over a true damper's")
        figure.legend(loc="outside upper left", ncols=len(effects))
    return figure


def _branch(axes: Axes, locus: Locus, column: int, colour: str) -> None:
    decay, frequency = locus.decay[:, column], locus.frequency_hz[:, column]
    inside = (decay > SHOWN[0]) & (decay < SHOWN[1])
    if not inside.any():
        return
    axes.plot(np.where(inside, decay, np.nan), frequency, color=colour)
    if inside[0]:
        axes.plot(decay[:1], frequency[:1], marker="o", markersize=4, color=colour)
    if inside[-1] and inside[-4]:
        axes.annotate("", (decay[-1], frequency[-1]), (decay[-4], frequency[-4]),
                      arrowprops={"arrowstyle": "-|>", "color": colour})  # fmt: skip
    at_last = int(np.argmin(np.abs(locus.damping - locus.last)))
    if abs(decay[at_last]) < 0.02 * (SHOWN[1] - SHOWN[0]) and frequency[at_last] < 400.0:
        axes.plot(0.0, frequency[at_last], marker="o", markersize=7, markerfacecolor="none",
                  markeredgecolor="black", markeredgewidth=1.3)  # fmt: skip


def _runs(names: Sequence[str]) -> list[tuple[int, int]]:
    """Intervals of equal names."""
    edges = [0, *[i for i in range(1, len(names)) if names[i] != names[i - 1]], len(names)]
    return list(pairwise(edges))


def _colour(name: str) -> str:
    return MODE_COLOURS.get(name, "black")


def _mode_legend(figure: Figure, names: Sequence[str]) -> None:
    handles = [
        Line2D(
            [], [], color=_colour(n), linewidth=MODE_WIDTHS.get(n, 1.6), label=MODE_LABELS.get(n, n)
        )
        for n in names
    ]
    figure.legend(handles=handles, loc="outside upper left", ncols=len(handles))

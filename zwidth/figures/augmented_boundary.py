"""The boundaries of a device before and after a diagnosis."""

from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from zwidth.figures.style import AFTER, BEFORE, STYLE
from zwidth.stability.augmented_boundary import AugmentedBoundary, critical
from zwidth.stability.bisection import Bracket

LINEAR = "0.35"


def augmented_boundary_figure(found: AugmentedBoundary) -> Figure:
    """Return K_CR over B of the nominal and of the augmented device; walls below it are stable."""
    force, length = ("N m", "rad") if found.rotary else ("N", "m")
    with rc_context(STYLE):
        figure = Figure(figsize=(6.4, 3.8), layout="constrained")
        axes = figure.subplots()
        axes.plot(
            [b for b, _ in found.curve], [k for _, k in found.curve],
            color=LINEAR, linestyle="--", linewidth=1.1, label="device file, linear theory",
        )  # fmt: skip
        _brackets(axes, found.nominal, BEFORE, "s", "device file, simulated")
        _brackets(axes, found.augmented, AFTER, "o", "with the found effects, simulated")
        axes.set_xlabel(f"virtual damping B [{force} s/{length}]")
        axes.set_ylabel(f"virtual stiffness K [{force}/{length}]")
        axes.set_ylim(bottom=0.0)
        axes.set_title(
            f"Stable below; delay {1e3 * found.delay:g} ms, displaced by {found.start:g} {length}"
        )
        axes.legend()
    return figure


def _brackets(
    axes: Axes, brackets: Sequence[Bracket], colour: str, marker: str, label: str
) -> None:
    """Middles as marks, zero where no K was stable."""
    middles = [critical(b) for b in brackets]
    drawn = [0.0 if k is None else k for k in middles if k is None or np.isfinite(k)]
    places = [b.damping for b, k in zip(brackets, middles, strict=True) if k is None or k < np.inf]
    axes.plot(places, drawn, marker=marker, markersize=4.5, linewidth=1.2, color=colour,
              label=label)  # fmt: skip

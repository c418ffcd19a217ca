"""Sensitivity of the corner to each parameter, as bars."""

from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from zwidth.figures.style import STYLE
from zwidth.stability.sensitivity import Sensitivity

SYMBOLS = {"omega": "\\omega", "m": "m", "b": "b", "c": "c", "v": "v", "d": "d"}


def sensitivity_figure(groups: Sequence[tuple[str, str, Sequence[Sensitivity]]]) -> Figure:
    """Return two panels of bars; groups: (label, colour, rows), the same parameters in each."""
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 5.4), layout="constrained")
        panels = figure.subplots(1, 2, sharey=True)
        height = 0.8 / len(groups)
        for i, (label, colour, rows) in enumerate(groups):
            places = np.arange(len(rows)) + (i - 0.5 * (len(groups) - 1)) * height
            panels[0].barh(places, [r.damping for r in rows], height, color=colour, label=label)
            panels[1].barh(places, [r.stiffness for r in rows], height, color=colour)
        names = [symbol(row.parameter) for row in groups[0][2]]
        panels[0].set_yticks(np.arange(len(names)), names)
        panels[0].invert_yaxis()
        for axes, quantity in zip(panels, ("B_t", "K_\\mathrm{max}"), strict=True):
            axes.axvline(0.0, color="black", linewidth=0.8)
            axes.set_xlabel(f"% of ${quantity}$ for 1 % of the parameter")
            axes.grid(axis="y", visible=False)
        figure.legend(loc="outside upper left", ncols=len(groups))
    return figure


def symbol(parameter: str) -> str:
    """Return a parameter as mathematics: omega_1 as its Greek letter with an index."""
    name, _, place = parameter.partition("_")
    return f"${SYMBOLS[name]}_{place}$" if place else f"${SYMBOLS[name]}$"

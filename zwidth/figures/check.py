"""How much of its band each recording uses."""

from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from zwidth.figures.style import AFTER, BEFORE, STYLE


def check_figure(shares: Sequence[tuple[str, float, bool]]) -> Figure:
    """Return a bar for each name: the error over the largest one within the band, logarithmic."""
    with rc_context(STYLE):
        figure = Figure(figsize=(6.4, 1.0 + 0.35 * max(1, len(shares))), layout="constrained")
        ax = figure.subplots()
        places = np.arange(len(shares))
        ax.barh(places, [100.0 * share for _, share, _ in shares], 0.6, left=0.0,
                color=[AFTER if within else BEFORE for _, _, within in shares])  # fmt: skip
        ax.axvline(100.0, color="0.3", linestyle="--", linewidth=1.0)
        ax.set_xscale("log")
        lowest = min([10.0, *(50.0 * share for _, share, _ in shares if share > 0.0)])
        ax.set_xlim(lowest, max([200.0, *(150.0 * share for _, share, _ in shares)]))
        ax.set_yticks(places, [name for name, _, _ in shares])
        ax.invert_yaxis()
        ax.set_xlabel("error of free runs [% of the most within the band, dashed]")
    return figure

"""A changing parameter over time: its value in each window, and the fitted change."""

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from zwidth.diagnosis.answer.changes import Change
from zwidth.figures.style import AFTER, BEFORE, INTERVAL, STYLE
from zwidth.sim.readable import scaled

DOTS, LINE, DATE = AFTER, BEFORE, INTERVAL


def changes_figure(change: Change) -> Figure:
    """Return the course of a changing parameter, with 95 % intervals and the date of a step."""
    own = change.windows
    size = float(np.nanmax(np.abs([change.before.value, change.after.value])))
    factor, unit = scaled(size, change.after.unit)
    with rc_context(STYLE):
        figure = Figure(figsize=(6.4, 3.6), layout="constrained")
        ax = figure.subplots()
        ax.errorbar(
            own.times, factor * own.values,
            factor * np.array([own.values - own.lower, own.upper - own.values]),
            fmt="o", color=DOTS, markersize=3.5, linewidth=1.0, capsize=2.0,
            label="each window by itself, 95 % interval",
        )  # fmt: skip
        ax.plot(own.line, factor * own.changed, color=LINE, linewidth=1.4, label="as fitted")
        if own.dated is not None:
            ax.axvspan(*own.dated, color=DATE, zorder=0, label="date of the step, 95 % interval")
        # An interval that fills the picture would hide the rest.
        near = factor * np.array([change.before.value, change.after.value, *own.values])
        spread = max(np.ptp(near), 1e-3 * abs(near[0]))
        ax.set_ylim(near.min() - 0.6 * spread, near.max() + 0.6 * spread)
        words = change.what.removeprefix("the ")
        ax.set_title(f"{words[:1].upper()}{words[1:]} over time")
        ax.set_xlabel("time from the first sample, recordings one after the other [s]")
        ax.set_ylabel(f"{change.parameter.replace('_', ' ')} [{unit or '1'}]")
        figure.legend(loc="outside lower center", ncols=3)
    return figure

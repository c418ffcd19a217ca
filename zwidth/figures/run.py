"""A run over time: positions, command, energy."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator
from numpy.typing import NDArray

from zwidth.figures.style import COLOURS, SHAPES, STYLE
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]

COLUMNS = 2000  # of the picture; a longer line is drawn by its extremes in each
LOST = 1e3  # growth of |position| over its start, above which the scale is logarithmic
EARLY = 50  # samples that determine where a run started
HIGHEST = 1e100  # largest value that is drawn
GREY = "0.55"
MARKS = 7  # marks on each of several lines that may coincide
NOT_SPENT = ("work_motor", "work_disturbance", "work_wall", "work_actuator_lag")


def run_figure(trace: Trace, title: str = "") -> Figure:
    """Return the figure of a simulated run; energy only if it was recorded.

    Shaded: contact with a one-sided wall. A run that grew a thousandfold is drawn on scales that
    are logarithmic beyond its start.
    """
    trace = _drawable(trace)
    with_energy = "stored_energy" in trace.channels
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 6.6 if with_energy else 4.6), layout="constrained")
        panels = figure.subplots(3 if with_energy else 2, 1, sharex=True)
        _positions(panels[0], trace)
        _forces(panels[1], trace)
        if with_energy:
            _energies(panels[2], trace)
        panels[0].set_title(title, wrap=True)
        panels[-1].set_xlabel("time [s]")
        panels[-1].set_xlim(*_span(trace.t))
        for panel in panels:
            _shade_contact(panel, trace)
            panel.legend(loc="upper left", bbox_to_anchor=(1.0, 1.02))
    return figure


def _drawable(trace: Trace) -> Trace:
    """Leave out what overflowed, or is about to: scales cannot be computed with it."""
    return trace.with_channels(
        {n: np.where(np.abs(v) < HIGHEST, v, np.nan) for n, v in trace.channels.items()}
    )


def _positions(axes: Axes, trace: Trace) -> None:
    names = [name for name in trace.channels if name.startswith("position_")]
    for i, name in reversed(list(enumerate(names))):
        look = told_apart(i, len(names), COLOURS[i % len(COLOURS)], _shown(trace))
        _line(axes, trace, name, name.removeprefix("position_"), look)
    axes.set_ylabel(f"position [{trace.units[names[0]]}]")
    _scale(axes, trace, names)


def _forces(axes: Axes, trace: Trace) -> None:
    pushes = [name for name in trace.channels if name.startswith("disturbance_")]
    names = ["applied", "command", *pushes]
    order = {"command": 0, "applied": 1}  # the applied force is below, and wider
    for name, colour in zip(names, (GREY, *COLOURS), strict=False):
        look = told_apart(order.get(name, 0), len(order), colour, _shown(trace))
        _line(axes, trace, name, name.replace("_m", " on m"), look, "steps-post")
    unit = trace.units["command"]
    axes.set_ylabel(f"{'torque' if unit == 'N m' else 'force'} [{unit}]")
    _scale(axes, trace, names)


def _energies(axes: Axes, trace: Trace) -> None:
    _line(axes, trace, "stored_energy", "stored", _plain(COLOURS[0]))
    names = ["stored_energy"]
    spent = [n for n in trace.channels if n.startswith("work_") and n not in NOT_SPENT]
    if spent:
        axes.plot(
            *thinned(trace.t, np.sum([trace[n] for n in spent], axis=0)),
            color=GREY,
            label="dissipated",
            linewidth=1.1,
        )
    for name, label, colour in (
        ("work_motor", "by motor", COLOURS[1]),
        ("work_disturbance", "by disturbance", COLOURS[2]),
    ):
        if np.any(trace.channels.get(name, 0.0)):
            names.append(name)
            _line(axes, trace, name, label, _plain(colour))
    axes.set_ylabel("energy [J]")
    _scale(axes, trace, names)


def _line(
    axes: Axes, trace: Trace, name: str, label: str, look: dict[str, Any], style: Any = "default"
) -> None:
    t, values = thinned(trace.t, trace[name])
    axes.plot(t, values, label=label, drawstyle=style, **look)


def _shown(trace: Trace) -> int:
    return thinned(trace.t, trace.t)[0].size


def _plain(colour: str) -> dict[str, Any]:
    return {"color": colour, "linewidth": 1.1}


def told_apart(i: int, count: int, colour: str, size: int) -> dict[str, Any]:
    """Return the style of the i-th of several lines that may coincide, the last at the bottom.

    A lower line is wider, so that it is visible on both sides; each line has its own marks at its
    own places. size: samples of the line.
    """
    if count == 1:
        return _plain(colour)
    every = max(1, size // MARKS)
    return {
        "color": colour, "linewidth": 1.1 + 1.3 * i, "marker": SHAPES[i % len(SHAPES)],
        "markersize": 5.0 + i, "markeredgecolor": "white", "markeredgewidth": 0.6,
        "markevery": (round((i + 0.5) * every / count), every),
    }  # fmt: skip


def thinned(t: Floats, values: Floats, columns: int = COLUMNS) -> tuple[Floats, Floats]:
    """Return a line that looks the same: the lowest and highest value in each column of pixels."""
    size = -(-values.size // columns)
    if size <= 2:
        return t, values
    starts = np.arange(0, values.size, size)
    ends = np.column_stack(
        [np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)]
    )
    return np.repeat(t[starts], 2), ends.ravel()


def _scale(axes: Axes, trace: Trace, names: Sequence[str]) -> None:
    values = np.concatenate([np.abs(trace[name]) for name in names])
    first = min(EARLY, len(trace) // 20 + 1)
    early = np.concatenate([np.abs(trace[name][:first]) for name in names])
    start, most = early.max(), values[np.isfinite(values)].max(initial=0.0)
    if 0.0 < LOST * start < most:
        axes.set_yscale("symlog", linthresh=start)
        axes.yaxis.set_major_locator(FixedLocator(_few_decades(start, most)))


def _few_decades(start: float, most: float) -> list[float]:
    """Zero and, on both sides, so few powers of ten that their labels do not touch."""
    lowest, highest = math.floor(math.log10(start)) + 1, math.floor(math.log10(most))
    step = max(1, (highest - lowest) // 3)
    powers = [10.0**k for k in range(highest, lowest + step // 3, -step)]
    return [*(-p for p in powers), 0.0, *powers]


def _shade_contact(axes: Axes, trace: Trace) -> None:
    touching = trace["contact"] != 0.0
    if touching.all() or not touching.any():
        return
    edges = np.flatnonzero(np.diff(touching.astype(np.int8), prepend=0, append=0))
    last = trace.t.size - 1
    for start, stop in edges.reshape(-1, 2)[: COLUMNS // 2]:
        axes.axvspan(float(trace.t[start]), float(trace.t[min(stop, last)]), color="0.93", zorder=0)


def _span(t: Floats) -> tuple[float, float]:
    return float(t[0]), float(t[-1]) if t.size > 1 else float(t[0]) + 1.0

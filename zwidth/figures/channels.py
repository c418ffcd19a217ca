"""Signals of any recording over time, with a panel for each unit."""

from matplotlib import rc_context
from matplotlib.figure import Figure

from zwidth.figures.run import thinned, told_apart
from zwidth.figures.style import COLOURS, STYLE
from zwidth.sim.trace import Trace

QUANTITIES = {
    "rad": "position", "m": "position", "rad/s": "velocity", "m/s": "velocity",
    "rad/s2": "acceleration", "m/s2": "acceleration", "N m": "torque", "N": "force", "J": "energy",
}  # fmt: skip
PANEL = 1.9  # height in inches


def channels_figure(trace: Trace, title: str = "") -> Figure:
    """Return the channels over time, those of one unit in one panel."""
    every = list(dict.fromkeys(trace.units[name] for name in trace.channels))
    with rc_context(STYLE):
        height = 0.9 + PANEL * max(1, len(every))
        figure = Figure(figsize=(7.2, height), layout="constrained")
        panels = figure.subplots(max(1, len(every)), 1, sharex=True, squeeze=False)[:, 0]
        for axes, unit in zip(panels, every, strict=False):
            names = [name for name in trace.channels if trace.units[name] == unit]
            for k, name in reversed(list(enumerate(names))):
                t, values = thinned(trace.t, trace[name])
                label = name.replace("_", " ")
                look = told_apart(k, len(names), COLOURS[k % len(COLOURS)], t.size)
                axes.plot(t, values, label=label, **look)
            axes.set_ylabel(f"{QUANTITIES.get(unit, 'value')} [{unit or '-'}]")
            axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.02))
        panels[0].set_title(title or "Signals over time", wrap=True)
        panels[-1].set_xlabel("time [s]")
    return figure

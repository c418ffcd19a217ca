"""The Z-width over a setting of the interface, and the boundaries whose area it is."""

import math

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from zwidth.figures.style import COLOURS, DASHES, SHAPES, STYLE, headed
from zwidth.sim.readable import plain, scaled, with_unit
from zwidth.stability.sweep import WHOLE, Step, Sweep

NAMES = {
    "cutoff": "cut-off of the velocity filter", "period": "period", "delay": "delay",
    "encoder_step": "encoder step", "velocity_ticks": "samples from one velocity to the next",
    "position_ticks": "samples from one position of the law to the next",
}  # fmt: skip
SHOWN = 4  # most boundaries
NO_FILTER = 1.6  # place of "no filter", over the highest cut-off


def sweep_figure(result: Sweep) -> Figure:
    """Draw the Z-width over the setting, and boundaries at some of its values, the best among them.

    Lines are linear theory, dots simulations. "No filter" is at the right end, separated.
    """
    with rc_context(STYLE):
        figure = Figure(figsize=(10.0, 4.4), layout="constrained")
        left, right = figure.subplots(1, 2)
        _areas(left, result)
        _boundaries(right, result)
        headed(figure, f"Z-width of {result.device.name}")
    return figure


def _areas(axes: Axes, result: Sweep) -> None:
    steps, best = result.steps, result.best
    finite = np.array([s.value for s in steps if math.isfinite(s.value)])
    positive = finite[finite > 0.0]
    ratios = positive.size == finite.size and positive.max() > 4.0 * positive.min()
    factor, unit = _axis(result, finite)
    values = [factor * s.value for s in steps]
    places = [v if math.isfinite(v) else NO_FILTER * factor * finite.max() for v in values]
    inner = [i for i, s in enumerate(steps) if math.isfinite(s.value)]
    theory = np.array([s.linear_area for s in steps])
    seen = np.array([s.area for s in steps])
    if result.best_by_theory is not None:
        axes.plot(np.array(places)[inner], theory[inner], color=COLOURS[0], label="linear theory")
    axes.plot(places, seen, color=COLOURS[1], linestyle="none", marker="o", label="simulated")
    outer = [i for i in range(len(steps)) if i not in inner]
    axes.plot(np.array(places)[outer], theory[outer], color=COLOURS[0], linestyle="none",
              marker="_", markersize=10)  # fmt: skip
    axes.axvline(places[steps.index(best)], color="0.6", linestyle=":", linewidth=1.0)
    if ratios:
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_locator(NullLocator())
    if outer:
        axes.annotate("none", (places[outer[0]], seen[outer[0]]), textcoords="offset points",
                      xytext=(0, 7), ha="center", fontsize=8)  # fmt: skip
    force, length = ("N m", "rad") if result.device.rotary else ("N", "m")
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel(NAMES[result.setting] + unit)
    axes.set_ylabel(f"area of stable walls [({force}/{length})$^2$ s]")
    axes.set_title(f"widest at {_said(result, best)}")
    axes.legend()


def _boundaries(axes: Axes, result: Sweep) -> None:
    for i, step in enumerate(_some(result)):
        axes.plot(step.dampings, _known(step.linear), color=COLOURS[i], linestyle=DASHES[i])
        label = _said(result, step) + (", the best" if step is result.best else "")
        axes.plot(step.dampings, _known(step.simulated), color=COLOURS[i], linestyle="none",
                  marker=SHAPES[i], markersize=3.5, label=label)  # fmt: skip
    force, length = ("N m", "rad") if result.device.rotary else ("N", "m")
    axes.set_xlabel(f"virtual damping $B$ [{force} s/{length}]")
    axes.set_ylabel(f"critical stiffness [{force}/{length}]")
    axes.set_xlim(left=0.0)
    axes.set_ylim(bottom=0.0)
    axes.set_title("stable below")
    axes.legend()


def _known(values: np.ndarray) -> np.ndarray:
    """Leave out where no K is stable."""
    return np.where(values > 0.0, values, np.nan)


def _some(result: Sweep) -> list[Step]:
    """The best, the device as it is, and the ends."""
    steps = result.steps
    wanted = [result.best, *([result.without] if result.without else []), steps[0], steps[-1]]
    wanted += [steps[len(steps) // 4], steps[len(steps) // 2], steps[3 * len(steps) // 4]]
    some = list(dict.fromkeys(step.value for step in wanted if step.area > 0.0))[:SHOWN]
    return [step for step in steps if step.value in some]


def _said(result: Sweep, step: Step) -> str:
    if not math.isfinite(step.value):
        return "no filter"
    if result.setting in WHOLE:
        return f"every {plain(step.value)} samples" if step.value > 1.0 else "every sample"
    return with_unit(step.value, result.unit, 3)


def _axis(result: Sweep, values: np.ndarray) -> tuple[float, str]:
    """Return the factor of an axis and what its label says of the unit."""
    if result.setting in WHOLE:
        return 1.0, ""
    factor, unit = scaled(float(np.median(values)), result.unit)
    return factor, f" [{unit}]"

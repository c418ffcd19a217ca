"""Parameters of a fleet: each recording's value, the pooled value, and the odd recordings."""

import math
from collections.abc import Sequence
from datetime import timedelta
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from numpy.typing import NDArray

from zwidth.figures.style import AFTER, BEFORE, COLOURS, INTERVAL, STYLE
from zwidth.fleet.reasons import in_words
from zwidth.fleet.result import Fleet, Member
from zwidth.sim.readable import scaled

Floats = NDArray[np.float64]
SOUND, ODD, CHANGED, BAND = AFTER, BEFORE, COLOURS[2], INTERVAL
NEAR = 8.0  # deviations beyond which an odd value is drawn at the edge
HIGH = 2.1  # inches per parameter


def fleet_figure(fleet: Fleet) -> Figure:
    """Return a row for each parameter, over the dates, or over recordings without dates."""
    names = list(fleet.spreads)
    with rc_context(STYLE):
        figure = Figure(figsize=(8.0, 0.9 + HIGH * max(1, len(names))), layout="constrained")
        rows = figure.subplots(max(1, len(names)), 1, squeeze=False, sharex=True)[:, 0]
        for ax, name in zip(rows, names, strict=False):
            _parameter(ax, fleet, name)
        dated = _dated(fleet)
        if dated:
            locator = AutoDateLocator()
            rows[-1].xaxis.set_major_locator(locator)
            rows[-1].xaxis.set_major_formatter(ConciseDateFormatter(locator))
        rows[-1].set_xlabel("date, devices side by side" if dated else "recording")
        handles, labels = rows[0].get_legend_handles_labels()
        for ax in rows[1:]:
            for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
                if label not in labels:
                    handles.append(handle)
                    labels.append(label)
        figure.legend(handles, labels, loc="outside lower center", ncols=2)
    return figure


def _dated(fleet: Fleet) -> bool:
    return all(m.listed.date is not None for m in fleet.members)


def _parameter(ax: Axes, fleet: Fleet, name: str) -> None:
    s, place = fleet.spreads[name], list(fleet.names).index(name)
    members = [m for m in fleet.members if not m.quick.problem]
    dated = _dated(fleet)
    x: list[Any] = _beside(members) if dated else list(range(len(members)))
    y = _at_the_mean(fleet, members, name)
    error = np.array([m.quick.errors[place] for m in members])
    odd = np.array([not m.pooled for m in members])
    size = max(abs(s.center.value), 1e-300)
    factor, unit = scaled(size, fleet.names[name])
    spread = float(np.std(y[~odd])) if np.any(~odd) else 0.0
    wide = max(spread, 0.02 * size)
    low, high = s.center.value - NEAR * wide, s.center.value + NEAR * wide
    low = min(low, float(y[~odd].min(initial=low)))
    shown = np.clip(y, low, high)
    # Error bars of hundreds of recordings merge into a grey area: drawn only for few recordings.
    bars = np.where(np.isfinite(error), 1.96 * error, 0.0)
    changed = {c.device for c in fleet.changes if c.parameter == name}
    drifts = np.array([m.listed.device in changed for m in members]) & ~odd
    deviation = math.hypot(s.tau_device, s.tau_run)
    for which, color, label, marker in (
        (~odd & ~drifts, SOUND, "a recording, 95 %", "o"),
        (drifts, CHANGED, "a device that changed", "D"),
        (odd, ODD, "unlike the others (at the edge: off the scale)", "x"),
    ):
        if not np.any(which):
            continue
        at = [v for v, take in zip(x, which, strict=True) if take]
        yerr = factor * bars[which] if len(members) <= 200 else None
        if color == ODD:
            yerr = None
        ax.errorbar(
            at, factor * shown[which], yerr, fmt=marker, color=color, markersize=3.5,
            linewidth=0.8, linestyle="none", label=label, alpha=0.8,
        )  # fmt: skip
    for device in sorted(changed):
        own = [m.pooled and m.listed.device == device for m in members]
        days = [at for at, mine in zip(x, own, strict=True) if mine]
        course = [factor * v for v, mine in zip(y, own, strict=True) if mine]
        ax.plot(days, course, color=CHANGED, linewidth=1.0)
    if deviation > 0.0 and not s.slopes:
        centre = s.center.value
        ax.axhspan(
            factor * (centre - 1.96 * deviation), factor * (centre + 1.96 * deviation),
            color=BAND, zorder=0, label="95 % of the fleet",
        )  # fmt: skip
    ax.axhline(factor * s.center.value, color="0.4", linewidth=1.0)
    ax.set_title(_title(fleet, name))
    ax.set_ylabel(f"[{unit or '1'}]")


def _beside(members: Sequence[Member]) -> list[Any]:
    """The dates, shifted a little for each device, so that no point hides another."""
    days = sorted({m.listed.date for m in members if m.listed.date is not None})
    gaps = [b - a for a, b in pairwise(days)]
    room = 0.5 * min(gaps) if gaps else timedelta(days=1)
    devices = sorted({m.listed.device for m in members})
    places = {d: (k + 0.5) / len(devices) - 0.5 for k, d in enumerate(devices)}
    return [
        None if m.listed.date is None else m.listed.date + places[m.listed.device] * room
        for m in members
    ]


def _at_the_mean(fleet: Fleet, members: Sequence[Member], name: str) -> Floats:
    """Each recording's value of a parameter, converted to the mean of what it follows."""
    place = list(fleet.names).index(name)
    values = np.array([float(m.quick.values[place]) for m in members])
    for column, slope in fleet.spreads[name].slopes.items():
        mean = float(np.mean([o.listed.known[column] for o in fleet.members if o.pooled]))
        values -= slope.value * (np.array([m.listed.known[column] for m in members]) - mean)
    return values


def _title(fleet: Fleet, name: str) -> str:
    s = fleet.spreads[name]
    levels = [word for has, word in ((s.per_device, "per device"), (s.per_run, "per run")) if has]
    follows = [column.partition(" [")[0] for column in s.slopes]
    levels += [f"depends on {quantity}; shown for the mean {quantity}" for quantity in follows]
    words = in_words(name).rstrip(",")
    return f"{words}: {', '.join(levels) or 'shared by all'}"

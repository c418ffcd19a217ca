"""A recorded or simulated signal over time."""

from typing import TYPE_CHECKING

import numpy as np

from zwidth.sim.trace import Floats, Trace
from zwidth.views.table import Table, number
from zwidth.views.units import rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset

NOT_DRAWN = ("contact", "at_rest", "encoder", "velocity_estimate")  # in a run without a wall
HEADINGS = ("channel", "unit", "lowest", "highest", "rms", "at the end")


def table(trace: Trace) -> Table:
    """Return a row per channel."""
    device = trace.facts.get("device", trace.facts.get("recording", ""))
    what = f"Trace, {trace.origin}" + (f", {device}" if device else "")
    return Table(f"{what}: {extent(trace.t)}", _warnings(trace), *grid(trace))


def grid(trace: Trace) -> tuple[tuple[str, ...], list[list[str]]]:
    """Return headings and rows, a row per channel."""
    return HEADINGS, [
        [name, trace.units[name] or "-", *(number(v) for v in _figures(values))]
        for name, values in trace.channels.items()
    ]


def extent(t: Floats) -> str:
    """Return number, duration and interval of the samples."""
    if t.size < 2:
        return f"{t.size} sample(s)"
    period = 1e3 * float(np.median(np.diff(t)))
    return f"{t.size} samples, {t[0]:.4g} to {t[-1]:.4g} s, every {period:.4g} ms"


def _figures(values: Floats) -> tuple[float, ...]:
    known = values[np.isfinite(values)]
    if known.size == 0:
        return (np.nan,) * 4
    with np.errstate(over="ignore"):
        rms = float(np.sqrt(np.mean(known**2)))
    return float(known.min()), float(known.max()), rms, float(values[-1])


def _warnings(trace: Trace) -> list[str]:
    said = trace.facts.get("warnings", ())
    return [f"{one}." for one in said] if isinstance(said, list | tuple) else []


def dataset(trace: Trace) -> "Dataset":
    """Return every channel over time."""
    columns = {name: (values, trace.units[name]) for name, values in trace.channels.items()}
    return rows("time", (trace.t, "s"), columns, {**trace.facts, "origin": trace.origin})


def drawn(trace: Trace, title: str) -> "Figure":
    """Return the picture of a run at a wall, else the signals over time by their units."""
    if "contact" in trace.channels and np.any(trace["contact"]):
        from zwidth.figures.run import run_figure

        return run_figure(trace, title)
    from zwidth.figures.channels import channels_figure

    shown = {n: v for n, v in trace.channels.items() if n not in NOT_DRAWN}
    return channels_figure(trace.with_channels(shown), title)


def _drawn(trace: Trace) -> "Figure":
    return drawn(trace, str(trace.facts.get("device", trace.facts.get("recording", ""))))


PICTURES = {"signals": _drawn}

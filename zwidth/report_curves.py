"""Curves of a report that can be zoomed: runs as data, drawn by uPlot, inside the same file."""

import base64
from collections.abc import Sequence
from importlib.resources import files
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from zwidth.diagnosis.answer.whole_run import WholeRun
from zwidth.figures.style import HELD_OUT, MEASURED, ON_DARK
from zwidth.sim.readable import percent, scaled, with_unit

MOST = 120_000  # numbers in all curves, so that a report stays below 3 MB
WIDE = 7.0  # width of the measured line in pixels, visible on both sides of another line
DASHES = {"-": [], "--": [8, 4], ":": [2, 3]}
# run -> label, colour, dashes, as in the pictures of a report
Lines = dict[str, tuple[str, str, str]]


def curves_of(runs: Sequence[WholeRun], lines: Lines) -> list[dict[str, Any]]:
    """Return runs as a page's data: the measurement, and the error of each simulated run.

    Of long runs every k-th sample is used, so that all together have at most `MOST` numbers. Values
    are in a suitable unit, as 32-bit floats in base64; an overflow is NaN.
    """
    shown = [(run, [name for name in lines if name in run.simulated]) for run in runs]
    total = sum(run.measured.size * (1 + len(names)) for run, names in shown)
    every = max(1, -(-total // MOST))
    return [_curve(run, {name: lines[name] for name in names}, every) for run, names in shown]


def _curve(run: WholeRun, lines: Lines, every: int) -> dict[str, Any]:
    from matplotlib.colors import to_hex  # "0.6" of matplotlib is not a colour for browsers

    factor, unit = scaled(float(np.abs(run.measured).max()), run.unit)
    quantity, _, at = run.output.partition("_")
    measured = np.where(run.known, run.measured, np.nan)
    held = "kept out of the fit (tinted)" if run.held_out else "part of the fit"
    name = f"{run.recording}, {quantity} of {at}, {held}"
    if every > 1:
        name += f", one of {every} samples"
    return {
        "name": name, "quantity": quantity, "unit": unit,
        "begins": run.begins, "period": run.period * every,
        "measured": _encoded(factor * measured[::every]),
        "under": {"colour": MEASURED, "dark": ON_DARK[MEASURED], "width": WIDE},
        "ground": {"colour": HELD_OUT, "dark": ON_DARK[HELD_OUT]} if run.held_out else None,
        "runs": [
            {
                "label": label,
                "colour": to_hex(colour), "dark": ON_DARK.get(colour, to_hex(colour)),
                "dashes": DASHES[dashes], "rms": _rms(run, line),
                "error": _encoded(factor * (run.simulated[line] - measured)[::every]),
            }
            for line, (label, colour, dashes) in lines.items()
        ],
    }  # fmt: skip


def _rms(run: WholeRun, line: str) -> str:
    """The error of a simulated run, as the picture's legend says it."""
    size = run.errors[line]
    if not np.isfinite(size):
        return "runs away"
    return f"error {with_unit(size, run.unit, 3)} rms ({percent(run.shares[line])})"


def _encoded(values: NDArray[np.float64]) -> str:
    with np.errstate(all="ignore"):
        return base64.b64encode(values.astype("<f4").tobytes()).decode()


def program() -> dict[str, Markup]:
    """Return the style and scripts that draw them: those of zwidth and uPlot."""
    package = files("zwidth")
    parts = {
        "style": package / "uplot" / "uPlot.min.css",
        "library": package / "uplot" / "uPlot.iife.min.js",
        "script": package / "report_curves.js",
    }
    return {name: Markup(file.read_text(encoding="utf-8")) for name, file in parts.items()}

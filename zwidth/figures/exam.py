"""Pictures of an exam: confusions of effects, success over their size, reliability."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from zwidth.figures.style import AFTER, COLOURS, FILE, STYLE, headed


def confusion_figure(found: Mapping[str, Any]) -> Figure:
    """Return concealed effects (rows) against the effect named first (columns), in counts.

    found: `confusion` in the JSON of `zwidth exam`. Colour is the share of the row.
    """
    rows, columns = found["rows"], found["columns"]
    counts = np.array(found["counts"], dtype=np.float64).reshape(len(rows), len(columns))
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1.0)
    with rc_context(STYLE):
        figure = Figure(
            figsize=(0.36 * len(columns) + 3.0, 0.30 * len(rows) + 2.6), layout="constrained"
        )
        axes = figure.subplots()
        axes.grid(visible=False)
        axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
        for (i, j), count in np.ndenumerate(counts):
            if count:
                colour = "white" if shares[i, j] > 0.6 else "black"
                axes.text(j, i, f"{count:.0f}", ha="center", va="center", color=colour, fontsize=8)
        _name(axes, rows, columns)
        headed(
            figure, "Single effects: what was named first,\nin counts (colour: share of the row)"
        )
    return figure


def _name(axes: Axes, rows: Sequence[str], columns: Sequence[str]) -> None:
    axes.set_xticks(range(len(columns)), [_words(c) for c in columns], rotation=60, ha="right")
    axes.set_yticks(range(len(rows)), [_words(r) for r in rows])
    axes.set_xlabel("named first")
    axes.set_ylabel("concealed")


def _words(name: str) -> str:
    return name.replace("_", " ")


def magnitude_figure(found: Sequence[Mapping[str, Any]]) -> Figure:
    """Return shares with exact 95 % intervals against the magnitude in units of the limit.

    found: `by_magnitude` in the JSON of `zwidth exam`.
    """
    with rc_context(STYLE):
        figure = Figure(figsize=(6.4, 3.8), layout="constrained")
        axes = figure.subplots()
        for key, label, colour, shift in (
            ("first_where_apart", "named first, where it stands apart", AFTER, 0.97),
            ("in_class", "in the class named", COLOURS[2], 1.03),
        ):
            bins = [row for row in found if row[key]["count"]]
            x = shift * np.array([np.sqrt(row["from"] * row["to"]) for row in bins])
            y = np.array([row[key]["share"] for row in bins])
            ends = np.array([row[key]["ci95"] for row in bins]).reshape(-1, 2)
            reach = np.abs(ends.T - y)
            axes.errorbar(x, y, reach, fmt="o-", color=colour, label=label, capsize=2)
        edges = sorted({end for row in found for end in (row["from"], row["to"])}) or [1.0, 100.0]
        axes.set_xscale("log")
        axes.set_xlim(edges[0], edges[-1])
        axes.set_xticks(edges, [f"{edge:.3g}" for edge in edges], minor=False)
        axes.minorticks_off()
        axes.set_ylim(0.0, 1.03)
        axes.set_xlabel("magnitude, in units of the limit (5 sigma)")
        axes.set_ylabel("share")
        axes.set_title("Single effects, with exact 95 % intervals")
        figure.legend(loc="outside upper left", ncols=2)
    return figure


def reliability_figure(found: Mapping[str, Any]) -> Figure:
    """Return the share of true statements over their stated probability.

    found: `calibration` in the JSON of `zwidth exam`. The area of a point grows with the statements
    in it; bars are exact 95 % intervals.
    """
    with rc_context(STYLE):
        figure = Figure(figsize=(4.4, 4.2), layout="constrained")
        axes = figure.subplots()
        axes.plot([0.0, 1.0], [0.0, 1.0], color=FILE, linewidth=1.0)
        table = found["table"]
        x = np.array([row["said"] for row in table])
        y = np.array([row["seen"]["share"] for row in table])
        ends = np.array([row["seen"]["ci95"] for row in table]).reshape(-1, 2)
        counts = np.array([row["seen"]["count"] for row in table], dtype=np.float64)
        axes.errorbar(x, y, np.abs(ends.T - y), fmt="none", ecolor=AFTER, capsize=2)
        axes.scatter(x, y, 12.0 + 150.0 * counts / max(counts.sum(), 1.0), color=AFTER)
        axes.set_xlim(-0.02, 1.02)
        axes.set_ylim(-0.02, 1.02)
        axes.set_xlabel("probability that was stated")
        axes.set_ylabel("share of statements that are true")
        error = found["expected_error"]
        said = f"{found['statements']} statements"
        axes.set_title(f"{said}, calibration error {error:.3f}" if table else "none was stated")
    return figure

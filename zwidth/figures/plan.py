"""What a recording would show: the smallest magnitude of each effect, and which look alike."""

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator
from numpy.typing import NDArray

from zwidth.diagnosis.answer.words import effect_in_words
from zwidth.figures.style import AFTER, SHADES, STYLE
from zwidth.planning.limits import SHOWN
from zwidth.planning.plan import ALIKE, Plan, Visible
from zwidth.sim.readable import plain, with_unit

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]
DOT = AFTER
# Distance in sigma, from alike (dark) to apart (white): grey levels tell it in print too.
NEAR = 10.0  # sigma, from which on two effects are not drawn as a pair
EDGES = (0.0, 1.0, 2.5, SHOWN, NEAR, 1e9)
WIDTH = 8.0  # inches: the width of a page, so that its labels are as large as the text there
ROW = 0.19  # inches
TEXT = 8.5  # points


def plan_figure(plan: Plan, title: str) -> Figure:
    """Return limits as shares of what the experiment moves by; below them distances of near pairs.

    Limits of friction, play and mass have no common unit, so the axis is the share of what would
    be all of it (a friction as large as the command), and the value itself stands beside the dot.
    """
    shown = [v for v in plan.visible if v.magnitude is not None]
    distances, near = _near(plan)
    rows = max(len(shown), 8), max(near.size, 8)
    with rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 4.0 + ROW * sum(rows)), layout="constrained")
        limits, pairs = figure.subplots(2, 1, height_ratios=rows)
        _limits(limits, shown)
        _pairs(pairs, distances[np.ix_(near, near)], [plan.labels[i] for i in near])
        figure.suptitle(title, fontsize=11)
    return figure


def _limits(axes: Axes, shown: list[Visible]) -> None:
    shares = [100.0 * (v.magnitude or np.nan) / v.natural for v in shown]
    places = np.arange(len(shown))
    axes.hlines(places, min(shares) / 3.0, shares, color="0.85", linewidth=0.8)
    axes.plot(shares, places, "o", color=DOT, markersize=4.5)
    for share, place, visible in zip(shares, places, shown, strict=True):
        text = f"  {limit_in_words(visible)}"
        axes.annotate(text, (share, place), va="center", fontsize=TEXT)
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(numticks=6))
    axes.set_xlim(min(shares) / 3.0, max(shares) * 60.0)
    axes.set_yticks(places, [named(v.label) for v in shown], fontsize=TEXT)
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.grid(axis="y", visible=False)
    axes.xaxis.set_major_formatter(lambda x, _: f"{x:g} %")
    axes.set_xlabel(
        "relative to the command or the motion; beside each dot its value",
        fontsize=9,
    )
    axes.set_title(
        f"Smallest magnitude that shows with {SHOWN:g} sigma, after a linear refit", fontsize=10
    )


def _near(plan: Plan) -> tuple[Floats, Indices]:
    """Return the distance of each pair, and which effects are near to any other."""
    distances = np.minimum(plan.distances, plan.distances.T)
    np.fill_diagonal(distances, np.nan)
    return distances, np.flatnonzero((distances < NEAR).any(axis=0))


def _pairs(axes: Axes, distances: Floats, labels: list[str]) -> None:
    norm = BoundaryNorm(EDGES, len(SHADES))
    picture = axes.imshow(distances, cmap=ListedColormap(SHADES), norm=norm, aspect="auto")
    places = np.arange(len(labels))
    names = [named(label) for label in labels]
    axes.set_xticks(places, names, rotation=90, fontsize=TEXT)
    axes.set_yticks(places, names, fontsize=TEXT)
    axes.set_xticks(places - 0.5, minor=True)
    axes.set_yticks(places - 0.5, minor=True)
    axes.grid(visible=False, which="major")
    axes.grid(color="0.9", linewidth=0.4, which="minor")
    axes.tick_params(which="minor", length=0)
    for i, j in np.argwhere(distances < SHOWN):
        axes.text(j, i, f"{distances[i, j]:.0f}", ha="center", va="center", fontsize=8,
                  color="white" if distances[i, j] < EDGES[2] else "black")  # fmt: skip
    axes.set_title(
        f"Pairs nearer than {NEAR:g} sigma, at {ALIKE:g} times that magnitude", fontsize=10
    )
    bar = axes.figure.colorbar(picture, ax=axes, shrink=0.5, aspect=25, ticks=EDGES[:-1])
    bar.set_label("distance [sigma]; below 5 the two look alike", fontsize=9)
    bar.ax.set_yticklabels([f"{edge:g}" for edge in EDGES[:-1]], fontsize=9)


def limit_in_words(visible: Visible) -> str:
    """Return the value of a limit and the share that is drawn: "110 µN m (0.05 %)"."""
    magnitude = visible.magnitude or np.nan
    share = plain(100.0 * magnitude / visible.natural, 2)
    return f"{with_unit(magnitude, visible.unit, 2)} ({share} %)"


def named(label: str) -> str:
    """Return effect@place as words."""
    effect, at = label.split("@")
    return f"{effect_in_words(effect)}, {at}"

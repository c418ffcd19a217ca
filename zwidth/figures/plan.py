"""What a recording would show: the smallest size of each effect, and effects that look alike."""

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator
from numpy.typing import NDArray

from zwidth.diagnosis.answer.words import effect_in_words
from zwidth.figures.style import AFTER, SHADES, STYLE, headed
from zwidth.planning.limits import SHOWN
from zwidth.planning.plan import ALIKE, Plan, Visible
from zwidth.sim.readable import plain, scaled, with_unit

Floats = NDArray[np.float64]
DOT = AFTER
# Distance in sigma, from alike (dark) to apart (white), which is also clear in grey print.
EDGES = (0.0, 1.0, 2.5, SHOWN)
FAR = 100.0  # ratio to the smallest, above which the largest is written with its own unit
WIDTH = 8.0  # inches: the width of a page, so that its labels are as large as the text there
ROW = 0.23  # inches
TEXT = 9  # points


def plan_figure(plan: Plan, title: str) -> Figure:
    """Return a figure of the limits as shares of the experiment's motion, and of alike effects.

    Each effect has a row, with a dot for each of its places. Limits of friction, play and mass have
    no common unit, so the axis is a share of the largest conceivable value (a friction as large as
    the command), and the value itself is written beside the dots.
    """
    groups: dict[str, list[Visible]] = {}
    for visible in plan.visible:
        if visible.magnitude is not None:
            groups.setdefault(visible.label.split("@")[0], []).append(visible)
    shown = sorted(groups.values(), key=lambda group: min(map(_share, group)))
    distances, names = _alike(plan)
    rows = [max(len(shown), 4), *([max(len(names), 4)] if names else [])]
    with rc_context(STYLE):
        height = 1.8 * len(rows) + ROW * sum(rows)
        figure = Figure(figsize=(WIDTH, height), layout="constrained")
        panels = figure.subplots(len(rows), 1, height_ratios=rows, squeeze=False)[:, 0]
        _limits(panels[0], shown)
        if names:
            _pairs(panels[1], distances, names)
        headed(figure, title)
    return figure


def _share(visible: Visible) -> float:
    """Return a limit in percent of what would be all of it."""
    return 100.0 * (visible.magnitude or np.nan) / visible.natural


def _limits(axes: Axes, shown: list[list[Visible]]) -> None:
    shares = [[_share(visible) for visible in group] for group in shown]
    every = [share for group in shares for share in group]
    left = min(every) / 3.0
    for place, (group, visibles) in enumerate(zip(shares, shown, strict=True)):
        axes.hlines(place, left, max(group), color="0.85", linewidth=0.8)
        axes.plot(group, [place] * len(group), "o", color=DOT, markersize=4.5)
        axes.annotate(f"  {limits_in_words(visibles)}", (max(group), place), va="center",
                      fontsize=TEXT)  # fmt: skip
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(numticks=6))
    axes.set_xlim(left, max(every) * 60.0)
    axes.set_yticks(range(len(shown)), [_row(group) for group in shown], fontsize=TEXT)
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.grid(axis="y", visible=False)
    axes.xaxis.set_major_formatter(lambda x, _: f"{x:g} %")
    axes.set_xlabel("share of the largest command or motion; one dot per place", fontsize=9)
    axes.set_title(f"Smallest visible magnitude ({SHOWN:g} sigma, after a linear refit)")


def _row(group: list[Visible]) -> str:
    """Return an effect and the places where it may be: "backlash (link12, link23)"."""
    name = effect_in_words(group[0].label.split("@")[0])
    return f"{name} ({', '.join(visible.label.split('@')[1] for visible in group)})"


def _alike(plan: Plan) -> tuple[Floats, list[str]]:
    """Return the distances of effects that look alike, and their names; the nearest places count.

    On the diagonal: one effect at two places.
    """
    effects = np.array([label.split("@")[0] for label in plan.labels])
    distances = np.minimum(plan.distances, plan.distances.T)
    np.fill_diagonal(distances, np.inf)
    names = list(dict.fromkeys(effects))
    nearest = np.array([[distances[np.ix_(effects == a, effects == b)].min() for b in names]
                        for a in names]).reshape(len(names), len(names))  # fmt: skip
    near = np.flatnonzero((nearest < SHOWN).any(axis=0))
    return nearest[np.ix_(near, near)], [effect_in_words(names[i]) for i in near]


def _pairs(axes: Axes, distances: Floats, names: list[str]) -> None:
    once = np.tril(np.ones(distances.shape, dtype=np.bool_))  # each pair once
    seen = np.where(once & (distances < SHOWN), distances, np.nan)
    norm = BoundaryNorm(EDGES, len(EDGES) - 1)
    colours = ListedColormap(SHADES[: len(EDGES) - 1])
    picture = axes.imshow(seen, cmap=colours, norm=norm, aspect="auto")
    places = np.arange(len(names))
    axes.set_xticks(places, names, rotation=90, fontsize=TEXT)
    axes.set_yticks(places, names, fontsize=TEXT)
    axes.set_xticks(places - 0.5, minor=True)
    axes.set_yticks(places - 0.5, minor=True)
    axes.grid(visible=False, which="major")
    axes.grid(color="0.9", linewidth=0.4, which="minor")
    axes.tick_params(which="minor", length=0)
    for i, j in np.argwhere(np.isfinite(seen)):
        axes.text(j, i, f"{seen[i, j]:.1f}", ha="center", va="center", fontsize=TEXT,
                  color="white" if seen[i, j] < EDGES[2] else "black")  # fmt: skip
    axes.set_title(
        f"Effects that look alike at {ALIKE:g} times that magnitude, at their nearest places\n"
        "(on the diagonal: the same effect at two places)",
    )
    bar = axes.figure.colorbar(picture, ax=axes, shrink=0.8, aspect=20, ticks=EDGES)
    bar.set_label("distance [sigma]", fontsize=9)
    bar.ax.set_yticklabels([f"{edge:g}" for edge in EDGES], fontsize=9)


def limits_in_words(group: list[Visible]) -> str:
    """Return the limits of an effect at all its places: "60 to 96 \u00b5N m"."""
    unit = group[0].unit
    sizes = [visible.magnitude or np.nan for visible in group]
    low, high = min(sizes), max(sizes)
    if high > FAR * low:
        return f"{with_unit(low, unit, 2)} to {with_unit(high, unit, 2)}"
    factor, written = scaled(high, unit)
    ends = dict.fromkeys(plain(factor * size, 2) for size in (low, high))
    return f"{' to '.join(ends)} {written}".rstrip()


def named(label: str) -> str:
    """Return effect@place as words."""
    effect, at = label.split("@")
    return f"{effect_in_words(effect)}, {at}"

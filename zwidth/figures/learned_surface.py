"""A learned law over two states: the surface where it was seen, and cuts along both states."""

from typing import cast

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from zwidth.diagnosis.answer.laws import LearnedLaw, LearnedSurface
from zwidth.figures.learned import learned_figure
from zwidth.figures.style import DARK, STYLE
from zwidth.sim.physics.free_force import STATE_UNITS, STATES
from zwidth.sim.readable import plain, scaled

Floats = NDArray[np.float64]
FINE = 120  # states along each axis
SHOWN = 1500  # most samples that are drawn
CUTS = (0.1, 0.5, 0.9)  # quantiles of the other state at which cuts are made
STYLES = ("-", "--", "-.")


def law_figure(law: LearnedLaw | LearnedSurface, rotary: bool) -> Figure:
    """Return the picture of a learned law over one state or two."""
    if isinstance(law, LearnedSurface):
        return learned_surface_figure(law, rotary)
    return learned_figure(law, rotary)


def learned_surface_figure(law: LearnedSurface, rotary: bool) -> Figure:
    """Return a learned surface over both states, and cuts along each with their 95 % band."""
    link = law.curve.physics.place.kind == "link"
    units = [_unit(state, rotary) for state in law.curve.states]
    seen = law.curve.seen
    factors: list[float] = []
    for k in range(2):
        factor, units[k] = scaled(float(np.abs(seen[:, k]).max()), units[k])
        factors.append(factor)
    made, force_unit = scaled(float(np.abs(law.curve.at(*seen.T)).max()), "N m" if rotary else "N")
    names = [f"{what} [{unit}]" for what, unit in zip(law.curve.over, units, strict=True)]
    with rc_context(STYLE):
        figure = Figure(figsize=(6.4, 7.4), layout="constrained")
        above, below = cast(
            tuple[SubFigure, SubFigure], figure.subfigures(2, 1, height_ratios=(1.0, 1.0))
        )
        whole = above.subplots()
        a, b = (np.linspace(float(s.min()), float(s.max()), FINE) for s in seen.T)
        first, second = np.meshgrid(a, b, indexing="ij")
        forces = np.where(_seen(seen, a, b), law.curve.at(first, second), np.nan)
        most = made * float(np.nanmax(np.abs(forces)))
        drawn = whole.pcolormesh(
            factors[0] * a, factors[1] * b, made * forces.T, cmap="RdBu_r", vmin=-most, vmax=most,
            shading="nearest", rasterized=True,
        )  # fmt: skip
        every = max(1, seen.shape[0] // SHOWN)
        whole.plot(*(factors * seen[::every]).T, ".", color="0.35", markersize=0.8,
                   label="samples", rasterized=True)  # fmt: skip
        whole.set_xlabel(names[0])
        whole.set_ylabel(names[1])
        place = law.curve.physics.at
        whole.set_title(f"Unnamed law of {law.over} {'in' if link else 'at'} {place}")
        above.colorbar(drawn, ax=whole, label=f"law [{force_unit}]")
        whole.legend(loc="upper right", markerscale=6.0)
        for axes, along in zip(below.subplots(1, 2, sharey=True), (0, 1), strict=True):
            _cuts(axes, law, along, factors, units, made)
            axes.set_xlabel(names[along])
        below.axes[0].set_ylabel(f"law [{force_unit}]")
    return figure


def _unit(state: str, rotary: bool) -> str:
    unit = STATE_UNITS[STATES.index(state)]
    return unit if rotary else unit.replace("N m", "N").replace("rad", "m")


def _seen(samples: Floats, a: Floats, b: Floats) -> NDArray[np.bool_]:
    """Which of some states (a, b) lie near samples: within a fortieth of the range of either."""
    bins = 40
    edges = [np.linspace(s[0], s[-1], bins + 1) for s in (a, b)]
    count, _, _ = np.histogram2d(*samples.T, bins=edges)
    near = binary_dilation(count > 0)
    i, j = (np.clip(np.searchsorted(e, s, "right") - 1, 0, bins - 1)
            for e, s in zip(edges, (a, b), strict=True))  # fmt: skip
    return near[np.ix_(i, j)]


def _cuts(
    axes: Axes,
    law: LearnedSurface,
    along: int,
    factors: list[float],
    units: list[str],
    made: float,
) -> None:
    """The law over one state at some of the other, where samples with both were near."""
    seen = law.curve.seen
    other = 1 - along
    wide = float(np.ptp(seen[:, other]))
    axes.axhline(0.0, color="0.6", linewidth=0.8)
    cuts = zip(np.quantile(seen[:, other], CUTS).tolist(), DARK, STYLES, strict=True)
    for value, colour, style in cuts:
        near = seen[np.abs(seen[:, other] - value) < 0.05 * wide, along]
        if near.size == 0:
            continue
        s = np.linspace(float(near.min()), float(near.max()), FINE)
        both = [s, np.full(FINE, value)]
        first, second = both if along == 0 else both[::-1]
        f, half = law.curve.at(first, second), law.curve.half(first, second)
        x = factors[along] * s
        axes.fill_between(x, made * (f - half), made * (f + half), color=colour, alpha=0.2,
                          linewidth=0.0)  # fmt: skip
        label = f"{law.curve.over[other]} {plain(factors[other] * value, 3)} {units[other]}"
        axes.plot(x, made * f, color=colour, linestyle=style, linewidth=1.3, label=label)
        if law.formula:
            form = law.formula_at(first, second)
            axes.plot(x, made * form, color=colour, linestyle=":", linewidth=1.0)
    title = "with 95 % band; dotted: formula" if law.formula else "with 95 % band"
    axes.legend(
        loc="upper center", bbox_to_anchor=(0.5, -0.26), title=title,
    )  # fmt: skip

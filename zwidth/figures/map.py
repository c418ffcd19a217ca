"""A map of fates over two quantities, with the linear boundary over it."""

import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from stability.map_store import FateMap
from stability.plane import Fate, Plane

# Told apart by the colour-blind, and by lightness alone in print.
COLOURS = {
    Fate.RESTS: "#f2f2f2",
    Fate.IMPERCEPTIBLE_CYCLE: "#b3d3ec",
    Fate.CYCLE: "#4a90c4",
    Fate.GROWS: "#7f2704",
    Fate.UNDECIDED: "#ffd92f",
}
NAMES = {
    Fate.RESTS: "comes to rest",
    Fate.IMPERCEPTIBLE_CYCLE: "imperceptible oscillation",
    Fate.CYCLE: "sustained oscillation",
    Fate.GROWS: "grows to the limit",
    Fate.UNDECIDED: "undecided in the time given",
}


def axis_label(plane: Plane, quantity: str) -> str:
    """Return the label of an axis, with its unit."""
    angle, force = ("rad", "N m") if plane.device.rotary else ("m", "N")
    return {
        "K": f"virtual stiffness K [{force}/{angle}]",
        "B": f"virtual damping B [{force} s/{angle}]",
        "delay": "delay [s]",
        "encoder_step": f"encoder step [{angle}]",
        "command_limit": f"command limit [{force}]",
        "friction": f"Coulomb friction at m1 [{force}]",
        "amplitude": f"start amplitude [{angle}]",
    }[quantity]


def map_figure(result: FateMap, title: str | None = None, compact: bool = False) -> Figure:
    """Draw fates and, unless compact, the force of the oscillation that stays."""
    figure = Figure(figsize=(5.2, 4.6) if compact else (10.5, 5.2), layout="constrained")
    axes = figure.subplots(1, 1 if compact else 2, squeeze=False)[0]
    draw_fates(axes[0], result)
    if not compact:
        _draw_force(figure, axes[1], result)
    plane = result.plane
    axes[0].set_title("what a run does in the end", fontsize=10)
    if not compact:
        axes[1].set_title("force of what stays", fontsize=10)
    figure.suptitle(title or _title(plane), fontsize=11)
    figure.legend(handles=legend(result), loc="outside lower center", ncols=3, fontsize=8)
    return figure


def draw_fates(axes, result: FateMap) -> None:  # pyright: ignore
    """Draw the fates of a map and the linear boundary into axes."""
    colours = ListedColormap([COLOURS[f] for f in Fate])
    norm = BoundaryNorm(np.arange(len(Fate) + 1) - 0.5, len(Fate))
    axes.pcolormesh(
        result.x, result.y, result.fates.fate, cmap=colours, norm=norm, shading="nearest",
        rasterized=True,
    )  # fmt: skip
    _draw_linear(axes, result)


def legend(result: FateMap) -> list[Patch | Line2D]:
    """Return the legend of the fates that occur in a map, and of the linear boundary."""
    present = [f for f in Fate if np.any(result.fates.fate == f)]
    handles: list[Patch | Line2D] = [
        Patch(facecolor=COLOURS[f], edgecolor="0.5", label=NAMES[f]) for f in present
    ]
    return [*handles, Line2D([], [], color="k", lw=1.6, label="linear boundary")]


def _draw_linear(axes, result: FateMap) -> None:  # pyright: ignore
    plane = result.plane
    if result.linear.min() < 0.0 < result.linear.max():
        axes.contour(result.x, result.y, result.linear, [0.0], colors="k", linewidths=1.6)
    for axis, scale in ((plane.x, axes.set_xscale), (plane.y, axes.set_yscale)):
        scale(axis.spacing)
    axes.set_xlabel(axis_label(plane, plane.x.quantity))
    axes.set_ylabel(axis_label(plane, plane.y.quantity))


def _draw_force(figure: Figure, axes, result: FateMap) -> None:  # pyright: ignore
    cycling = np.isin(result.fates.fate, [Fate.IMPERCEPTIBLE_CYCLE, Fate.CYCLE])
    held = np.isfinite(result.plane.device.interface.command_limit)
    shown = cycling | ((result.fates.fate == Fate.GROWS) & held)
    force = np.where(shown & (result.fates.force > 0.0), result.fates.force, np.nan)
    unit = "N m" if result.plane.device.rotary else "N"
    axes.set_facecolor("#f2f2f2")
    if np.isfinite(force).any():
        low, high = np.nanmin(force), np.nanmax(force)
        mesh = axes.pcolormesh(
            result.x, result.y, force, norm=LogNorm(low, max(high, 1.001 * low)), cmap="cividis",
            shading="nearest", rasterized=True,
        )  # fmt: skip
        figure.colorbar(mesh, ax=axes, label=f"half the range of the command [{unit}]")
    else:
        axes.text(0.5, 0.5, "nothing oscillates on", ha="center", transform=axes.transAxes)
    _draw_linear(axes, result)


def _title(plane: Plane) -> str:
    interface, angle = plane.device.interface, "rad" if plane.device.rotary else "m"
    force = "N m" if plane.device.rotary else "N"
    facts = {
        "K": f"K = {plane.stiffness:g} {force}/{angle}",
        "B": f"B = {plane.damping:g} {force} s/{angle}",
        "delay": f"delay {1e3 * interface.delay:g} ms",
        "encoder_step": f"encoder step {interface.encoder_step:g} {angle}",
        "command_limit": f"limit {interface.command_limit:g} {force}",
        "amplitude": f"start {plane.trial.start:g} {angle}",
    }
    on_axes = (plane.x.quantity, plane.y.quantity)
    return plane.device.name + "\n" + ", ".join(v for k, v in facts.items() if k not in on_axes)

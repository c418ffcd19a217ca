"""A map of fates over two quantities, with the linear boundary over it."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from zwidth.figures.style import FATES, PREDICTED, STYLE, headed, pushing
from zwidth.law_options import said_of
from zwidth.sim.fate import Fate
from zwidth.sim.readable import scaled, with_unit
from zwidth.stability.fate_map import FateMap, units_of
from zwidth.stability.linear import has_theory
from zwidth.stability.plane import Plane
from zwidth.stability.plane_theory import Line, describing_lines

COLOURS = dict(zip(Fate, FATES, strict=True))
FEWEST_TICKS = 3
NAMES = {
    Fate.RESTS: "comes to rest",
    Fate.DITHERS: "dithers, not felt",
    Fate.FELT: "dithers and is felt",
    Fate.GROWS: "grows to the limit",
    Fate.UNDECIDED: "undecided in the time given",
}


QUANTITY_NAMES = {
    "K": "virtual stiffness K", "B": "virtual damping B", "delay": "delay",
    "encoder_step": "encoder step", "command_limit": "command limit",
    "friction": "Coulomb friction at m1", "amplitude": "start amplitude",
    "cutoff": "cut-off of the velocity filter",
}  # fmt: skip
SYMBOLS = {"K": "K =", "B": "B =", "command_limit": "limit", "amplitude": "start"}


def axis_label(plane: Plane, quantity: str) -> str:
    """Return the label of an axis, with its unit."""
    return f"{QUANTITY_NAMES[quantity]} [{units_of(plane, quantity)}]"


def map_figure(result: FateMap, title: str | None = None) -> Figure:
    """Draw how runs end, and the force of the oscillation that remains."""
    lines = describing_lines(result.plane)
    with rc_context(STYLE):
        figure = Figure(figsize=(10.5, 5.2), layout="constrained")
        left, right = figure.subplots(1, 2)
        draw_fates(left, result, lines)
        _draw_force(figure, right, result)
        left.set_title("how a run ends")
        what, _ = pushing(result.plane.device.rotary)
        right.set_title(f"{what} of the remaining oscillation")
        headed(figure, title or _title(result.plane))
        handles = legend([result], lines)
        figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


def draw_fates(axes: Axes, result: FateMap, lines: Sequence[Line] = ()) -> None:
    """Draw the fates of a map, the linear boundary and other lines into axes."""
    _fates(axes, result)
    _draw_linear(axes, result)
    for line in lines:
        axes.plot(line.x, line.y, color=PREDICTED, lw=1.6, ls="--")


def _fates(axes: Axes, result: FateMap) -> None:
    """Every point in the colour of its fate."""
    colours = ListedColormap([COLOURS[f] for f in Fate])
    norm = BoundaryNorm(np.arange(len(Fate) + 1) - 0.5, len(Fate))
    axes.pcolormesh(
        result.x, result.y, result.fates.fate, cmap=colours, norm=norm, shading="nearest",
        rasterized=True,
    )  # fmt: skip


def legend(results: Sequence[FateMap], lines: Sequence[Line] = ()) -> list[Patch | Line2D]:
    """Return the legend of the fates that occur in maps, of the linear boundary and the lines."""
    names = names_in([result.plane for result in results])
    present = [f for f in Fate if any(np.any(r.fates.fate == f) for r in results)]
    handles: list[Patch | Line2D] = [
        Patch(facecolor=COLOURS[f], edgecolor="0.5", label=names[f]) for f in present
    ]
    if any(has_theory(result.plane.device) for result in results):
        handles.append(Line2D([], [], color="k", lw=1.6, label="linear boundary"))
    handles += [Line2D([], [], color=PREDICTED, lw=1.6, ls="--", label=n.name) for n in lines]
    return handles


def _draw_linear(axes: Axes, result: FateMap) -> None:
    plane = result.plane
    if result.linear.min() < 0.0 < result.linear.max():
        axes.contour(result.x, result.y, result.linear, [0.0], colors="k", linewidths=1.6)
    for axis, scale in ((plane.x, axes.set_xscale), (plane.y, axes.set_yscale)):
        scale(axis.spacing)
    axes.set_xlabel(axis_label(plane, plane.x.quantity))
    axes.set_ylabel(axis_label(plane, plane.y.quantity))


def names_in(planes: Sequence[Plane]) -> dict[Fate, str]:
    """The names of the fates: growth is stopped by a limit in planes that have one."""
    bounded = [_held(plane) for plane in planes]
    if all(bounded):
        return NAMES
    grows = "grows (to the limit, if any)" if any(bounded) else "grows"
    return {**NAMES, Fate.GROWS: grows}


def _held(plane: Plane) -> bool:
    """Whether a limit of the command holds what grows."""
    on_axis = "command_limit" in (plane.x.quantity, plane.y.quantity)
    return on_axis or bool(np.isfinite(plane.device.interface.command_limit))


def round_ticks(low: float, high: float) -> list[float]:
    """Return at least three round values between two, for a logarithmic bar."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for digits in ((1.0, 3.0), (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)):
        found = [d * 10.0**n for n in decades for d in digits if low <= d * 10.0**n <= high]
        if len(found) >= FEWEST_TICKS:
            return found
    return [float(f"{v:.3g}") for v in np.linspace(low, high, FEWEST_TICKS)]


def _draw_force(figure: Figure, axes: Axes, result: FateMap) -> None:
    cycling = np.isin(result.fates.fate, [Fate.DITHERS, Fate.FELT])
    held = _held(result.plane)
    shown = cycling | ((result.fates.fate == Fate.GROWS) & held)
    force = np.where(shown & (result.fates.force > 0.0), result.fates.force, np.nan)
    unit = units_of(result.plane, "command_limit")
    _fates(axes, result)
    if np.isfinite(force).any():
        factor, unit = scaled(float(np.nanmax(force)), unit)
        force *= factor
        low, high = float(np.nanmin(force)), float(np.nanmax(force))
        high = max(high, 1.001 * low)
        mesh = axes.pcolormesh(
            result.x, result.y, force, norm=LogNorm(low, high), cmap="cividis",
            shading="nearest", rasterized=True,
        )  # fmt: skip
        bar = figure.colorbar(mesh, ax=axes, label=f"half the range of the command [{unit}]")
        bar.set_ticks(ticks := round_ticks(low, high), labels=[f"{t:g}" for t in ticks])
        bar.minorticks_off()
    else:
        axes.text(0.5, 0.5, "nothing oscillates on", ha="center", transform=axes.transAxes,
                  bbox={"facecolor": "white", "edgecolor": "0.7"})  # fmt: skip
    _draw_linear(axes, result)


def _title(plane: Plane) -> str:
    facts = [
        f"{SYMBOLS.get(q, QUANTITY_NAMES[q])} {with_unit(value, units_of(plane, q))}"
        for q, value in plane.at({}).items()
        if q not in (plane.x.quantity, plane.y.quantity)
        and (q, value)
        not in (
            ("friction", 0.0),
            ("encoder_step", 0.0),
            ("command_limit", np.inf),
            ("cutoff", np.inf),
        )
    ]
    facts += [law] if (law := said_of(plane.trial.law, plane.device.rotary)) else []
    estimator = plane.device.interface.velocity_estimator
    facts += [] if estimator == "difference" else [f"velocity by {estimator}"]
    middle = (len(facts) + 1) // 2
    return "\n".join([plane.device.name, ", ".join(facts[:middle]), ", ".join(facts[middle:])])

"""Fig. 6 of the paper with Fig. 10 over it: critical stiffness and ultimate frequency over B."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullLocator
from msgspec import UNSET, UnsetType
from numpy.typing import NDArray

from zwidth.figures.style import COLOURS, DASHES, SHAPES, STYLE
from zwidth.results import BoundaryResult, DelayBoundary, Interval, Point

Floats = NDArray[np.float64]
UNFELT = 0.25  # opacity of walls without felt dither
JUMP = 4.0  # ratio of neighbouring frequencies that means a change of branch
INSET_ROOM = 1.45  # of the picture's width, for the inset
DOTS = 60  # most time-domain brackets shown per delay; each is narrower than its dot


class Look(NamedTuple):
    """How one delay is drawn."""

    colour: str
    dashes: str | tuple[float, tuple[float, ...]]
    shape: str


Value = Callable[[Point], float | None]


class Corner(NamedTuple):
    """The corner at the origin with the passive walls, finely: B, passive K, linear K_CR.

    Each (n,), for B from 0 to about twice the last B with a passive wall; 0 for none.
    """

    damping: Floats
    passive: Floats
    linear: Floats


def boundary_figure(
    result: BoundaryResult, measured_source: str = "measured", corners: Sequence[Corner] = ()
) -> Figure:
    """Return the figure; lines are theory, dots brackets of simulations, open shapes measured.

    corners: of each boundary, if passive walls were requested: they are so near the origin that an
    inset enlarges it. A line ends where no K is stable. A misprinted point is drawn at its
    corrected place, marked by a cross.
    """
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 7.6), layout="constrained")
        stiffness, frequency = figure.subplots(
            2, 1, sharex=True, gridspec_kw={"height_ratios": (3, 2)}
        )
        for i, boundary in enumerate(result.boundaries):
            look = Look(COLOURS[i % 6], DASHES[i % 6], SHAPES[i % 6])
            _draw(stiffness, frequency, boundary, look)
        _label(stiffness, frequency, result)
        if any(corner.passive.any() for corner in corners):
            _inset(stiffness, corners)
        law = "" if result.law is UNSET else f"; dots: {result.law}"
        title = f"Stability boundary of {result.device}{law}"
        stiffness.set_title(title, wrap=True)
        _legend(figure, result, measured_source)
    return figure


def _draw(stiffness: Axes, frequency: Axes, boundary: DelayBoundary, look: Look) -> None:
    points = sorted(boundary.points, key=lambda point: point.damping)
    _line(stiffness, points, lambda p: p.linear and p.linear.stiffness, look, joined=True)
    _line(frequency, points, lambda p: p.linear and p.linear.frequency_hz, look, joined=False)
    stiffness.plot(
        [p.damping for p in points], [_number(_passive(p)) for p in points],
        color=look.colour, linestyle=":",
    )  # fmt: skip
    _unfelt(stiffness, points, look)
    _band(stiffness, points, lambda p: p.hand, look, 0.12)
    _hands(stiffness, points, look)
    _band(stiffness, points, lambda p: p.confidence95, look, 0.3)
    shown = points[:: math.ceil(len(points) / DOTS)]
    dots: dict[str, Any] = {
        "linestyle": "none",
        "marker": ".",
        "color": look.colour,
        "markersize": 5,
    }
    for axes, value in ((stiffness, _middle), (frequency, _simulated_frequency)):
        axes.plot([p.damping for p in shown], [_number(value(p)) for p in shown], **dots)
    for point in points:
        if point.measured is not UNSET:
            _shape(stiffness, point, point.measured.stiffness, look)
            _shape(frequency, point, point.measured.frequency_hz, look)


def _inset(axes: Axes, corners: Sequence[Corner]) -> None:
    """Enlarge the corner at the origin in which walls are passive, above the boundaries' end."""
    left, right = axes.get_xlim()
    axes.set_xlim(left, left + INSET_ROOM * (right - left))
    inset = axes.inset_axes((0.66, 0.42, 0.33, 0.5))
    for i, corner in enumerate(corners):
        look = Look(COLOURS[i % 6], DASHES[i % 6], SHAPES[i % 6])
        there = corner.linear > 0.0
        inset.plot(corner.damping[there], corner.linear[there], color=look.colour,
                   linestyle=look.dashes, linewidth=1.0)  # fmt: skip
        inset.fill_between(corner.damping, corner.passive, color=look.colour, alpha=0.35,
                           linewidth=0.0)  # fmt: skip
        inset.plot(corner.damping, corner.passive, color=look.colour, linestyle=":", linewidth=1.2)
    inset.set_xlim(0.0, max(float(corner.damping[-1]) for corner in corners))
    inset.set_ylim(0.0, 1.6 * max(float(corner.passive.max()) for corner in corners))
    inset.tick_params(labelsize=7)
    inset.locator_params(nbins=4)
    inset.set_title("at the origin: passive walls filled", fontsize=8)


def _line(axes: Axes, points: Sequence[Point], value: Value, look: Look, *, joined: bool) -> None:
    """Draw a curve, broken where it has no value and, unless joined, where the branch changes."""
    x: list[float] = []
    y: list[float] = []
    for point in points:
        now = _number(value(point))
        ratio = now / y[-1] if y else 1.0  # NaN beside a gap is not a jump
        if not joined and (ratio < 1 / JUMP or ratio > JUMP):
            axes.plot([x[-1], point.damping], [y[-1], now], color=look.colour, linewidth=0.6)
            x.append(point.damping)
            y.append(math.nan)
        x.append(point.damping)
        y.append(now)
    axes.plot(x, y, color=look.colour, linestyle=look.dashes)


def _unfelt(axes: Axes, points: Sequence[Point], look: Look) -> None:
    """Fill the walls of which nothing is felt."""
    known = [(p.damping, p.felt) for p in points if p.felt is not UNSET]
    if known:
        most = [felt.stable if felt else 0.0 for _, felt in known]
        axes.fill_between([b for b, _ in known], most, color=look.colour, alpha=UNFELT, linewidth=0)


def _passive(point: Point) -> float | None:
    return point.passive.stiffness if point.passive else None


def _band(
    axes: Axes,
    points: Sequence[Point],
    value: Callable[[Point], Interval | UnsetType],
    look: Look,
    strength: float,
) -> None:
    """Fill between the ends of an interval, where there is one."""
    known = [(point.damping, band) for point in points if (band := value(point)) is not UNSET]
    if known:
        x, bands = zip(*known, strict=True)
        low, high = [b.low for b in bands], [b.high for b in bands]
        axes.fill_between(x, low, high, color=look.colour, alpha=strength, linewidth=0.0)


def _hands(axes: Axes, points: Sequence[Point], look: Look) -> None:
    """Fill between the quantiles over hands, with a thin line at the median."""
    known = [(p.damping, p.hands) for p in points if p.hands is not UNSET]
    if known:
        x = [damping for damping, _ in known]
        low, high = [h.low for _, h in known], [h.high for _, h in known]
        axes.fill_between(x, low, high, color=look.colour, alpha=0.2, linewidth=0.0)
        axes.plot(x, [h.median for _, h in known], color=look.colour, linewidth=0.8)


def _shape(axes: Axes, point: Point, value: float, look: Look) -> None:
    axes.plot(
        point.damping,
        value,
        marker=look.shape,
        markersize=7.5,
        markerfacecolor="white",
        markeredgecolor=look.colour,
        markeredgewidth=1.5,
        zorder=4,
    )
    if point.measured and point.measured.damping_printed is not UNSET:
        axes.plot(point.damping, value, marker="x", markersize=4, color=look.colour, zorder=5)


def _middle(point: Point) -> float | None:
    if point.simulated is None or point.simulated.unstable is None:
        return None
    return 0.5 * (point.simulated.stable + point.simulated.unstable)


def _simulated_frequency(point: Point) -> float | None:
    return point.simulated.frequency_hz if point.simulated else None


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _label(stiffness: Axes, frequency: Axes, result: BoundaryResult) -> None:
    force, length = ("N m", "rad") if result.rotary else ("N", "m")
    stiffness.set_ylabel(f"critical stiffness $K_\\mathrm{{CR}}$ [{force}/{length}]")
    stiffness.set_ylim(bottom=0.0)
    frequency.set_ylabel("ultimate frequency [Hz]")
    frequency.set_yscale("log")
    frequency.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    frequency.yaxis.set_major_formatter("{x:g}")
    frequency.yaxis.set_minor_locator(NullLocator())
    frequency.set_xlabel(f"virtual damping $B$ [{force} s/{length}]")
    frequency.set_xlim(left=min(0.0, *frequency.get_xlim()))


def _legend(figure: Figure, result: BoundaryResult, measured_source: str) -> None:
    """Name delays, then kinds, in rows above the panels, where they cover nothing."""
    delays = [
        Line2D([], [], color=COLOURS[i % 6], linestyle=DASHES[i % 6], marker=SHAPES[i % 6],
               markerfacecolor="white", label=f"delay {1e3 * boundary.delay_s:g} ms")
        for i, boundary in enumerate(result.boundaries)
    ]  # fmt: skip
    points = [point for boundary in result.boundaries for point in boundary.points]
    kinds = [_kind("time domain", ".")]
    if any(point.linear for point in points):
        kinds.insert(0, Line2D([], [], color="0.35", label="linear theory"))
    measured = [point.measured for point in points if point.measured]
    if measured:
        kinds.append(_kind(measured_source, "o", "white"))
    if any(point.damping_printed is not UNSET for point in measured):
        kinds.append(_kind("its $B$ misprinted", "x"))
    if any(point.passive is not UNSET for point in points):
        kinds.append(Line2D([], [], color="0.35", linestyle=":", label="passive walls"))
    if any(point.felt is not UNSET for point in points):
        kinds.append(_patch("nothing felt", UNFELT))
    if any(point.hand is not UNSET for point in points):
        kinds.append(_patch("held by a hand", 0.12))
    if any(point.hands is not UNSET for point in points):
        kinds.append(_patch("5 to 95 % of hands", 0.2))
    if any(point.confidence95 is not UNSET for point in points):
        kinds.append(_patch("95 % by parameters", 0.3))
    cells = _rows_of(4, delays) + _rows_of(4, kinds)
    by_column = [cell for column in range(4) for cell in cells[column::4]]
    figure.legend(handles=by_column, loc="outside upper left", ncols=4)


def _patch(label: str, strength: float) -> Line2D:
    return Line2D([], [], color="0.35", alpha=strength, linewidth=8.0, label=label)


def _kind(label: str, marker: str, face: str = "0.35") -> Line2D:
    return Line2D(
        [], [], color="0.35", linestyle="none", marker=marker, markerfacecolor=face, label=label
    )


def _rows_of(width: int, handles: list[Line2D]) -> list[Line2D]:
    return handles + [Line2D([], [], linestyle="none", label="")] * (-len(handles) % width)

"""Pictures of a diagnosis: the missing force against the state, the residual before and after."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator
from numpy.typing import NDArray

from zwidth.diagnosis.answer.inverse import ForceError
from zwidth.diagnosis.answer.result import Residuals
from zwidth.diagnosis.answer.whole_run import WholeRun
from zwidth.diagnosis.forces.locate import ForceMap, Located
from zwidth.figures.style import (
    AFTER,
    BEFORE,
    FILE,
    HELD_OUT,
    LAW,
    MEASURED,
    STYLE,
    UNDER,
    headed,
    pushing,
)
from zwidth.sim.readable import percent, scaled, with_unit

Floats = NDArray[np.float64]
SLICES = 60
COLUMNS = 800  # of a picture; a line is its lowest and its highest value in each
LEVEL = 0.02  # of its level: of a flatter map only the shape is drawn
ROOM = 1.15  # of the motion: height of a panel
WIDER = 2.0  # largest factor of a panel's height, if it then contains every line
CUT, HIDDEN = ", cut off", ", not shown below"  # after the label of a line
EDGE = 0.12  # of the width of a panel beside another, without labels of time
LETTERS = 18  # total letters of the labels of time in such a panel; more would touch
WIDE = 20.0  # largest over smallest residual, above which their axis is logarithmic
CROWDED, SWINGS, CLOSE = 60, 12, 40  # crossings of the middle: too many, and shown; least ticks
# run -> label, colour, dashes
WITH_NAMES = {
    "before": ("device file", FILE, ":"),
    "refit": ("refitted, without the found effects", BEFORE, "--"),
    "after": ("with the found effects", AFTER, "-"),
}
LEARNED = {"law": ("with the learned law", LAW, "-")}
PUSHES = {"N m": "torque", "N": "force"}
WITHOUT = {
    "before": ("device file", BEFORE, "--"),
    "after": ("refitted", AFTER, "-"),
}


def force_map_figure(located: Located, rotary: bool) -> Figure:
    """Return the missing force at its most likely place over position, velocity, command and time.

    Bars: one standard error. A flat line at zero means that nothing is missing there.
    """
    top = max(located.maps, key=lambda m: m.gained)
    (pushed_by, force), length = pushing(rotary), "rad" if rotary else "m"
    units = {"position": length, "velocity": f"{length}/s", "command": force, "time": "s"}
    maps = [m for m in located.maps if m.place == top.place]
    forces = [_about_its_level(m.force) for m in maps]
    push, pushed = scaled(float(np.abs(_about_its_level(top.force)).max()), force)
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 5.0))
        panels = figure.subplots(2, 2, squeeze=False).ravel()
        _within(figure, hspace=0.42, wspace=0.28)
        for axes in panels[len(maps) :]:  # a free motion has no command
            axes.remove()
        for axes, m, missing in zip(panels, maps, forces, strict=False):
            middle = 0.5 * (m.edges[1:] + m.edges[:-1])
            axes.axhline(0.0, color="0.6", linewidth=0.8)
            by, unit = scaled(float(np.abs(m.edges).max()), units[m.against])
            axes.errorbar(
                by * middle, push * missing, push * m.error, by * 0.5 * np.diff(m.edges),
                fmt="o", color=AFTER, markersize=3.5, linewidth=1.2,
            )  # fmt: skip
            axes.set_xlabel(f"{m.against} [{unit}]")
            axes.set_title(_explains(m.gained, top), fontsize=9)
            axes.locator_params(axis="x", nbins=4)
        for axes in panels[: len(maps) : 2]:
            axes.set_ylabel(f"missing {pushed_by} at {top.place} [{pushed}]")
    return figure


def _explains(gained: float, top: ForceMap) -> str:
    """How much of the error is explained by a force over a state, beside the best of them."""
    share = max(gained, 0.0) / top.gained if top.gained > 0.0 else 1.0
    if share >= 1.0:
        return "explains most"
    return f"explains {percent(share)} of what {top.against} explains"


def _within(figure: Figure, *, bottom: float = 0.5, top: float = 0.3, **gaps: float) -> None:
    """Place the panels between margins [in]; gaps: as of `subplots_adjust`.

    All numbers of an axis are scaled to a few digits, so that one margin fits them; a layout that
    measures every text takes longer than the drawing.
    """
    wide, high = figure.get_size_inches()
    figure.subplots_adjust(
        left=0.85 / wide, right=1.0 - 0.26 / wide, bottom=bottom / high, top=1.0 - top / high,
        **gaps,
    )  # fmt: skip


def _about_its_level(force: Floats) -> Floats:
    """Take off what is the same in all bins where it is all there is.

    A spring to the ground and the origin of the position take up any constant force, which the map
    then cannot tell: its level is what rounding made it.
    """
    level = float(force.mean())
    return force - level if float(np.ptp(force)) < LEVEL * abs(level) else force


def run_lines(named: bool, run: WholeRun) -> dict[str, tuple[str, str, str]]:
    """Return label, colour and dashes of each simulated run; named: whether it has effects."""
    words = WITH_NAMES if named else WITHOUT
    return words | LEARNED if "law" in run.simulated else words


def whole_run_figure(run: WholeRun, named: bool = True) -> Figure:
    """Return the measurement with free runs before and after, and errors below, in fitting units.

    named: whether any effect was found; else before is the device file, and after the refit. A run
    that goes far beyond the motion is cut off, and its label says so. If the motion is too fast for
    the width of a page, its fastest stretch is drawn beside it.
    """
    t = run.begins + run.period * np.arange(run.measured.size, dtype=np.float64)
    middle = float(run.measured.mean())
    swing = float(np.abs(run.measured - middle).max())
    factor, unit = scaled(float(np.abs(run.measured).max()), run.unit)
    words = run_lines(named, run)
    close = _close_look(run)
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 4.6))
        columns = 1 if close is None else 2
        panels = figure.subplots(
            2, columns, sharex="col", sharey="row", squeeze=False,
            gridspec_kw={"height_ratios": (3, 2), "width_ratios": (3, 2)[:columns]},
        )  # fmt: skip
        spans = [slice(None)] if close is None else [slice(None), close]
        for column, span in zip(panels.T, spans, strict=True):
            _motion(column, t[span], run, span, factor, words)
            if close is not None:
                _ticks_inside(column[1])
        motion, error = panels[:, 0]
        reach = ROOM * swing
        errors = [run.errors[name] for name in words if name != "before" or not named]
        finite = [e for e in errors if np.isfinite(e)]
        most = min(reach, 4.0 * max(finite, default=reach)) or 1.0
        cut = _set_height(motion, factor * middle, factor * reach)
        cut += _set_height(error, 0.0, factor * most)
        _add(CUT, motion, cut)
        quantity, at = run.output.split("_")
        what = f"{quantity} of {at}"
        motion.set_ylabel(f"|{what}| [{unit}]" if run.folded else f"{what} [{unit}]")
        error.set_ylabel(f"error [{unit}]")
        for axes in panels[1]:
            axes.set_xlabel("time [s]")
        held = _ground(figure, run.held_out)
        headed(figure, f"{run.recording}, simulated without correction; {held}")
        _within(figure, bottom=_legend(figure, motion), top=0.32, hspace=0.08, wspace=0.06)
    return figure


def force_error_figure(forces: ForceError, named: bool = True) -> Figure:
    """Return the acting force with those that the recorded motion needs, and differences below.

    named: whether any effect was found; else before is the device file, and after the refit. A
    model that needs far more than was commanded is cut off, and one with a far larger difference
    than the others is not drawn below; the label says so.
    """
    commanded = forces.acting["before"]
    t = forces.begins + forces.period * np.arange(commanded.size, dtype=np.float64)
    reach = ROOM * float(np.abs(commanded).max())
    factor, unit = scaled(reach, forces.unit)
    what = PUSHES.get(forces.unit, "command")
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 4.6))
        force, lacks = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": (3, 2)})
        force.plot(
            *envelope(t, factor * commanded), color=MEASURED, linewidth=UNDER, label="commanded"
        )
        least = min(forces.errors.values())
        most = 4.0 * min(least, 0.25 * reach)
        hidden: list[str] = []
        for name, (label, colour, dashes) in (WITH_NAMES if named else WITHOUT).items():
            lacking = factor * forces.lacking[name]
            size = forces.errors[name]
            rms = "runs away" if math.isinf(size) else f"error {with_unit(size, forces.unit, 3)}"
            said = f"{label}: {rms} ({percent(forces.shares[name])})"
            style: dict[str, Any] = {"color": colour, "linewidth": 1.1, "linestyle": dashes}
            acting = factor * forces.acting[name]
            force.plot(*envelope(t, acting + lacking), label=said, **style)
            if max(most, least) < size:
                hidden.append(colour)
            else:
                lacks.plot(*envelope(t, lacking), **style)
        lacks.axhline(0.0, color="0.6", linewidth=0.8)
        _add(CUT, force, _set_height(force, 0.0, factor * reach))
        _add(HIDDEN, force, hidden)
        if 0.0 < most < math.inf:
            _set_height(lacks, 0.0, factor * most)
        force.set_ylabel(f"{what} at m1 [{unit}]")
        lacks.set_ylabel(f"missing [{unit}]")
        lacks.set_xlabel("time [s]")
        lacks.margins(x=0.01)
        held = _ground(figure, forces.held_out)
        headed(
            figure,
            f"{forces.recording}, the {what} that its motion needs; {held}; below"
            f" {forces.band:.3g} Hz",
        )
        _within(figure, bottom=_legend(figure, force), top=0.32, hspace=0.08, wspace=0.06)
    return figure


def _set_height(axes: Axes, middle: float, usual: float) -> list[Any]:
    """Set the height of a panel; returns the colours of the lines that it cuts off.

    usual: half the height, which becomes up to `WIDER` times as large if that contains every line.
    """
    away = [
        (line, float(np.abs(np.asarray(line.get_ydata()) - middle).max())) for line in axes.lines
    ]
    farthest = 1.05 * max(far for _, far in away)
    reach = farthest if usual < farthest <= WIDER * usual else usual
    axes.set_ylim(middle - reach, middle + reach)
    return [line.get_color() for line, far in away if not far <= reach]


def _add(words: str, axes: Axes, colours: Sequence[Any]) -> None:
    """Add words to the label of each line of these colours."""
    for line in axes.lines:
        if line.get_color() in colours:
            line.set_label(f"{line.get_label()}{words}")


def _legend(figure: Figure, axes: Axes) -> float:
    """Add the legend of a panel below the figure; returns the margin that it needs [in]."""
    handles, labels = axes.get_legend_handles_labels()
    columns = 1 if any(label.endswith((CUT, HIDDEN)) for label in labels) else 2
    rows = -(-len(labels) // columns)
    wide, high = figure.get_size_inches()
    figure.set_size_inches(wide, high + 0.19 * max(0, rows - 2))
    figure.legend(handles, labels, loc="lower center", ncols=columns)
    return 0.55 + 0.19 * rows


def _ground(figure: Figure, held_out: bool) -> str:
    """Tint the panels of data that were kept out of the fit; returns the words for their title."""
    if not held_out:
        return "part of the fit"
    for axes in figure.axes:
        axes.set_facecolor(HELD_OUT)
    return "kept out of the fit (tinted)"


def envelope(t: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return a series (n,) reduced to the resolution of a picture, with all its swings.

    A series of more samples than twice `COLUMNS` becomes the lowest and the highest value of each
    column, in their order; a shorter one is unchanged. Values that are not finite are left out of a
    column with finite values.
    """
    if values.size <= 2 * COLUMNS:
        return t, values
    width = -(-values.size // COLUMNS)
    columns = -(-values.size // width)
    index = np.minimum(np.arange(columns * width), values.size - 1).reshape(columns, width)
    piece = values[index]
    finite = np.isfinite(piece)
    lowest = np.where(finite, piece, np.inf).argmin(axis=1)
    highest = np.where(finite, piece, -np.inf).argmax(axis=1)
    both = np.sort(np.column_stack([lowest, highest]), axis=1)
    chosen = np.take_along_axis(index, both, axis=1).ravel()
    return t[chosen], values[chosen]


def _motion(
    column: NDArray[np.object_], t: Floats, run: WholeRun, span: slice, factor: float,
    words: dict[str, tuple[str, str, str]],
) -> None:  # fmt: skip
    """Draw one stretch: motions above, errors below."""
    motion, error = column
    measured = run.measured[span]
    motion.plot(*envelope(t, factor * measured), color=MEASURED, linewidth=UNDER, label="measured")
    for name, (label, colour, dashes) in words.items():
        simulated = run.simulated[name][span]
        with np.errstate(all="ignore"):
            off = factor * (simulated - measured)
            drawn = factor * simulated
        size = run.errors[name]
        rms = "runs away" if math.isinf(size) else f"error {with_unit(size, run.unit, 3)} rms"
        said = f"{label}: {rms} ({percent(run.shares[name])})"
        style: dict[str, Any] = {"color": colour, "linewidth": 1.1, "linestyle": dashes}
        motion.plot(*envelope(t, drawn), label=said, **style)
        error.plot(*envelope(t, off), **style)
    error.axhline(0.0, color="0.6", linewidth=0.8)
    motion.margins(x=0.01)


def _ticks_inside(axes: Axes) -> None:
    """Keep labels of time off the edges, where those of two panels side by side would meet."""
    low, high = axes.get_xlim()
    room = EDGE * (high - low)
    at = MaxNLocator(nbins=4).tick_values(low, high)
    inside = [t for t in at if low + room <= t <= high - room]
    longest = max((len(f"{t:.6g}") for t in inside), default=0)  # all have as many decimals
    if longest * len(inside) > LETTERS:
        inside = [inside[0], inside[-1]]
    axes.set_xticks(inside)


def _close_look(run: WholeRun) -> slice | None:
    """The stretch in which a motion of too many swings for the width is read; None if few."""
    about = run.measured - run.measured.mean()
    turns = np.flatnonzero(np.diff(np.sign(about)) != 0)
    if turns.size < CROWDED or run.measured.size < 10 * CLOSE:
        return None
    ticks = max(CLOSE, round(run.measured.size * SWINGS / turns.size))
    # The middle of the recording, since every run is right at its beginning.
    first = max(0, run.measured.size // 2 - ticks // 2)
    return slice(first, min(run.measured.size, first + ticks))


def residual_figure(residuals: Residuals, named: bool = True) -> Figure:
    """Return the rms of the innovations over time, and their spectrum, before and after.

    Both in units of the noise model: they are one if nothing is missing. named: whether any effect
    was found; else there is only the refit.
    """
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 3.3))
        over_time, spectrum = figure.subplots(1, 2)
        headed(figure, "Error of the prediction one sample ahead, relative to the noise")
        _within(figure, bottom=0.75, top=0.36, wspace=0.36)
        lines = (
            (residuals.before, BEFORE, "linear refit"),
            (residuals.after, AFTER, "with the found effects"),
        )
        for values, colour, label in lines if named else ((residuals.after, AFTER, "refitted"),):
            _over_time(over_time, values, residuals.period, colour, label)
            _spectrum(spectrum, values, residuals.period, colour)
        for axes in (over_time, spectrum):
            axes.axhline(1.0, color="0.4", linestyle=":", linewidth=1.0, label="white noise")
        over_time.set_xlabel("time [s]")
        over_time.set_ylabel("rms residual / noise")
        low, high = over_time.dataLim.intervaly
        if high > WIDE * max(low, 0.1):  # on a linear scale the answer would be on the axis
            over_time.set_yscale("log")
            _plain_numbers(over_time, of_time=True)
        else:
            over_time.set_ylim(bottom=0.0)
        _plain_numbers(spectrum)
        spectrum.set_xlabel("frequency [Hz]")
        spectrum.set_ylabel("power / power of white noise")
        handles, labels = over_time.get_legend_handles_labels()
        figure.legend(handles, labels, loc="lower center", ncols=3)
    return figure


def _plain_numbers(axes: Axes, of_time: bool = False) -> None:
    """Label logarithmic axes with plain numbers: mathematics takes longer to set than all else.

    of_time: the axis to the right is time, and linear.
    """
    both = ((axes.yaxis, axes.get_ylim()), (axes.xaxis, axes.get_xlim()))
    for axis, (low, high) in both[: 1 if of_time else 2]:
        wide = math.log10(high / low) > 1.5
        axis.set_major_locator(LogLocator(subs=(1.0,) if wide else (1.0, 2.0, 5.0)))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(FuncFormatter(_plain_number))


def _plain_number(value: float, _: float | None = None) -> str:
    return f"{value:g}"


def _over_time(axes: Axes, values: Floats, period: float, colour: str, label: str) -> None:
    pieces = np.array_split((values**2).mean(axis=1), min(SLICES, values.shape[0]))
    edges = np.cumsum([0, *(p.size for p in pieces)]) * period
    steps = [float(np.sqrt(p.mean())) for p in pieces]
    axes.stairs(steps, edges, baseline=None, color=colour, label=label)


def _spectrum(axes: Axes, values: Floats, period: float, colour: str) -> None:
    from scipy.signal import welch  # with matplotlib, half of the program's loading time

    size = min(1024, values.shape[0])
    frequency, power = welch(values, 1.0 / period, nperseg=size, axis=0)
    # In a one-sided density the first and the Nyquist bin count once, all others twice.
    twice = (frequency > 0.0) & (frequency < 0.499 / period)
    density = power[twice].mean(axis=1) / (2.0 * period)
    axes.loglog(frequency[twice], density, color=colour, linewidth=1.1)

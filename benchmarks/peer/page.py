"""The table of rows as Markdown, what each found, and the picture of the free runs."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from benchmarks.peer.rows import Row
from benchmarks.peer.sets import KINDS, Floats, Kind
from zwidth.figures.style import MEASURED, STYLE, UNDER

DIVERGES = "diverges"
HEAD: tuple[str, ...] = (
    "| set | method | held-out free run, rms | of the motion | CPU s | what had to be known |"
    " published |",
    "|---|---|---|---|---|---|---|",
)
SMALL = {"m": ("mm", 1e3), "V": ("mV", 1e3), "m/s": ("mm/s", 1e3)}
COLOURS = ("#004488", "#bb5566", "#ddaa33", "#228833", "#66ccee", "#aa3377", "0.6", "#994400")


def shown_unit(kind: Kind, unit: str) -> tuple[str, float]:
    """The unit in which a set is shown, and by what SI counts: volts stand for metres in one."""
    return SMALL.get("V" if kind.name == "silverbox" else unit, (unit, 1.0))


def table(rows: Sequence[Row], order: Sequence[str], known: Mapping[tuple[str, str], str]) -> str:
    """Return the table, sets in their order, methods in theirs, as Markdown.

    known: what had to be known of a set, by set and method.
    """
    lines = list(HEAD)
    for kind in KINDS.values():
        own = [row for row in rows if row.set == kind.name]
        for place, row in enumerate(in_order(own, order)):
            first = place == 0
            lines.append(
                f"| {kind.title if first else ''} | {row.method} | {_errors(kind, row)} |"
                f" {_shares(row)} | {_seconds(row.seconds)} | {known[row.set, row.method]} |"
                f" {kind.published if first else ''} |"
            )
    return "\n".join(lines) + "\n"


def not_computed(rows: Sequence[Row], known: Mapping[tuple[str, str], str]) -> str:
    """Return a sentence of what has no row yet, nothing where all have one."""
    there = {(row.set, row.method) for row in rows}
    lacking = {
        kind.title: [m for name, m in known if name == kind.name and (name, m) not in there]
        for kind in KINDS.values()
    }
    said = [f"{title}: {', '.join(methods)}" for title, methods in lacking.items() if methods]
    return f"Not computed yet: {'; '.join(said)}.\n\n" if said else ""


def found(rows: Sequence[Row], order: Sequence[str]) -> str:
    """Return what each method found, set by set."""
    lines: list[str] = []
    for kind in KINDS.values():
        own = [row for row in rows if row.set == kind.name and row.found]
        if own:
            lines += [f"- {kind.title}, from {kind.start}:"]
            lines += [f"  - {row.method}: {row.found}" for row in in_order(own, order)]
    return "\n".join(lines) + "\n"


def in_order(rows: Sequence[Row], order: Sequence[str]) -> list[Row]:
    """Rows of one set in the order of methods, those of no place in it last."""
    places = {method: place for place, method in enumerate(order)}
    return sorted(rows, key=lambda row: places.get(row.method, len(places)))


def _errors(kind: Kind, row: Row) -> str:
    said: list[str] = []
    for rms, unit in zip(row.rms, row.units, strict=True):
        name, factor = shown_unit(kind, unit)
        said.append(DIVERGES if rms is None else f"{factor * rms:.3g} {name}")
    return ", ".join(said)


def _shares(row: Row) -> str:
    return ", ".join("-" if s is None else f"{100.0 * s:.3g} %" for s in row.share)


def _seconds(seconds: float | None) -> str:
    if seconds is None:
        return "-"
    return f"{seconds:.0f}" if seconds >= 10.0 else f"{seconds:.1f}"


def figure(
    rows: Sequence[Row],
    order: Sequence[str],
    measured: Mapping[str, Floats],
    runs: Mapping[tuple[str, str], Floats],
    periods: Mapping[str, float],
) -> Figure:
    """Return what was measured beside every free run, errors below: a set each, the last output.

    measured: by set (ticks, o); runs: by set and method. Runs that diverge are named, not drawn.
    """
    sets = [kind for kind in KINDS.values() if kind.name in measured]
    with rc_context({**STYLE, "font.size": 8}):
        made = Figure(figsize=(11.0, 4.6 * ((len(sets) + 1) // 2)), layout="constrained")
        panels = made.subfigures((len(sets) + 1) // 2, min(2, len(sets)), squeeze=False)
        for kind, panel in zip(sets, panels.ravel(), strict=False):
            own = in_order([row for row in rows if row.set == kind.name], order)
            t = periods[kind.name] * np.arange(measured[kind.name].shape[0])
            window = (t >= kind.window[0]) & (t <= kind.window[1])
            each = {row.method: runs[kind.name, row.method] for row in own}
            _panel(panel, kind, own, t[window], measured[kind.name][window, -1],
                   {method: run[window, -1] for method, run in each.items()}, order)  # fmt: skip
    return made


def _panel(
    panel: SubFigure,
    kind: Kind,
    rows: Sequence[Row],
    t: Floats,
    measured: Floats,
    runs: Mapping[str, Floats],
    order: Sequence[str],
) -> None:
    motion, error = panel.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    unit, factor = shown_unit(kind, rows[0].units[-1])
    motion.plot(t, factor * measured, color=MEASURED, linewidth=UNDER, label="measured")
    for row in rows:
        place = order.index(row.method) if row.method in order else len(order)
        style = {"color": COLOURS[place % len(COLOURS)], "linewidth": 1.0}
        share = row.share[-1]
        if share is None:
            motion.plot([], [], label=f"{row.method}: {DIVERGES}", **style)
            continue
        motion.plot(t, factor * runs[row.method], "--", label=row.method, **style)
        error.plot(t, factor * (runs[row.method] - measured), **style)
    _limits(motion, factor * measured, 1.2)
    worst = [np.abs(runs[r.method] - measured).max() for r in rows if r.share[-1] is not None]
    reach = factor * min(2.5 * float(np.median(worst)), float(np.ptp(measured)))
    error.set_ylim(-reach, reach)
    error.axhline(0.0, color="0.6", linewidth=0.8)
    quantity = {"m": "position", "m/s": "velocity of m2", "rad/s": "speed, absolute"}
    name = "output" if kind.name == "silverbox" else quantity[rows[0].units[-1]]
    motion.set_ylabel(f"{name} [{unit}]")
    error.set_ylabel(f"error [{unit}]")
    error.set_xlabel("time since the held-out part begins [s]")
    motion.set_title(kind.title)
    panel.legend(loc="outside lower center", ncols=2, fontsize=6.5)  # no curve lies below it


def _limits(axes: Axes, y: Floats, room: float) -> None:
    middle, reach = 0.5 * (y.max() + y.min()), 0.5 * room * float(np.ptp(y))
    axes.set_ylim(middle - reach, middle + reach)

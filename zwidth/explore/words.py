"""The texts of the page on a wall, the plane and the device."""

import math
from collections.abc import Mapping
from html import escape

import numpy as np

from zwidth.explore.bench import LIMIT_S, SECONDS, Bench, Line
from zwidth.explore.look import Look
from zwidth.explore.view import View
from zwidth.figures.map import COLOURS, NAMES
from zwidth.figures.style import PREDICTED
from zwidth.sim.device import Device, place_label
from zwidth.sim.fate import Fate, settles
from zwidth.sim.readable import plain, with_unit
from zwidth.stability.fate_map import FateMap, units_of
from zwidth.stability.plane import Plane, is_friction_at_m1

EARLY = 0.98  # of the time shown: a run that ends earlier was cut off
SHORT = {
    Fate.RESTS: "rest",
    Fate.DITHERS: "dither",
    Fate.FELT: "felt",
    Fate.GROWS: "grow",
    Fate.UNDECIDED: "undecided",
}


def heading(bench: Bench, view: View) -> str:
    """Return the heading: the device, and what to do, as HTML."""
    name = bench.devices[view.device].name
    if (shown := bench.names[view.device]) != name:
        name = f"{name}, {shown}"
    return (
        f'<h1 style="font-size:17px;margin:0;display:inline">{escape(name)}</h1>&emsp;'
        "Each point is a virtual wall; its colour says how a run against it ends. <b>Click a"
        " wall</b>"
        " to see its run. <b>Move a slider</b> to change the device. <b>Drop a recording</b>"
        " anywhere to see it beside the run."
    )


def of_the_wall(found: Look, plane: Plane, line: Line) -> str:
    """Return the fate of a wall, and its linear theory, as HTML."""
    view, device = found.view, plane.device
    assert view.stiffness is not None
    assert view.damping is not None
    wall = (
        f"K = {with_unit(view.stiffness, units_of(plane, 'K'))},"
        f" B = {with_unit(view.damping, units_of(plane, 'B'))}"
    )
    fate = Fate(int(found.fates.fate[0]))
    seen = _seen(found, plane, fate, math.isfinite(device.interface.command_limit))
    critical = line.at(view.damping)
    stable = critical is not None and view.stiffness < critical[0]
    if critical is None:
        theory = "no wall is stable at this B"
    else:
        word = "stable" if stable else "unstable"
        limit, frequency = with_unit(critical[0], units_of(plane, "K")), critical[1]
        theory = f"{word} (its limit at this B: K = {limit}, {frequency:.3g} Hz)"
    surprise = stable == (fate in (Fate.FELT, Fate.GROWS, Fate.DITHERS))
    if line.without:
        return (
            f"<b>{escape(wall)}</b> {escape(seen)}; there is no linear theory for {line.without}."
        )
    verb = "<b>but</b> linear theory says" if surprise else "linear theory:"
    return f"<b>{escape(wall)}</b> {escape(seen)}; {verb} {escape(theory)}."


def _seen(found: Look, plane: Plane, fate: Fate, limited: bool) -> str:
    angle, force = units_of(plane, "amplitude"), units_of(plane, "command_limit")
    fates = found.fates
    size = (
        f"\u00b1{with_unit(float(fates.amplitude[0]), angle, 3)} and"
        f" \u00b1{with_unit(float(fates.force[0]), force, 3)} at {float(fates.frequency[0]):.3g} Hz"
    )
    if fate == Fate.RESTS:
        return "comes to rest"
    if fate == Fate.GROWS and settles(fates.rate, LIMIT_S)[0] and not limited:
        return f"grows into an oscillation that the steps alone do not cause: {size}"
    if fate == Fate.GROWS and not limited:
        lost = f"; lost after {with_unit(ends, 's', 3)}" if (ends := _ends(found)) else ""
        hertz = float(fates.frequency[0])
        at = f", at {hertz:.3g} Hz" if math.isfinite(hertz) else ""
        return f"grows without bound{at}{lost}"
    return {
        Fate.DITHERS: f"keeps oscillating (dither), too weakly to feel: {size}",
        Fate.FELT: f"keeps oscillating (dither), and is felt: {size}",
        Fate.GROWS: f"grows until the amplifier's limit holds it: {size}",
        Fate.UNDECIDED: f"is undecided after 16 s: {size}",
    }[fate]


def _ends(found: Look) -> float:
    """Time at which a run ended early, 0 for a complete one."""
    t = found.trace.t
    return float(t[-1]) if t.size and float(t[-1]) < EARLY * SECONDS else 0.0


def of_the_plane(
    result: FateMap, middle: bool, finished: bool, seconds: float | None = None
) -> str:
    """Return the shares of the fates, and the picture's progress and time, as plain text."""
    shares = [(f, float(np.mean(result.fates.fate == f))) for f in Fate]
    said = " \u00b7 ".join(f"{_percent(share)} {SHORT[f]}" for f, share in shares if share > 0.0)
    grid = "161 \u00d7 161" if finished else "41 \u00d7 41" if middle else "11 \u00d7 11"
    state = f"{grid}, {result.runs} runs" + ("" if finished else ", refining \u2026")
    after = "" if seconds is None else f", {seconds:.2g} s"
    return f"{said}; {state}{after}{_held_still(result)}"


def of_the_recording(beyond: float) -> str:
    """Return the label of a recording; beyond: its size over that of the run, or 0."""
    if not beyond:
        return "recording"
    return f"recording ({plain(beyond, 2)} times larger)"


def _held_still(result: FateMap) -> str:
    """Say so where friction alone makes all of the plane come to rest, and what would show more."""
    plane = result.plane
    values = plane.at({})
    if not (values["friction"] > 0.0 and np.all(result.fates.fate == Fate.RESTS)):
        return ""
    friction = with_unit(values["friction"], units_of(plane, "friction"))
    start = with_unit(values["amplitude"], units_of(plane, "amplitude"))
    return (
        f". Friction of {friction} holds every wall here at rest, from a start of {start}: move the"
        " start up or the friction down to see where it does not"
    )


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if share >= 0.01 else "< 1 %"


def legend(perceptible: str, measured: bool, theory: bool) -> str:
    """Return the meaning of colours, lines and marks, as HTML.

    perceptible: force that is felt. measured, theory: whether a device has any.
    """
    names = {
        **NAMES,
        Fate.GROWS: "grows (to the limit, if any)",
        Fate.FELT: f"{NAMES[Fate.FELT]} (from {perceptible})",
    }
    names[Fate.UNDECIDED] = "undecided"
    entries = [(SWATCH.format(colour=COLOURS[f]), name) for f, name in names.items()]
    if theory:
        entries.append(("<b>\u2501</b>", "linear boundary"))
    if measured:
        entries.append(("<b>\u25cb</b>", "measured (small: at other delays)"))
    entries.append((f'<b style="color:{PREDICTED}">\u2297</b>', "chosen"))
    return " &ensp;".join(
        f"<span {TOGETHER}>{mark} {escape(name)}</span>" for mark, name in entries
    )


TOGETHER = 'style="white-space:nowrap"'
RUN_MARK = f'<span {TOGETHER}><b style="color:{{}}">{{}}</b> {{}}</span>'
SWATCH = (
    '<span style="display:inline-block;width:0.8em;height:0.8em;background:{colour};'
    'border:1px solid #666"></span>'
)


def of_the_runs(looks: Mapping[str, tuple[str, str]], names: Mapping[str, str]) -> str:
    """Return whose line is whose, as HTML. looks: run -> colour and dash; names: run -> name."""
    if len(names) < 2:
        return ""
    entries = [
        RUN_MARK.format(looks[run][0], "\u2501" if looks[run][1] == "solid" else "\u2505", name)
        for run, name in ((run, escape(name)) for run, name in names.items())
    ]
    return "<br>".join(entries)


def of_the_device(device: Device) -> str:
    """Return the parts of a device that the sliders do not set, as HTML; empty for none."""
    effects = [place_label(p) for p in device.physics if not is_friction_at_m1(p)]
    names = [f"{label.replace('_', ' ').replace('@', ' at ')}" for label in effects]
    return f"Also in the device: {escape(', '.join(names))}." if names else ""

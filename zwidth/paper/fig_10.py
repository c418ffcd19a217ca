"""Table II as printed and Fig. 10: theory, revised theory and measurements together."""

import numpy as np

from zwidth.figures.curves import THEIRS, Curve, Points, curves_figure, key
from zwidth.identification.relay import STANDARD
from zwidth.paper.appendix import appendix
from zwidth.paper.content import Part, Picture, Section, Table, number
from zwidth.paper.theory import COLOUR, DELAYS, SHAPE, Floats, ms, phantom
from zwidth.scenarios.misprints import OUTLYING
from zwidth.scenarios.table_2 import MeasuredPoint, measured_at, table_2
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.stability.limited_relay import limited_boundary
from zwidth.stability.linear import corner, critical_stiffness, last_stable_damping

REVISED = "phantom_1_0_table2"
BEYOND = 1.04  # of the last measured damping
POINTS = 160
PLUS_MINUS = "\N{PLUS-MINUS SIGN}"
OWN = "zwidth paper --section fig_10"


def section() -> Section:
    """Return the table with its misprints, and the figure."""
    rows = list(table_2())
    parts: list[Part] = [
        _misprints(rows),
        Table(
            "Table II as printed; the B that the other rows imply for each, with its spread; by how"
            " many spreads the printed one is off; and the K of Table I's model at the B that is"
            " meant.",
            ["delay", "B printed", "K", "f [Hz]", "B implied", "off by", "model's K", "verdict"],
            [_row(row) for row in rows], OWN, (0, 7),
        ),
        _picture(),
    ]  # fmt: skip
    return Section("Table II and Fig. 10: theory against the real device", tuple(parts))


def revised() -> Device:
    """Return the device fitted to Table II."""
    return load_device(REVISED)


def ratio(device: Device) -> float:
    """Return the device's command limit over the force of the standard relay."""
    return device.interface.command_limit / STANDARD.force


def _misprints(rows: list[MeasuredPoint]) -> str:
    """Say how the misprints are found, and which they are."""
    found = [(row, row.judged) for row in rows if row.judged is not None]
    wrong = [(row, verdict) for row, verdict in found if verdict.misprint]
    named = ", and ".join(
        f"{row.damping:g} at {ms(row.delay)} ({row.frequency:g} Hz), where the others imply"
        f" {verdict.damping:.3f} {PLUS_MINUS} {verdict.spread:.3f}: {verdict.meant:g} is meant"
        for row, verdict in wrong
    )
    least = min(abs(verdict.score) for _, verdict in wrong)
    most = max(abs(verdict.score) for _, verdict in found if not verdict.misprint)
    return (
        "Each row of Table II is a measured point of the boundary, hence a measured value of the"
        " plant. A smooth plant departs from Table I's model smoothly in frequency: a line through"
        " what the other rows of the same delay show (after the jump of f, what rows nearby in f"
        " show) says which wall the row should have, and so which B. A row whose B is off by more"
        f" than {OUTLYING:g} spreads, and which another B alone explains, is a misprint. There are"
        f" {len(wrong)}: {named}. The nearer of them is off by {least:.1f} spreads, of all other"
        f" rows none by more than {most:.1f}. They stand as printed, and are drawn where they are"
        " meant."
    )


def _row(row: MeasuredPoint) -> list[str]:
    linear = critical_stiffness(phantom(row.delay), row.place).stiffness
    verdict, implied, score = "", "", ""
    if row.judged is not None:
        implied = f"{row.judged.damping:.3f} {PLUS_MINUS} {row.judged.spread:.3f}"
        score = f"{row.judged.score:+.1f}"
        verdict = f"misprint, read as {row.judged.meant:g}" if row.judged.misprint else ""
    return [
        ms(row.delay), f"{row.damping:g}", f"{row.stiffness:g}", f"{row.frequency:g}", implied,
        score, number(linear), verdict,
    ]  # fmt: skip


def _picture() -> Picture:
    theirs: list[Curve] = []
    ours: list[Curve] = []
    points: list[Points] = []
    for delay in DELAYS:
        measured = measured_at(delay)
        printed = appendix(delay, last_stable_damping(phantom(delay)) or 0.0)
        theirs.append(
            Curve(
                printed.damping, printed.stiffness, printed.frequency_hz, COLOUR[delay], THEIRS, 1.1
            )
        )
        ours.append(Curve(*_readings(delay, BEYOND * measured[-1].place), COLOUR[delay]))
        crossed = [i for i, p in enumerate(measured) if p.damping_meant is not None]
        points.append(
            Points(
                np.array([p.place for p in measured]),
                np.array([p.stiffness for p in measured]),
                np.array([p.frequency for p in measured]),
                COLOUR[delay], SHAPE[delay], tuple(crossed),
            )
        )  # fmt: skip
    legend = [key(ms(d), COLOUR[d], "none", SHAPE[d]) for d in DELAYS]
    legend.append(key("ours, revised", "0.3"))
    legend += [
        key("theirs", "0.3", THEIRS), key("measured", "0.3", "none", "o"),
        key("its B misprinted", "0.3", "none", "x"),
    ]  # fmt: skip
    return Picture(
        "fig_10", curves_figure([*theirs, *ours], points, legend),
        "Fig. 10. Critical stiffness and ultimate frequency: theory of Table I (theirs, dashed),"
        " what a relay reads on the device fitted to Table II, whose amplifier has a limit (ours,"
        " solid), and the measurements. Beyond the last stable B only the limit bounds the"
        " oscillation; how the device is found stands in the last but one section.",
        OWN,
    )  # fmt: skip


def _readings(delay: float, last: float) -> tuple[Floats, Floats, Floats]:
    """B, K and f that a relay reads on the revised device, each (n,)."""
    device = revised().with_interface(delay=delay)
    top = corner(device)
    dampings = np.linspace(0.0, last, POINTS)
    if top is not None:
        dampings = np.union1d(dampings, top.damping)
    found = [
        (p.damping, p.stiffness, p.frequency_hz)
        for p in limited_boundary(device, dampings.tolist(), ratio(device))
    ]
    b, k, f = np.array(found, dtype=np.float64).T
    return b, k, f

"""Fig. 8, the relay experiment in all conditions of Table II, and the errors of its method."""

from zwidth.figures.relay import relay_bias_figure, relay_figure
from zwidth.identification.cycles import RelayCondition, relay_conditions
from zwidth.identification.relay import relay_run, waveform
from zwidth.paper.content import Picture, Section, Table, number
from zwidth.paper.relay_physics import physics_parts
from zwidth.paper.theory import ms, phantom
from zwidth.scenarios.table_2 import MeasuredPoint, table_2
from zwidth.stability.linear import critical_stiffness

STARTS = 50
SHOWN_S = 0.4
COMMAND = "zwidth relay phantom_1_0 --starts 50"


def section() -> Section:
    """Return Fig. 8, the table of conditions and the study of the method."""
    wave = waveform(phantom(0.008), 0.08, SHOWN_S)
    eight = relay_run(phantom(0.008), 0.08)
    rows = _as_meant_and_as_printed()
    conditions = relay_conditions(
        [phantom(row.delay) for row in rows], [row.place for row in rows], STARTS
    )
    pairs = sorted(zip(rows, conditions, strict=True), key=_order)
    diverging = [
        f"{ms(row.delay)} {row.place:g}"
        for row, condition in pairs
        if condition.reference.verdict == "diverges" and not _as_printed(row)
    ]
    return Section(
        "Fig. 8 and the relay: what the method measures, and how far off",
        (
            Picture(
                "fig_8", relay_figure(wave),
                "Fig. 8. Relay force and position in steady state at 8 ms and B = 0.08, relay of"
                f" 0.05 N m: period {1e3 / (eight.frequency_hz or 1.0):.0f} ms. Ours reads K ="
                f" {number(eight.stiffness)} at {number(eight.frequency_hz)} Hz; theirs, on the"
                " real device, 7.88 at 15.97 Hz; the linear boundary is at"
                f" {number(critical_stiffness(phantom(0.008), 0.08).stiffness)}.",
                "zwidth relay phantom_1_0 --delay-ms 8 --damping 0.08",
            ),
            "The relay is a measuring instrument with errors of its own. Its cycle is mostly a"
            " whole number of ticks, so its frequency, and with it K, comes in steps; a loop may"
            " have several cycles, and the start decides; and where no K is stable the loop has no"
            f" cycle to find. {len(diverging)} conditions diverge on the model of Table I, although"
            f" the real device oscillated steadily in all of them: {', '.join(diverging)}."
            f" ({_misprinted(rows, conditions)}) A"
            " divergence is a verdict on the loop, not a number. And where a vibration mode already"
            " makes the loop unstable, the"
            " relay can stay on the slow oscillation and read a stiffness that no wall has: at 4 ms"
            f" and B = 0.23 it reads {number(_beyond(rows, conditions))} on a model whose boundary"
            f" is {number(critical_stiffness(phantom(0.004), 0.23).stiffness)}.",
            Table(
                "All conditions of Table II on Table I's model. K and f from the reference start"
                f" (m1 at 1 mrad, at rest); cycles: over {STARTS} random starts, K with its share."
                " Rows with a misprinted B run at the B that is meant, and the one printed as 0.5"
                " there too.",
                ["delay", "B", "theirs K", "theirs f", "relay K", "relay f", "linear K", "cycles",
                 "diverge"],
                [_row(row, c) for row, c in zip(rows, conditions, strict=True)],
                COMMAND, (0, 7),
            ),
            Picture(
                "relay_bias", relay_bias_figure(*_bias(rows, conditions)),
                "The relay's K over the linear boundary of the very model it ran on, for every"
                " condition with a stable K: ring, reference start; dots, all cycles found.",
                COMMAND,
            ),
            *physics_parts(),
        ),
    )  # fmt: skip


def _as_meant_and_as_printed() -> list[MeasuredPoint]:
    """All rows at the B that is meant, and misprinted ones where no other row stands."""
    rows = list(table_2())
    places = {(row.delay, row.place) for row in rows}
    printed = [row for row in rows if (row.delay, row.damping) not in places]
    return [*rows, *(row._replace(judged=None) for row in printed)]


def _as_printed(row: MeasuredPoint) -> str:
    return "" if row.judged is not None else " as printed"


def _misprinted(rows: list[MeasuredPoint], conditions: list[RelayCondition]) -> str:
    """Say what a misprinted row does at the B that is printed, where no other row stands."""
    said = [
        f"{ms(row.delay)} {row.damping:g}, a misprint, {'diverges' if none else 'cycles'} as"
        " printed"
        for row, c in zip(rows, conditions, strict=True)
        if _as_printed(row)
        for none in [c.reference.verdict == "diverges"]
    ]
    return f"{'; '.join(said)}; as meant it is among the other rows."


def _beyond(rows: list[MeasuredPoint], conditions: list[RelayCondition]) -> float | None:
    """K of the relay at 4 ms, B = 0.23, just past the corner."""
    pairs = zip(rows, conditions, strict=True)
    return next(c.reference.stiffness for r, c in pairs if (r.delay, r.place) == (0.004, 0.23))


def _row(row: MeasuredPoint, condition: RelayCondition) -> list[str]:
    result = condition.reference
    linear = critical_stiffness(phantom(row.delay), row.place).stiffness
    meant = row.damping_meant is not None
    damping = f"{row.place:g} (printed {row.damping:g})" if meant else f"{row.damping:g}"
    damping += _as_printed(row)
    cycles = [f"{c.stiffness:.2f} ({100.0 * c.share:.0f} %)" for c in condition.cycles[:3]]
    more = len(condition.cycles) - 3
    verdict = result.verdict if result.stiffness is None else number(result.stiffness)
    return [
        ms(row.delay), damping, number(row.stiffness), number(row.frequency), verdict,
        "" if result.frequency_hz is None else f"{result.frequency_hz:.2f}", number(linear),
        ", ".join(cycles) + (f" and {more} more" if more > 0 else ""),
        f"{100.0 * condition.diverging:.0f} %" if condition.diverging else "",
    ]  # fmt: skip


def _bias(
    rows: list[MeasuredPoint], conditions: list[RelayCondition]
) -> tuple[list[str], list[float | None], list[list[float]]]:
    """Label, K from the reference start over the boundary, and of all cycles, a condition each."""
    labels: list[str] = []
    reference: list[float | None] = []
    cycles: list[list[float]] = []
    for row, condition in sorted(zip(rows, conditions, strict=True), key=_order):
        linear = critical_stiffness(phantom(row.delay), row.place).stiffness
        if linear is None:
            continue
        labels.append(f"{ms(row.delay)}, {row.place:g}")
        found = condition.reference.stiffness
        reference.append(None if found is None else found / linear)
        cycles.append([cycle.stiffness / linear for cycle in condition.cycles])
    return labels, reference, cycles


def _order(pair: tuple[MeasuredPoint, RelayCondition]) -> tuple[float, float]:
    return pair[0].delay, pair[0].place

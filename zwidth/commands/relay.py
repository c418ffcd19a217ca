"""`zwidth relay`: the relay experiment, its limit cycles, and how far off the boundary it reads."""

from collections.abc import Sequence
from pathlib import Path

import click

from zwidth.compiling import announce
from zwidth.console import Column, Console, progress
from zwidth.figures.names import picture_files
from zwidth.identification.cycles import RelayCondition, relay_conditions
from zwidth.identification.relay import RelayTest, waveform
from zwidth.options import ManyNumbers, Quantities, Quantity, force_option, json_option, out_option
from zwidth.scenarios.scenario import usual_substeps
from zwidth.scenarios.table_2 import table_2
from zwidth.sim.device import Device, warnings_of
from zwidth.sim.device_file import load_device
from zwidth.stability.linear import critical_stiffness

SHOWN_S = 0.4


@click.command("relay", cls=ManyNumbers)
@click.argument("name", metavar="DEVICE")
@click.option("--delay-ms", cls=Quantities, type=Quantity("ms"), metavar="MS ...",
              help="Loop delays, crossed with --damping; else those of Table II.")  # fmt: skip
@click.option("--damping", cls=Quantities, type=Quantity("N m s/rad | N s/m"), metavar="B ...",
              help="Virtual dampings, crossed with --delay-ms.")  # fmt: skip
@click.option("--level", type=Quantity("N m | N", above=True), default=0.05, show_default=True,
              help="Force of the relay.")  # fmt: skip
@click.option("--starts", type=click.IntRange(0, 10_000), default=60, show_default=True,
              help="Random starts a condition, to find all limit cycles.")  # fmt: skip
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True,
              help="Seed of the random starts.")  # fmt: skip
@click.option("--substeps", type=click.IntRange(1, 1000), default=None,
              help="Substeps a tick; default 1 where that is exact, else 10.")  # fmt: skip
@out_option("runs/relay")
@force_option
@json_option
def command(
    name: str,
    delay_ms: tuple[float, ...],
    damping: tuple[float, ...],
    level: float,
    starts: int,
    seed: int,
    substeps: int | None,
    out: Path,
    json_file: str | None,
) -> None:
    """Find K_CR and the ultimate frequency by a relay, as the paper did on the real device.

    DEVICE is a shipped device or a device file. Every condition runs from one reference start (m1
    at 1e-3, at rest) and from random ones; a loop that keeps growing diverges.
    """
    console = Console(json_file)
    device = load_device(name)
    for warning in warnings_of(device):
        console.warn(warning)
    console.will_write(*picture_files(out / "relay"))
    announce(console)
    asked = _asked(device, delay_ms, damping)
    devices = [device.with_interface(delay=delay) for delay, _ in asked]
    test = RelayTest(force=level, substeps=substeps or max(map(usual_substeps, devices)))
    with progress("relay", len(asked)) as advance:
        found = relay_conditions(
            devices, [b for _, b in asked], starts, seed, test, lambda: advance(1)
        )
    _tell(console, devices, found)
    console.result({"conditions": [_entry(condition) for condition in found]})
    for path in _drawn(devices, found, test, out):
        console.say(f"wrote {path}")


def _asked(
    device: Device, delay_ms: Sequence[float], damping: Sequence[float]
) -> list[tuple[float, float]]:
    """Conditions (delay [s], B): the lists crossed, or those of Table II that agree with one."""
    if delay_ms and damping:
        return [(1e-3 * ms, b) for ms in delay_ms for b in damping]
    if damping:
        return [(device.interface.delay, b) for b in damping]
    printed = {(row.delay, row.damping) for row in table_2()}
    rows = sorted(printed | {(row.delay, row.place) for row in table_2()})
    if not delay_ms:
        return rows
    kept = [row for row in rows if any(abs(row[0] - 1e-3 * ms) < 1e-9 for ms in delay_ms)]
    if not kept:
        raise ValueError("Table II has 2, 4 and 8 ms; for other delays give --damping too")
    return kept


def _tell(console: Console, devices: Sequence[Device], found: Sequence[RelayCondition]) -> None:
    columns = [Column("delay [ms]"), Column("B"), Column("verdict", False)]
    columns += [Column(heading) for heading in ("K", "f [Hz]", "K linear", "off")]
    columns += [Column("cycles: K (share)", False), Column("diverge")]
    rows = [_row(device, condition) for device, condition in zip(devices, found, strict=True)]
    console.table(f"{devices[0].name}: relay", columns, rows)


def _row(device: Device, condition: RelayCondition) -> list[str]:
    result = condition.reference
    linear = critical_stiffness(device, condition.damping).stiffness
    known = result.stiffness is not None and linear is not None
    off = f"{100.0 * (result.stiffness / linear - 1.0):+.1f} %" if known else ""  # pyright: ignore
    cycles = ", ".join(f"{c.stiffness:.4g} ({100.0 * c.share:.0f} %)" for c in condition.cycles[:4])
    more = len(condition.cycles) - 4
    return [
        f"{1e3 * condition.delay:g}",
        f"{condition.damping:g}",
        result.verdict,
        "" if result.stiffness is None else f"{result.stiffness:.4g}",
        "" if result.frequency_hz is None else f"{result.frequency_hz:.2f}",
        "none" if linear is None else f"{linear:.4g}",
        off,
        cycles + (f", {more} more" if more > 0 else ""),
        f"{100.0 * condition.diverging:.0f} %",
    ]


def _entry(condition: RelayCondition) -> dict[str, object]:
    result = condition.reference
    return {
        "delay_s": condition.delay,
        "damping": condition.damping,
        "verdict": result.verdict,
        "stiffness": result.stiffness,
        "frequency_hz": result.frequency_hz,
        "cycles": [
            {
                "stiffness": c.stiffness,
                "frequency_hz": c.frequency_hz,
                "amplitude": c.amplitude,
                "share": c.share,
            }
            for c in condition.cycles
        ],
        "diverging_share": condition.diverging,
        "undecided_share": condition.undecided,
    }


def _drawn(
    devices: Sequence[Device], found: Sequence[RelayCondition], test: RelayTest, out: Path
) -> list[Path]:
    """Draw Fig. 8 of the condition nearest to the paper's, 8 ms and B = 0.08, that oscillates."""
    from zwidth.figures.relay import relay_figure
    from zwidth.figures.style import save_figure

    steady = [
        (abs(c.delay - 0.008) + abs(c.damping - 0.08), device, c.damping)
        for device, c in zip(devices, found, strict=True)
        if c.reference.verdict == "oscillates"
    ]
    if not steady:
        return []
    _, device, damping = min(steady, key=lambda entry: entry[0])
    return list(save_figure(relay_figure(waveform(device, damping, SHOWN_S, test)), out / "relay"))

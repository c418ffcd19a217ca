"""`zwidth relay`: the relay experiment, its limit cycles, and its deviation from the boundary."""

from collections.abc import Sequence
from pathlib import Path

import click

from zwidth.console import Column, Console, progress
from zwidth.estimator_option import estimator_option, say_without_theory, with_estimator
from zwidth.figures.style import picture_files
from zwidth.identification.cycles import RelayCondition, relay_conditions
from zwidth.identification.relay import RelayTest, waveform
from zwidth.options import (
    ManyNumbers,
    Quantities,
    Quantity,
    device_argument,
    force_option,
    json_option,
    out_option,
)
from zwidth.scenarios.scenario import usual_substeps
from zwidth.scenarios.table_2 import table_2
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device, remarks_on
from zwidth.sim.run import Start
from zwidth.stability.linear import known_boundary

SHOWN_S = 0.4
LISTED = 2  # cycles listed besides the most frequent
NONE = "-"


@click.command("relay", cls=ManyNumbers)
@device_argument("name")
@click.option("--delay-ms", cls=Quantities, type=Quantity("ms"), metavar="MS ...",
              help="Loop delays; each is combined with each --damping. Default: those of"
              " Table II of the paper.")  # fmt: skip
@click.option("--damping", cls=Quantities, type=Quantity("N m s/rad | N s/m"), metavar="B ...",
              help="Virtual dampings; each is combined with each --delay-ms.")  # fmt: skip
@click.option("--level", type=Quantity("N m | N", above=True), default=0.05, show_default=True,
              help="Force of the relay.")  # fmt: skip
@click.option("--starts", type=click.IntRange(0, 10_000), default=60, show_default=True,
              help="Random starts per delay and damping, to find all limit cycles.")  # fmt: skip
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True,
              help="Seed of the random starts.")  # fmt: skip
@click.option("--substeps", type=click.IntRange(1, 1000), default=None,
              help="Integration steps per sample. Default: 1 if that is exact, else"
              " 10.")  # fmt: skip
@estimator_option
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
    estimator: str | None,
    out: Path,
    json_file: str | None,
) -> None:
    """Find K_CR and the ultimate frequency by a relay, as the paper did on the real device.

    DEVICE is a shipped device or a device file. K_CR is the largest stable stiffness. For each
    delay and damping, runs begin from a reference start (m1 displaced by 1e-3 rad or m, at rest)
    and from random starts. The limit cycle that most runs reach is listed first. A run that keeps
    growing is listed as diverging.
    """
    console = Console(json_file)
    device = load_device(name)
    for warning in remarks_on(device):
        console.warn(warning)
    device = with_estimator(device, estimator)
    say_without_theory(console, device)
    console.will_write(*picture_files(out / "relay"), *picture_files(out / "relay_boundary"))
    asked = _asked(device, delay_ms, damping)
    devices = [device.with_interface(delay=delay) for delay, _ in asked]
    test = RelayTest(force=level, substeps=substeps or max(map(usual_substeps, devices)))
    with progress("simulating relay tests", len(asked)) as advance:
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
        raise ValueError(
            "Table II of the paper has 2, 4 and 8 ms; for other delays give --damping too"
        )
    return kept


def _tell(console: Console, devices: Sequence[Device], found: Sequence[RelayCondition]) -> None:
    force, length = ("N m", "rad") if devices[0].rotary else ("N", "m")
    columns = [
        Column("delay [ms]"), Column(f"B [{force} s/{length}]"), Column("verdict", False),
        Column("share of starts"), Column(f"K [{force}/{length}]"), Column("f [Hz]"),
        Column("K linear"), Column("difference from linear"),
        Column("other cycles: K (share)", False),
        Column("diverge"), Column("K of the reference start"),
    ]  # fmt: skip
    rows = [_row(device, condition) for device, condition in zip(devices, found, strict=True)]
    console.table(f"{devices[0].name}: relay, most frequent cycle", columns, rows)


def _row(device: Device, condition: RelayCondition) -> list[str]:
    cycle, reference = condition.read, condition.reference
    linear = known_boundary(device, [condition.damping])[0].stiffness
    off = NONE
    if cycle is not None and linear is not None:
        off = f"{100.0 * (cycle.stiffness / linear - 1.0):+.1f} %"
    others = [c for c in condition.cycles if c is not condition.likeliest]
    cycles = ", ".join(f"{c.stiffness:.4g} ({_percent(c.share)})" for c in others[:LISTED])
    more = len(others) - LISTED
    return [
        f"{1e3 * condition.delay:g}",
        f"{condition.damping:g}",
        condition.verdict,
        _share(condition),
        NONE if cycle is None else f"{cycle.stiffness:.4g}",
        NONE if cycle is None else f"{cycle.frequency_hz:.2f}",
        NONE if linear is None else f"{linear:.4g}",
        off,
        cycles + (f", {more} more" if more > 0 else ""),
        _percent(condition.diverging),
        reference.verdict if reference.stiffness is None else f"{reference.stiffness:.4g}",
    ]


def _share(condition: RelayCondition) -> str:
    """Of the starts those that end as the condition is told; a dash where none were drawn."""
    cycle = condition.likeliest
    shares = {"diverges": condition.diverging, "undecided": condition.undecided}
    share = shares.get(condition.verdict, 0.0) if cycle is None else cycle.share
    return _percent(share) if share else NONE


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %"


def _entry(condition: RelayCondition) -> dict[str, object]:
    cycle, reference = condition.read, condition.reference
    return {
        "delay_s": condition.delay,
        "damping": condition.damping,
        "verdict": condition.verdict,
        "stiffness": None if cycle is None else cycle.stiffness,
        "frequency_hz": None if cycle is None else cycle.frequency_hz,
        "share": None if cycle is None or not cycle.share else cycle.share,
        "reference": {
            "verdict": reference.verdict,
            "stiffness": reference.stiffness,
            "frequency_hz": reference.frequency_hz,
        },
        "cycles": [vars(cycle) for cycle in condition.cycles],
        "diverging_share": condition.diverging,
        "undecided_share": condition.undecided,
    }


def _drawn(
    devices: Sequence[Device], found: Sequence[RelayCondition], test: RelayTest, out: Path
) -> list[Path]:
    """Draw K over B of all conditions, and the cycle of the one nearest to Fig. 8's.

    Fig. 8 has 8 ms and B = 0.08.
    """
    from zwidth.figures.relay import relay_boundary_figure, relay_figure, relay_title
    from zwidth.figures.style import save_figure

    written = save_figure(relay_boundary_figure(devices, found), out / "relay_boundary")
    steady = [
        (abs(c.delay - 0.008) + abs(c.damping - 0.08), device, c, c.read)
        for device, c in zip(devices, found, strict=True)
    ]
    steady = [(far, device, c, cycle) for far, device, c, cycle in steady if cycle is not None]
    if steady:
        _, device, c, cycle = min(steady, key=lambda entry: entry[0])
        start = None if cycle.start is None else Start(*cycle.start)
        wave = waveform(device, c.damping, SHOWN_S, test, start)
        title = relay_title(device, c, cycle, test)
        written += save_figure(relay_figure(wave, title, device.rotary), out / "relay")
    return written

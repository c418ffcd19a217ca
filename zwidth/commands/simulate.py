"""`zwidth simulate`: run a scenario, log it, draw it, and say what happened."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import click
import numpy as np

from zwidth.console import Column, Console, json_number, progress
from zwidth.estimator_option import estimator_option, with_estimator
from zwidth.figures.run import run_figure
from zwidth.figures.style import draw
from zwidth.files.whole import replacing
from zwidth.options import Quantity, force_option, json_option, out_option
from zwidth.scenarios.logged_run import LoggedRun, logged_run
from zwidth.scenarios.run_verdict import WALLS
from zwidth.scenarios.scenario import Scenario
from zwidth.scenarios.scenario_file import load_scenario
from zwidth.sim.controller import Step
from zwidth.sim.device_file import remarks_on
from zwidth.sim.perception import FORCE, Perception
from zwidth.sim.run import Run
from zwidth.user_law import controller_option

# Not part of the mechanism's balance: the work of the command as the controller sees it, and the
# part of it that the amplifier's lag withholds from the mechanism.
OUTSIDE = ("work_wall", "work_actuator_lag")
NO_WALL = ("none", "excitation", "recorded", "relay")  # controllers without a wall
SOURCES = ("work_motor", "work_disturbance")
WORDS = {
    "decays": "decays",
    "grows": "grows",
    "limit_cycle": "settles on a limit cycle",
    "undecided": "has not shown yet whether it decays or grows",
}
FATES = {  # of a wall, with the explanation that is printed
    "rests": "comes to rest",
    "dithers": "dithers, too weakly to be felt",
    "felt": "dithers, and is felt",
}


SETTLED = " that the steps of encoder and command alone cannot sustain"


@click.command("simulate")
@click.argument("scenario", metavar="SCENARIO.toml", type=click.Path(path_type=Path))
@controller_option
@estimator_option
@click.option("--felt-force", type=Quantity("N m | N", above=True),
              help="Smallest force of dither that a hand feels. Default: 0.01.")  # fmt: skip
@click.option("--felt-position", type=Quantity("rad | m", above=True),
              help="Smallest amplitude of dither that a hand feels. Default: the threshold of"
              " vibration on the skin; for a rotary device, only with --lever.")  # fmt: skip
@click.option("--lever", type=Quantity("m", above=True),
              help="Distance of the hand from the axis of a rotary device.")  # fmt: skip
@out_option("runs")
@force_option
@json_option
def command(
    scenario: Path,
    controller: Step | None,
    estimator: str | None,
    felt_force: float | None,
    felt_position: float | None,
    lever: float | None,
    out: Path,
    json_file: str | None,
) -> None:
    """Run the experiment that a TOML file describes.

    Writes NAME.mcap, which 'zwidth replay' repeats bit for bit, and NAME.png. After an
    interruption, NAME.partial.mcap contains every finished block of 1000 ticks.
    """
    console = Console(json_file)
    described = load_scenario(scenario, controller)
    described = replace(described, device=with_estimator(described.device, estimator))
    for warning in remarks_on(described.device):
        console.warn(warning)
    felt = Perception(FORCE if felt_force is None else felt_force, felt_position, lever)
    if felt != Perception() and described.controller.kind not in WALLS:
        raise ValueError(
            "--felt-force, --felt-position and --lever apply only to a wall; controller.kind is"
            f" {described.controller.kind!r}: leave them out"
        )
    log, picture = out / f"{scenario.stem}.mcap", out / f"{scenario.stem}.png"
    console.will_write(log, picture)
    out.mkdir(parents=True, exist_ok=True)
    with progress("simulating", described.ticks) as advance:
        logged = logged_run(described, log, perception=felt, on_block=advance)
    _say(console, described, logged)
    console.say(f"wrote {log}")
    figure = run_figure(logged.run.trace, _title(described, logged))
    with replacing(picture) as file:
        draw(figure, file, "png")
    console.say(f"wrote {picture}")
    console.result(
        {
            "device": described.device.name,
            "log": str(log),
            "picture": str(picture),
            "ticks": len(logged.run.trace),
            "duration_s": len(logged.run.trace) * described.device.interface.period,
            "outcome": logged.run.outcome.name.lower(),
            "verdict": logged.metadata.get("verdict"),
            "fate": logged.metadata.get("fate"),
            "events": dict(Counter(event.kind for event in logged.events)),
            "peaks": {name: json_number(value) for name, value in _peaks(logged.run).items()},
            "energy": {name: json_number(value) for name, value in _energy(logged.run).items()},
        }
    )


def _title(scenario: Scenario, logged: LoggedRun) -> str:
    facts = scenario.controller.facts
    parts = [scenario.controller.kind, *(f"{k} {v:g}" for k, v in facts.items() if _shown(v))]
    parts.append(f"delay {1e3 * scenario.device.interface.delay:g} ms")
    return f"{scenario.device.name}: {', '.join(parts)}"


def _shown(value: object) -> bool:
    return isinstance(value, float) and value != 0.0


def _say(console: Console, scenario: Scenario, logged: LoggedRun) -> None:
    run, period = logged.run, scenario.device.interface.period
    console.say(_title(scenario, logged))
    verdict = logged.metadata.get("verdict")
    fate = logged.metadata.get("fate", "")
    judged = ""
    if verdict is not None:
        judged = f"; left alone, it {FATES.get(fate, WORDS[verdict])}"
        judged += SETTLED if (fate, verdict) == ("grows", "limit_cycle") else ""
    console.say(f"{len(run.trace)} ticks of {1e3 * period:g} ms: {run.outcome.value}{judged}")
    counts = Counter(event.kind.replace("_", " ") for event in logged.events)
    if counts:
        console.say(", ".join(f"{kind} {count}" for kind, count in counts.items()))
    rows = [
        [name.replace("_", " "), f"{peak:.6g}", f"{run.trace[name][-1]:.6g}", run.trace.units[name]]
        for name, peak in _peaks(run).items()
    ]
    columns = [Column("", False), Column("peak"), Column("at the end"), Column("unit", False)]
    console.table("", columns, rows)
    energy = _energy(run)
    if energy:
        rows = [
            [name.replace("_", " "), f"{value:.6g}"]
            for name, value in energy.items()
            if name not in ("imbalance", "turned_over")
            and (name != "work_wall" or scenario.controller.kind not in NO_WALL)
        ]
        console.table("\nEnergy [J]", [Column("", False), Column("")], rows)
    if 0.0 < energy.get("turned_over", 0.0) < np.inf:
        share = abs(energy["imbalance"]) / energy["turned_over"]
        console.say(f"energy balance: the error is {share:.1e} of the energy exchanged")


def _peaks(run: Run) -> dict[str, float]:
    """Largest absolute value of what moves and what is commanded."""
    names = [n for n in run.trace.channels if n.startswith(("position_", "command", "applied"))]
    return {name: float(np.abs(run.trace[name]).max()) for name in names}


def _energy(run: Run) -> dict[str, float]:
    """What of the ledger was recorded, up to the last sample, and how far it is from closing."""
    trace = run.trace
    if "stored_energy" not in trace.channels:
        return {}
    stored = trace["stored_energy"]
    found = {"stored_at_start": float(stored[0]), "stored_at_end": float(stored[-1])}
    work = {n: float(v[-1]) for n, v in trace.channels.items() if n.startswith("work_")}
    if not work:
        return found
    inside = {name: value for name, value in work.items() if name not in OUTSIDE}
    brought = sum(inside[name] for name in SOURCES)
    spent = sum(value for name, value in inside.items() if name not in SOURCES)
    change = found["stored_at_end"] - found["stored_at_start"]
    imbalance = change - (brought - spent)
    turned = sum(abs(value) for value in inside.values())
    return found | work | {"imbalance": imbalance, "turned_over": turned}

"""`zwidth plan`: what a recording would show, before it is made."""

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from zwidth.console import Advance, Column, Console, progress
from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.answer.words import own_parameter
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.figures.plan import named, plan_figure
from zwidth.figures.style import picture_files, save_figure
from zwidth.options import Quantity, device_argument, force_option, json_option, out_option
from zwidth.planning.asked import check_length, usual_noise
from zwidth.planning.excitations import LIBRARY, Scale, excitation, save_scenario, scale_for
from zwidth.planning.limits import SHOWN
from zwidth.planning.plan import ALIKE, Plan, Visible, better_excitations, most_steps, plan
from zwidth.planning.rehearsal import Noise, rehearse
from zwidth.scenarios.scenario_file import load_scenario
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device, remarks_on
from zwidth.sim.nearest import nearest
from zwidth.sim.readable import with_unit
from zwidth.sim.run import simulate

Floats = NDArray[np.float64]


@click.command("plan")
@device_argument("name")
@click.option("--noise", type=Quantity("rad | m", above=True), default=None,
              help="Noise of the measured position, rms. Default: the rounding error of the"
              " encoder, its step over sqrt(12); required if it has no step.")  # fmt: skip
@click.option("--process-noise", type=Quantity("N m | N", above=True), default=None,
              help="Random force at m1, rms; every sample has a new value. Default: 0.2 % of"
              " the largest command.")  # fmt: skip
@click.option("--seconds", type=Quantity("s", above=True), default=20.0, show_default=True,
              help="Length of the recording.")  # fmt: skip
@click.option("--excitation", "names", metavar="NAME|SCENARIO.toml", multiple=True,
              default=("standard_session",), show_default=True,
              help=f"The command to play: one of {', '.join(LIBRARY)}, or that of a scenario; may"
              " be repeated.")  # fmt: skip
@click.option("--level", type=Quantity("N m | N", above=True), default=None,
              help="Largest command. Default: 90 % of the device's command limit.")  # fmt: skip
@click.option("--travel", type=Quantity("rad | m", above=True), default=None,
              help="Largest travel of m1. Default: 1 rad or 0.1 m.")  # fmt: skip
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True,
              help="Seed of excitation and noise.")  # fmt: skip
@out_option("runs/plan")
@force_option
@json_option
def command(
    name: str,
    noise: float | None,
    process_noise: float | None,
    seconds: float,
    names: tuple[str, ...],
    level: float | None,
    travel: float | None,
    seed: int,
    out: Path,
    json_file: str | None,
) -> None:
    """Predict which effects a recording would show, before you make it.

    DEVICE is a shipped device or a device file.

    Shows for each effect the smallest magnitude that the recording would reveal, at five sigma
    after a refit of the device's parameters. Then lists the pairs of effects that the recording
    could not tell apart, and an excitation that can. Writes a picture, and each excitation as a
    scenario that 'zwidth simulate' or a rig can play.
    """
    console = Console(json_file)
    device = load_device(name)
    for warning in remarks_on(device):
        console.warn(warning)
    check_length(device, seconds)
    scale = scale_for(device, level=level, travel=travel)
    seen = usual_noise(device, scale, noise, process_noise)
    commands = {Path(n).stem: _command(n, device, seconds, scale, seed) for n in names}
    _say_experiment(console, device, scale, seen)
    pictures = [file for stem in commands for file in picture_files(out / f"{stem}_plan")]
    played_files = [out / f"{stem}.{kind}" for stem in commands for kind in ("toml", "npy")]
    console.will_write(*pictures, *played_files)
    plans: list[Plan] = []
    files: list[Path] = []
    with progress("planning", len(names) * most_steps(device)) as advance:
        for stem, played in commands.items():
            told = partial(_tell, advance, stem)
            rehearsed = rehearse(device, played, seen, seed=seed, name=stem)
            try:
                found, _ = plan(device, rehearsed, seen, told)
                plans.append(better_excitations(device, found, seen, scale, seed, told))
            except NoObserver as error:
                raise ValueError(f"{device.name} cannot be observed: {error}") from error
    _say_limits(console, plans)
    for found in plans:
        _say_pairs(console, found)
        title = f"{device.name}: {found.excitation}, {found.seconds:g} s"
        files += save_figure(plan_figure(found, title), out / f"{found.excitation}_plan")
        played = save_scenario(device, commands[found.excitation], out / f"{found.excitation}.toml")
        files += [played, played.with_suffix(".npy")]
    for path in files:
        console.say(f"wrote {path}")
    console.result(
        {
            "device": device.name,
            "seconds": seconds,
            "noise": asdict(seen),
            "level": scale.level,
            "travel": scale.travel,
            "shown_at_sigma": SHOWN,
            "compared_at_multiple": ALIKE,
            "plans": [_entry(found) for found in plans],
            "files": [str(path) for path in files],
        }
    )


def _tell(advance: Advance, stem: str, now: str) -> None:
    advance(1, f"{stem}: {now}")


def _command(name: str, device: Device, seconds: float, scale: Scale, seed: int) -> Floats:
    """The command of a library excitation, or of a scenario by its file."""
    if name in LIBRARY:
        return excitation(name, device, seconds, scale, seed)
    if not name.endswith(".toml"):
        raise ValueError(
            f"there is no excitation {name!r}; {nearest(name, LIBRARY)} (a scenario of your own is"
            " given as a file ending in .toml)"
        )
    scenario = load_scenario(name)
    own, period = scenario.device.interface.period, device.interface.period
    if own != period:
        raise ValueError(
            f"{name} has a period of {own:g} s, {device.name} one of {period:g} s; give both the"
            " same period_s"
        )
    if scenario.controller.kind == recorded(np.zeros(1)).kind:
        return scenario.controller.parameters[: scenario.ticks].copy()
    run = simulate(
        scenario.device, scenario.controller, duration=scenario.duration, start=scenario.start,
        disturbance=scenario.forces(), substeps=scenario.substeps, seed=scenario.seed,
    )  # fmt: skip
    return np.ascontiguousarray(run.trace["command"])


def _say_experiment(console: Console, device: Device, scale: Scale, noise: Noise) -> None:
    force, length = ("N m", "rad") if device.rotary else ("N", "m")
    console.say(
        f"{device.name}: commands up to {scale.level:.3g} {force}, travel up to"
        f" {scale.travel:.3g} {length}; noise of the reading {noise.measurement:.3g} {length} rms,"
        f" of the force at m1 {noise.process:.3g} {force} rms per sample"
    )


def _say_limits(console: Console, plans: Sequence[Plan]) -> None:
    columns = [Column("effect", False), Column("parameter", False)]
    columns += [Column(p.excitation) for p in plans]
    rows: list[list[str]] = []
    for every in zip(*(p.visible for p in plans), strict=True):
        first: Visible = every[0]
        numbers = [
            "never" if v.magnitude is None else with_unit(v.magnitude, v.unit, 3) for v in every
        ]
        rows.append([named(first.label), own_parameter(first.measure), *numbers])
    console.table(f"\nSmallest visible magnitude ({SHOWN:g} sigma)", columns, rows)


def _say_pairs(console: Console, found: Plan) -> None:
    if not found.confusable:
        console.say(
            f"\n{found.excitation}: the {len(found.labels)} effects that it reveals can be told"
            f" apart at {ALIKE:g} times these magnitudes"
        )
        return
    columns = [Column("effect", False), Column("looks like", False), Column("sigma")]
    columns += [Column("told apart by --excitation", False), Column("sigma")]
    rows = [
        [
            named(pair.effect),
            named(pair.rival),
            f"{pair.separation_sigma:.1f}",
            pair.better or "none that was tried",
            "" if pair.better_sigma is None else f"{pair.better_sigma:.1f}",
        ]
        for pair in found.confusable
    ]
    console.table(
        f"\n{found.excitation}: pairs that it cannot tell apart, even at {ALIKE:g} times these"
        " magnitudes, and an excitation that can",
        columns,
        rows,
    )


def _entry(found: Plan) -> dict[str, Any]:
    return {
        "excitation": found.excitation,
        "seconds": found.seconds,
        "limits": {v.label: _limit(v) for v in found.visible},
        "confusable": [
            {
                "effects": [pair.effect, pair.rival],
                "separation_sigma": pair.separation_sigma,
                "better": None
                if pair.better is None
                else {"excitation": pair.better, "separation_sigma": pair.better_sigma},
            }
            for pair in found.confusable
        ],
    }


def _limit(visible: Visible) -> dict[str, Any] | None:
    if visible.magnitude is None or visible.physics is None:
        return None
    return {
        "magnitude": visible.magnitude,
        "unit": visible.unit,
        "parameters": dict(visible.physics.values),
    }

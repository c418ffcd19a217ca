"""`zwidth diagnose`: why a recording differs from the simulation of a device."""

import math
import shlex
from pathlib import Path
from typing import Any, cast

import click
import numpy as np

from diagnosis.diagnose import diagnose
from diagnosis.experiment import Experiment, experiment
from diagnosis.result import Diagnosis
from logs.recording import read_recording
from sim.device import Device
from sim.device_file import device_to_text, load_device
from zwidth.console import Column, Console
from zwidth.diagnosis_report import estimate, improvement, number, save_report
from zwidth.files import write_text
from zwidth.options import json_option, out_option


@click.command("diagnose")
@click.argument(
    "recordings",
    metavar="RECORDING...",
    nargs=-1,
    required=True,
    type=click.Path(path_type=Path),
)
@click.option("--device", "name", metavar="DEVICE", required=True, help="Device file or name.")
@click.option(
    "--validate",
    metavar="RECORDING",
    multiple=True,
    type=click.Path(path_type=Path),
    help="Judge by this recording; without it by the last 30 % of each.",
)
@out_option("runs")
@json_option
def command(
    recordings: tuple[Path, ...],
    name: str,
    validate: tuple[Path, ...],
    out: Path,
    json_file: str | None,
) -> None:
    """Say why recordings differ from the simulation of a device, and what physics is missing.

    RECORDING is a recording TOML or a log that zwidth wrote; several are diagnosed together.

    Writes NAME.diagnosis.html, the report, and NAME.augmented.toml, the device with what was found,
    which every command takes. Ctrl-C ends the search and judges what was found until then.
    """
    console = Console(json_file)
    device = load_device(name)
    fit_on = [_read(console, path, device) for path in recordings]
    judge_by = [_read(console, path, device) for path in validate] or None
    found = diagnose(device, fit_on, judge_by, lambda text: console.say(f"... {text}"))
    _say(console, found)
    stem = recordings[0].stem
    augmented = write_text(out / f"{stem}.augmented.toml", device_to_text(found.device))
    line = shlex.join(["zwidth", "diagnose", *map(str, recordings), "--device", name])
    report = save_report(
        found, [path.name for path in recordings], line, out / f"{stem}.diagnosis.html"
    )
    console.say(f"wrote {augmented}")
    console.say(f"wrote {report}")
    files = {"augmented_device": str(augmented), "report": str(report)}
    console.result(_plain(found.as_json() | {"device": device.name} | files))
    if found.interrupted:
        raise KeyboardInterrupt


def _read(console: Console, path: Path, device: Device) -> Experiment:
    trace = read_recording(path)
    for warning in cast("list[str]", trace.facts.get("warnings", [])):
        console.warn(f"{path.name}: {warning}")
    return experiment(trace, device.interface.period, device.chain.masses.size, path.stem)


def _say(console: Console, found: Diagnosis) -> None:
    console.say(f"\n{found.verdict.value}: {found.sentence}\n")
    console.say(found.located.sentence)
    rows = [
        [f"{f.effect} at {f.at}", name, estimate(value), number(f.separation_sigma)]
        for f in found.findings
        for name, value in f.parameters.items()
    ]
    if rows:
        columns = [
            Column("effect", False),
            Column("parameter", False),
            Column("95 %"),
            Column("sigma"),
        ]
        console.table("\nWhat was found", columns, rows)
    rows = [
        [k, number(nominal), estimate(value)] for k, (nominal, value) in found.linear_refit.items()
    ]
    columns = [Column("", False), Column("device file"), Column("refitted")]
    console.table("\nLinear parameters", columns, rows)
    console.say(f"\n{improvement(found.free_run)}")


def _plain(value: Any) -> Any:
    """Return JSON types; what is not finite becomes null."""
    match value:
        case dict():
            return {str(k): _plain(v) for k, v in cast("dict[Any, Any]", value).items()}
        case list() | tuple():
            return [_plain(v) for v in cast("list[Any]", value)]
        case float() if not math.isfinite(value):
            return None
        case np.floating():
            return _plain(float(value))
        case _:
            return value

"""`zwidth diagnose`: why a recording differs from the simulation of a device."""

import math
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import click
import numpy as np

from diagnosis.augmented_boundary import AugmentedBoundary, augmented_boundary
from diagnosis.diagnose import diagnose, separating
from diagnosis.diagnosis_log import diagnosis_trace
from diagnosis.experiment import Experiment, experiment
from diagnosis.result import Diagnosis
from logs.mcap_writer import write_log
from logs.recording import read_recording
from sim.device import Device
from sim.device_file import device_to_text, load_device
from zwidth.console import Column, Console
from zwidth.diagnosis_report import (
    Commands,
    estimate,
    improvement,
    next_sentence,
    number,
    save_report,
)
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

    Writes NAME.diagnosis.html, the report; NAME.augmented.toml, the device with what was found,
    which every command takes; NAME.diagnosis.mcap, residual, missing force and predictions, which
    opens beside the recording; and NAME.next.toml, what to record where rivals are left. Ctrl-C
    ends the search and judges what was found until then.
    """
    console = Console(json_file)
    device = load_device(name)
    fit_on = [_read(console, path, device) for path in recordings]
    judge_by = [_read(console, path, device) for path in validate] or None
    found = diagnose(device, fit_on, judge_by, lambda text: console.say(f"... {text}"))
    _say(console, found)
    stem = recordings[0].stem
    found = replace(found, next_experiment=separating(found, out / f"{stem}.next.toml"))
    if found.next_experiment is not None:
        console.say(f"\n{next_sentence(found.next_experiment)}")
    bounds = _boundary(console, device, found)
    augmented = write_text(out / f"{stem}.augmented.toml", device_to_text(found.device))
    logs = [
        _log(found, e, path, out) for e, path in zip(found.experiments, recordings, strict=True)
    ]
    line = shlex.join(["zwidth", "diagnose", *map(str, recordings), "--device", name])
    view = shlex.join(["zwidth", "explore", name, "--compare", str(augmented)])
    report = save_report(
        found,
        [path.name for path in recordings],
        Commands(line, view),
        out / f"{stem}.diagnosis.html",
        bounds,
    )
    for path in (augmented, *logs, report):
        console.say(f"wrote {path}")
    files = {
        "augmented_device": str(augmented),
        "report": str(report),
        "logs": [str(p) for p in logs],
    }
    more = {"boundary": bounds and bounds.as_json(), "device": device.name}
    console.result(_plain(found.as_json() | more | files))
    if found.interrupted:
        raise KeyboardInterrupt


def _boundary(console: Console, device: Device, found: Diagnosis) -> AugmentedBoundary | None:
    """The stiffest wall before and after; None where nothing was found or there is no such wall."""
    if not found.findings:
        return None
    names = " and ".join(f"{f.effect} at {f.at}" for f in found.findings)
    try:
        bounds = augmented_boundary(device, found.device, names)
    except ValueError as error:
        console.warn(f"no boundary before and after: {error}")
        return None
    if bounds is not None:
        console.say(bounds.sentence)
    return bounds


def _log(found: Diagnosis, e: Experiment, recording: Path, out: Path) -> Path:
    place = max(found.located.entry, key=lambda share: float(share["share"]))["name"]
    searched = found.searched
    trace = diagnosis_trace(
        searched.problem, searched.refit, searched.final, e, place=str(place),
        start_s=float(read_recording(recording).t[0]), rotary=found.device.rotary,
    )  # fmt: skip
    path = out / f"{recording.stem}.diagnosis.mcap"
    write_log(path, trace)
    return path


def _read(console: Console, path: Path, device: Device) -> Experiment:
    trace = read_recording(path)
    for warning in cast("list[str]", trace.facts.get("warnings", [])):
        console.warn(f"{path.name}: {warning}")
    return experiment(trace, device, path.stem)


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

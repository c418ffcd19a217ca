"""`zwidth diagnose`: why a recording differs from the simulation of a device."""

import itertools
import math
import shlex
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import click
import numpy as np

from zwidth.console import Column, Console
from zwidth.diagnosis.augmented_boundary import AugmentedBoundary, augmented_boundary
from zwidth.diagnosis.diagnose import diagnose, separating
from zwidth.diagnosis.diagnosis_log import diagnosis_trace
from zwidth.diagnosis.experiment import Experiment, stretches
from zwidth.diagnosis.result import Diagnosis
from zwidth.diagnosis_report import (
    INTERRUPTED,
    Commands,
    estimate,
    gain_sentence,
    improvement,
    next_sentence,
    number,
    save_report,
)
from zwidth.files.whole import write_text
from zwidth.logs.mcap_writer import write_log
from zwidth.logs.recording import load_log, read_recording
from zwidth.options import force_option, json_option, out_option
from zwidth.sim.device import Device
from zwidth.sim.device_file import device_to_text, load_device

# What is written beside the logs: NAME.diagnosis.html, ...
RESULTS = ("diagnosis.html", "augmented.toml", "next.toml", "next.npy")


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
@force_option
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
    _refuse_fitted(recordings, validate)
    device = load_device(name)
    with warnings.catch_warnings(action="ignore", category=RuntimeWarning):  # numpy's, on 1e300
        fit_on = [(path, e) for path in recordings for e in _read(console, path, device)]
        judge_by = [e for path in validate for e in _read(console, path, device)] or None
        paths = [path for path, _ in fit_on]  # of each stretch
        logs = [out / f"{name}.diagnosis.mcap" for name in _distinct([p.stem for p in paths])]
        results = {what: out / f"{recordings[0].stem}.{what}" for what in RESULTS}
        console.will_write(*results.values(), *logs)
        found = diagnose(device, [e for _, e in fit_on], judge_by, console.doing)
    _say(console, found)
    found = replace(found, next_experiment=separating(found, results["next.toml"]))
    if found.next_experiment is not None:
        console.say(f"\n{next_sentence(found.next_experiment)}")
    bounds = _boundary(console, device, found)
    augmented = write_text(results["augmented.toml"], device_to_text(found.device))
    for e, path, log in zip(found.experiments, paths, logs, strict=True):
        _log(found, e, path, log)
    line = shlex.join(["zwidth", "diagnose", *map(str, recordings), "--device", name])
    view = shlex.join(["zwidth", "explore", name, "--compare", str(augmented)])
    report = save_report(
        found,
        [path.name for path in recordings],
        Commands(line, view),
        results["diagnosis.html"],
        bounds,
    )
    console.say(f"wrote {augmented}")
    if gain := gain_sentence(found):
        console.say(gain)
    for path in (*logs, report):
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


def _refuse_fitted(recordings: Sequence[Path], validate: Sequence[Path]) -> None:
    """Raise ValueError where a recording would judge the fit to itself."""
    fitted = {path.resolve() for path in recordings}
    for path in validate:
        if path.resolve() in fitted:
            raise ValueError(
                f"--validate is {path}, a recording that is fitted; give one that is not, or leave"
                " --validate out to judge by the last 30 % of each"
            )


def _distinct(stems: Sequence[str]) -> list[str]:
    """Return a name for each stem; what would be there twice gets -2, -3 ..."""
    names: list[str] = []
    for stem in stems:
        tries = (f"{stem}-{n}" for n in itertools.count(2))
        name = stem
        while name in names or (name != stem and name in stems):
            name = next(tries)
        names.append(name)
    return names


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


def _log(found: Diagnosis, e: Experiment, recording: Path, path: Path) -> None:
    """Write what belongs to a recording, in its own time: a viewer shows both side by side."""
    log = load_log(recording)
    place = max(found.located.entry, key=lambda share: float(share["share"]))["name"]
    searched = found.searched
    trace = diagnosis_trace(
        searched.problem, searched.refit, searched.final, e, place=str(place),
        start_s=float(log.tick.t[0]) + e.begins, rotary=found.device.rotary,
    )  # fmt: skip
    write_log(path, trace, epoch_ns=log.epoch_ns)


def _read(console: Console, path: Path, device: Device) -> list[Experiment]:
    trace = read_recording(path)
    for warning in cast("list[str]", trace.facts.get("warnings", [])):
        console.warn(f"{path.name}: {warning}")
    return stretches(trace, device, path.stem)


def _say(console: Console, found: Diagnosis) -> None:
    before = f"{INTERRUPTED}: " if found.interrupted else ""
    console.say(f"\n{before}{found.verdict.value}: {found.sentence}\n")
    for fault in found.faults:
        if fault.sentence not in found.sentence:
            console.say(fault.sentence)
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

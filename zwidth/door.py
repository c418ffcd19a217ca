"""Files without a description, and unknown devices: makes a TOML for each.

`described` writes a recording TOML for a recording of another tool, beside the results, and reports
how it read the file; `device_of` fits a device to recordings if none is given, and writes its file.
Both are meant to be edited: an edited file is read, and not overwritten.
"""

import os
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import click
import numpy as np

from zwidth.console import Console
from zwidth.exchanged_columns import in_their_places
from zwidth.files.protection import Protected, check
from zwidth.files.whole import write_text
from zwidth.heartbeat import HEART
from zwidth.identification.first_device import FirstDevice, Motion, first_device
from zwidth.identification.first_loop import first_loop
from zwidth.logs.assumed import Ask, Assumed, assumed
from zwidth.logs.in_memory import AnyTable, source_of
from zwidth.logs.open_source import own_log
from zwidth.logs.recording import read_recording, read_source
from zwidth.logs.recording_file import description_of
from zwidth.logs.source import Source
from zwidth.logs.steps import step_seen
from zwidth.logs.stretches import longest_stretch
from zwidth.logs.timing import examine
from zwidth.logs.units import GOAL
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_file import commented_text, load_device
from zwidth.sim.drive import Drive
from zwidth.sim.interface import Interface
from zwidth.sim.trace import Trace
from zwidth.sim.uncertainty import Uncertainty
from zwidth.speed_loops import with_integral

MOTION = re.compile(r"(?:position|velocity)_m[1-5]")  # channels to which a device is fitted
FITTED = Uncertainty(masses=0.5, springs=2.0, dampers=2.0)
"""The trust in a device that was fitted roughly: enough for a start."""
ONE_TO_THREE = ("one mass", "two masses", "three masses", "four masses", "five masses")


def described(
    console: Console,
    path: Path,
    out: Path,
    joint: str | None = None,
    doubts: list[str] | None = None,
    name: str | None = None,
) -> Path:
    """Return the file itself if it can be read directly, else a recording TOML made for it.

    The TOML is OUT/NAME.recording.toml; name: another NAME. joint: the one to use, if a file has
    several. doubts: receives the assumptions about it, in sentences. Raises LogError if the file
    cannot be read or nothing in it moves.
    """
    if path.suffix.lower() == ".toml":
        return path
    found = own_log(path)
    if not isinstance(found, Source):
        return path
    target = out / (name or f"{path.stem}.recording.toml")
    if edited(target):
        console.note(f"{path.name} is read as described in {target}, which you edited")
        return target
    guess = _guess(found, _relative(path, target.parent), asker(), joint)
    console.note(f"{path.name}, {found.kind}, is read as:")
    for role, what in guess.roles:
        console.note(f"  {role:<9} {what}")
    for doubt in guess.doubts:
        console.note(f"  assumed: {doubt}")
    if doubts is not None:
        doubts += guess.doubts
    console.note(f"if one of these is wrong, correct it in {write_text(target, guess.text)}")
    return target


def _guess(source: Source, file: str, ask: Ask | None, joint: str | None = None) -> Assumed:
    """The guessed description of a file, by its names, checked against its numbers."""
    guess = assumed(source, file, ask, joint)
    return with_integral(in_their_places(guess, source), source)


def taken(path: Path, ask: Ask | None = None, joint: str | None = None) -> tuple[Trace, list[str]]:
    """Return a recording of any kind and the assumptions about it, without writing a file.

    ask: asks a person, if somebody can answer. joint: the one to use, if a file has several. Raises
    LogError if it cannot be read.
    """
    if path.suffix.lower() == ".toml":
        return read_recording(path), []
    found = own_log(path)
    if not isinstance(found, Source):
        return found.tick, []
    guess = _guess(found, path.name, ask, joint)
    described = description_of(guess.text.encode(), path.with_suffix(".recording.toml"))
    said = [f"{role}: {what}" for role, what in guess.roles]
    said += [f"assumed: {doubt}" for doubt in guess.doubts]
    return read_source(described, found, of_file=True), said


def taken_table(
    table: AnyTable, given: Mapping[str, str], joint: str | None = None
) -> tuple[Trace, list[str]]:
    """Return a table in memory as a recording, and the assumptions about it.

    given: time, command, position or velocity -> its column. Raises LogError.
    """
    source = source_of(table)
    guess = with_integral(assumed(source, source.path.name, joint=joint, given=given), source)
    made = description_of(guess.text.encode(), Path("table.recording.toml"))
    return read_source(made, source), [f"assumed: {doubt}" for doubt in guess.doubts]


def device_of(
    console: Console, recordings: Sequence[tuple[str, Trace]], out: Path
) -> tuple[Path, Device, bool]:
    """Return a device that is fitted to recordings, its file OUT/NAME.device.toml, and True.

    If the user has edited that file, its device is returned, and False. recordings: name and trace
    of each; the first gives NAME. Raises ValueError if no device can be fitted.
    """
    stem = recordings[0][0]
    target = out / f"{stem}.device.toml"
    if edited(target):
        console.note(f"using the device in {target}, which you edited")
        return target, load_device(target), False
    device, said = fitted(recordings)
    for line in said:
        console.note(line)
    written = write_text(target, commented_text(device))
    console.note(f"if you know the device better, edit {written}")
    return target, device, True


def kept(refitted: Device, path: Path) -> Device:
    """Write a refitted device over the file of its starting device, and return it."""
    device = replace(refitted, uncertainty=FITTED, band=None, posterior=None)
    write_text(path, commented_text(device))
    return device


def fitted(recordings: Sequence[tuple[str, Trace]]) -> tuple[Device, list[str]]:
    """Return a device fitted to recordings, and notes on the fit.

    Raises ValueError if no device can be fitted.
    """
    stem = recordings[0][0]
    traces = [trace for _, trace in recordings]
    rotary = _rotary(stem, traces[0])
    motions = [_motion(name, trace, rotary) for name, trace in recordings]
    goals = [trace.units.get("command") in GOAL for trace in traces]
    if any(goals) and not all(goals):
        raise ValueError(
            "in some recordings the command is a goal position, in others a force; diagnose them"
            " separately, or give --device"
        )
    if all(goals):
        return _fitted_loop(recordings, motions, rotary)
    found = first_device(motions)
    step = _encoder_step(traces)
    device = Device(
        stem,
        f"fitted to {', '.join(name for name, _ in recordings)}: a start, for a diagnosis to refit",
        rotary,
        found.chain,
        Interface(period=float(f"{motions[0].period:.9g}"), encoder_step=step),
        uncertainty=FITTED,
    )
    said = [f"no device is given: {_why(found)}"]
    if all(m.command is None for m in motions):
        mass = "kg m2" if rotary else "kg"
        said.append(f"there is no command, so the scale is unknown: m1 is set to 1 {mass}")
    return device, said


def _fitted_loop(
    recordings: Sequence[tuple[str, Trace]], motions: Sequence[Motion], rotary: bool
) -> tuple[Device, list[str]]:
    """Return a fitted device whose command is a goal, and notes on the fit."""
    stem, loop = recordings[0][0], first_loop(motions)
    mass = Device(
        stem,
        f"fitted to {', '.join(name for name, _ in recordings)}: a start, for a diagnosis to refit",
        rotary,
        make_chain([1.0], [loop.damper]),
        Interface(
            period=float(f"{motions[0].period:.9g}"),
            encoder_step=_encoder_step([trace for _, trace in recordings]),
        ),
        uncertainty=FITTED,
    )
    unit, force = ("kg m2", "N m/rad") if rotary else ("kg", "N/m")
    late = f" a delay of {1e3 * loop.delay:.3g} ms beside it, and" if loop.delay else ""
    kind = (
        "the goal of a speed loop that integrates, which is a position loop on the integral of"
        " that goal, so"
        if all("position_m1" not in trace.channels for _, trace in recordings)
        else "a goal position, so"
    )
    said = [
        f"no device is given: the command is {kind} a position loop on one"
        f' mass is assumed ([drive] kind = "position", stiffness {loop.stiffness:.4g} {force});'
        f" with{late} friction and limits left to the diagnosis, the error of its free run is"
        f" {100.0 * loop.error:.3g} % of the motion",
        f"a goal does not determine the scale: m1 is set to 1 {unit}",
    ]
    return Drive("position", stiffness=loop.stiffness).on(mass), said


def asker() -> Ask | None:
    """Return a function that asks a person at a terminal; None if nobody could answer."""
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        return None

    def ask(question: str, answers: Sequence[str], default: str) -> str:
        kind = click.Choice(list(answers)) if answers else str
        with HEART.held():  # else its line would overwrite the question
            return str(click.prompt(f"{question}?", default=default, type=kind, err=True))

    return ask


def edited(path: Path) -> bool:
    """Whether a user has made or edited this file, so that a command may not overwrite it."""
    try:
        check(path)
    except Protected:
        return True
    return False


def _relative(path: Path, folder: Path) -> str:
    try:
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    except ValueError:  # on another drive
        return path.resolve().as_posix()


def _rotary(name: str, trace: Trace) -> bool:
    units = {unit.split("/")[0] for key, unit in trace.units.items() if key != "command"}
    if "rad" in units:
        return True
    if "m" in units:
        return False
    raise ValueError(
        f"nothing in {name} shows whether the device turns or slides; set rotary in its TOML, or"
        " give --device"
    )


def _motion(name: str, trace: Trace, rotary: bool) -> Motion:
    keys = [k for k in trace.channels if MOTION.fullmatch(k)]
    if not keys:
        raise ValueError(
            f"{name} has no position or velocity of a mass ({', '.join(trace.channels)}), so a"
            " device cannot be fitted to it; give --device"
        )
    driven = "command" in trace.channels and np.ptp(trace["command"][np.isfinite(trace["command"])])
    whole, _ = longest_stretch(trace, (*keys, *(["command"] if driven else [])), name)
    return Motion(
        examine(whole.t).period,
        whole["command"] if driven else None,
        np.column_stack([whole[key] for key in keys]),
        tuple((key.split("_")[0], int(key.rsplit("_m", 1)[1]) - 1) for key in keys),
        rotary,
    )


def _encoder_step(traces: Sequence[Trace]) -> float:
    """Return the step of m1's position where all recordings show one and the same, else 0."""
    steps = [step_seen(t["position_m1"]) if "position_m1" in t.channels else None for t in traces]
    known = [step for step in steps if step is not None]
    same = len(known) == len(steps) and max(known) <= 1.0001 * min(known)
    return float(f"{known[0]:.9g}") if same else 0.0


def _why(found: FirstDevice) -> str:
    masses = found.chain.masses.size
    errors = ", ".join(
        f"{100.0 * error:.3g} % with {ONE_TO_THREE[found.least + i - 1]}"
        for i, error in enumerate(found.errors)
    )
    return (
        f"{ONE_TO_THREE[masses - 1]} {'is' if masses == 1 else 'are'} assumed (error of the speed"
        f" in free runs of {found.window:.3g} s over data that were not fitted: {errors})"
    )

"""Arguments that are a device or a recording: the value itself, or its name or path."""

import warnings
from collections.abc import Iterable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, cast

from zwidth.diagnosis.recording.experiment import Experiment, stretches
from zwidth.door import taken, taken_table
from zwidth.export.known_torque import with_known_torque
from zwidth.logs.in_memory import AnyTable, is_table
from zwidth.logs.mcap_reader import Log
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.run import Run
from zwidth.sim.trace import Trace

AnyDevice = Device | str | PathLike[str]
AnyRecording = Trace | Run | Log | AnyTable | str | PathLike[str]
Arms = tuple[str | PathLike[str], str]
"""The model of a robot (MJCF or URDF), and the joint in it that is the device."""


def device_of(given: AnyDevice) -> Device:
    """Return a device: as given, or from a shipped device's name or a device file's path.

    Raises DeviceError, TypeError for anything else.
    """
    if isinstance(given, Device):
        return given
    if isinstance(given, str | PathLike):  # pyright: ignore[reportUnnecessaryIsInstance]
        return load_device(given)
    raise TypeError(
        f"device is of type {type(given).__name__}; give a Device, the name of a shipped one, or"
        " the path of a device file"
    )


def trace_of(
    given: AnyRecording, columns: Mapping[str, str] | None = None, joint: str | None = None
) -> Trace:
    """Return a recording's trace: given, of a run, log or table, or read from a path.

    columns: for a table, time, command, position or velocity -> its column, if the caller gave it.
    joint: which one to read, if a table or file has several.

    This is the only place where a given recording is read. The columns of another tool's file (a
    CSV) are recognised. Assumptions about a file, and faults in it, are given as warnings. Raises
    RecordingError or another LogError, TypeError for anything else.
    """
    match given:
        case Trace():
            return given
        case Run():
            return given.trace
        case Log():
            return given.tick
        case str() | PathLike():
            trace, assumed = taken(Path(given), joint=joint)
            odd = cast("Sequence[str]", trace.facts.get("warnings", ()))
            for said in (*(line for line in assumed if line.startswith("assumed")), *odd):
                warnings.warn(f"{Path(given).name}: {said}", stacklevel=4)
            return trace
        case _ if is_table(given):
            trace, assumed = taken_table(given, columns or {}, joint)
            odd = cast("Sequence[str]", trace.facts.get("warnings", ()))
            for said in (*assumed, *odd):
                warnings.warn(f"the table: {said}", stacklevel=4)
            return trace
        case _:
            raise TypeError(
                f"recording is of type {type(given).__name__}; give a Trace, a Run, a Log, a table"
                " (a data frame, a dict of arrays, an array), or the path of a recording"
            )


def name_of(given: AnyRecording, place: int = 0) -> str:
    """Return a name for a recording: its file's name, or its number among several."""
    match given:
        case str() | PathLike():
            return Path(given).stem
        case Log():
            return given.path.stem
        case _:
            return f"recording {place + 1}" if place else "recording"


def named_traces(
    given: AnyRecording | Sequence[AnyRecording],
    columns: Mapping[str, str] | None = None,
    argument: str = "recordings",
    joint: str | None = None,
) -> list[tuple[str, Trace]]:
    """Return one recording or several, each with a name; columns, joint: see `trace_of`.

    argument: the name of the caller's argument, for messages. Raises the errors of `trace_of`,
    TypeError for a value that is neither a recording nor a sequence of recordings, and ValueError
    if none is given.
    """
    single = isinstance(given, Trace | Run | Log | str | PathLike) or is_table(given)
    if not single and not isinstance(given, Iterable):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise TypeError(
            f"{argument} is of type {type(given).__name__}; give a Trace, a Run, a Log, a table,"
            " the path of a recording, or a list of these"
        )
    several = cast("list[AnyRecording]", [given] if single else list(cast("Any", given)))
    if not several:
        raise ValueError(f"{argument} is empty: no recording is given; give at least one")
    return [
        (name_of(one, place), trace_of(one, columns, joint)) for place, one in enumerate(several)
    ]


def experiments_of(
    traces: Sequence[tuple[str, Trace]], device: Device, arms: Arms | None = None
) -> list[Experiment]:
    """Return recordings, each with its name, as the stretches that a diagnosis reads.

    arms: the robot's model and joint, if their torque on the device is to be computed. Raises
    ExperimentError for a recording that cannot be used with this device, and the errors of
    `with_known_torque`.
    """
    return [
        stretch
        for name, trace in traces
        for stretch in stretches(_beside(arms, trace, device), device, name)
    ]


def _beside(arms: Arms | None, trace: Trace, device: Device) -> Trace:
    """Return a recording with the torque of the arms on the device, if there are arms."""
    if arms is None:
        return trace
    if isinstance(arms, str) or len(arms) != 2:
        raise ValueError(
            f"known_torque is {arms!r}; give the model of a robot, MJCF or URDF, and the joint of"
            ' the robot that is the device: ("arm.xml", "elbow")'
        )
    return with_known_torque(trace, device, *arms)[0]

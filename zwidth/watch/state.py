"""The state of a growing log: read, checked, and limited to its last samples."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

from zwidth.diagnosis.intake.gate import examine
from zwidth.diagnosis.recording.experiment import SHORTEST, Experiment, ExperimentError, stretches
from zwidth.door import taken
from zwidth.logs.errors import LogEmpty, LogError
from zwidth.logs.recording import read_described
from zwidth.logs.recording_file import Description
from zwidth.logs.source import RecordingError
from zwidth.sim.device import Device
from zwidth.sim.trace import Trace

MUCH = 1 << 16  # bytes, above which an unreadable log will stay unreadable
EXAMINED = 6000  # last samples that are checked
OPEN_END = "the log was not closed"  # not a fault while a log is being written


@dataclass(frozen=True)
class Read:
    """The content of a log so far. said: how it was read; warnings: faults of its file.

    wanting: why nothing can be read yet (trace is then None), "" if something can.
    """

    trace: Trace | None = None
    said: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    wanting: str = ""

    @property
    def samples(self) -> int:
        """How many samples there are."""
        return 0 if self.trace is None else len(self.trace)

    @property
    def seconds(self) -> float:
        """The time from the first sample to the last."""
        if self.trace is None or len(self.trace) < 2:
            return 0.0
        return float(self.trace.t[-1] - self.trace.t[0])


def read(spool: Path, description: Description | None) -> Read:
    """Return the content of a log's copy; description: that of a recording TOML, if given.

    Raises LogError for an error that more samples cannot correct.
    """
    if not spool.exists():
        return Read(wanting="nothing has come yet")
    try:
        if description is None:
            trace, said = taken(spool)
        else:
            own = replace(description, file=spool.name)
            trace, said = read_described(own, spool.parent), []
    except LogEmpty:
        return Read(wanting="no sample has come yet")
    except LogError as error:
        said = str(error).replace(str(spool), spool.name)  # name the log, not its copy
        if spool.stat().st_size > MUCH:
            raise RecordingError(said) from None
        return Read(wanting=said)
    warnings = cast("list[str]", trace.facts.get("warnings", []))
    odd = tuple(w for w in warnings if not w.startswith(OPEN_END))
    return Read(trace, tuple(said), odd)


@dataclass(frozen=True)
class Gate:
    """What is odd about a log: kind -> sentence; problem: why it cannot be diagnosed, or ""."""

    faults: dict[str, str]
    problem: str = ""


def at_once(found: Read) -> Gate:
    """Look for faults that need no model: gaps, clipping, too few data."""
    faults = {f"file: {w}": w for w in found.warnings}
    if found.trace is None:
        return Gate(faults, found.wanting)
    if found.samples < SHORTEST:
        return Gate(faults, f"{found.samples} samples so far, of {SHORTEST} that are needed")
    return Gate(faults)


def gate(found: Read, device: Device | None, name: str) -> Gate:
    """Check the last samples like the intake of a diagnosis."""
    first = at_once(found)
    if first.problem or found.trace is None or device is None:
        return first
    faults = first.faults
    try:
        last = latest(found.trace, device, name, EXAMINED)
    except ExperimentError as error:
        return Gate(faults, str(error))
    for fault in examine(device, last):
        key = " ".join((fault.kind, *fault.channels))
        faults[key] = fault.sentence
    return Gate(faults)


def latest(trace: Trace, device: Device, name: str, samples: int) -> list[Experiment]:
    """Return the last samples without a gap; raises ExperimentError."""
    last = stretches(trace, device, name)[-1]
    if last.ticks <= samples:
        return [last]
    return [replace(last.part(last.ticks - samples, last.ticks), notes=last.notes)]

"""Reading of a fleet's recordings for the diagnosis, and a checksum of their files."""

import hashlib
from pathlib import Path

from zwidth.diagnosis.recording.experiment import Experiment, stretches
from zwidth.files.protection import reading
from zwidth.logs.assumed import assumed
from zwidth.logs.open_source import own_log
from zwidth.logs.recording import read_recording, read_source
from zwidth.logs.recording_file import description_of, load_description
from zwidth.logs.source import Source
from zwidth.sim.device import Device
from zwidth.sim.trace import Trace


def trace_of(path: Path) -> Trace:
    """Return a recording of any kind; columns of another tool's file are guessed from their names.

    Raises LogError if it cannot be read.
    """
    if path.suffix.lower() == ".toml":
        return read_recording(path)
    found = own_log(path)
    if not isinstance(found, Source):
        return found.tick
    guess = assumed(found, path.name)
    made = description_of(guess.text.encode(), path.with_suffix(".recording.toml"))
    return read_source(made, found, of_file=True)


def experiment_of(path: Path, device: Device, name: str) -> Experiment:
    """Return the longest stretch of a recording; raises ExperimentError, LogError."""
    parts = stretches(trace_of(path), device, name)
    return max(parts, key=lambda e: e.ticks)


def content_of(path: Path) -> str:
    """Return the SHA-256 of a recording: of its file, and of the data if the file is a TOML."""
    found = hashlib.sha256(reading(path).read_bytes())
    if path.suffix.lower() == ".toml":
        data = path.parent / load_description(path).file
        found.update(reading(data, f"is what {path.name} describes").read_bytes())
    return found.hexdigest()

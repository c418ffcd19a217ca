"""One sitting: a subject is diagnosed as a user would, and the answer is recorded."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from zwidth.diagnosis.diagnose import diagnose
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.exam.hidden import seen
from zwidth.exam.windows import FITTED
from zwidth.logs.recording import read_recording
from zwidth.scenarios.concealed.handout import (
    PARTS,
    VALIDATION,
    description_file,
    recording_files,
)
from zwidth.scenarios.concealed.sealing import digest
from zwidth.sim.device import Device
from zwidth.sim.device_file import device_to_text, load_device


@dataclass(frozen=True)
class Paper:
    """A subject to be diagnosed, by its folder and name."""

    folder: str
    name: str


def sit(paper: Paper) -> dict[str, Any]:
    """Return the answer of a diagnosis to a subject, in JSON's types.

    The keys: recording, sha256 of its files, samples, seconds (and of all cores), diagnosis,
    device (augmented, as a device file), error. A diagnosis that ends with an error is an answer
    too, a wrong one.
    """
    folder = Path(paper.folder)
    files = recording_files(folder, paper.name)
    answer: dict[str, Any] = {
        "recording": paper.name,
        "sha256": {name: digest(path) for name, path in files.items()},
        "diagnosis": None,
        "device": None,
        "error": None,
    }
    device = load_device(files["device"])
    recorded = recordings(folder, paper.name, device)
    start, busy = time.perf_counter(), time.process_time()
    try:
        if recorded.judge:
            found = diagnose(device, recorded.fit, recorded.judge)
        else:
            found = diagnose(device, recorded.fit)
    except Exception as error:
        answer["error"] = f"{type(error).__name__}: {error}"
    else:
        answer["diagnosis"] = plain(found.as_json())
        answer["device"] = device_to_text(found.device)
    answer["samples"] = sum(e.ticks for e in recorded.fit)
    answer["seconds"] = time.perf_counter() - start
    answer["core_seconds"] = time.process_time() - busy
    return answer


@dataclass(frozen=True)
class Recordings:
    """The recordings of a subject: those to fit to and, possibly, those to judge by."""

    fit: list[Experiment]
    judge: list[Experiment]

    def parts(self) -> tuple[list[Experiment], list[Experiment]]:
        """Return both, the last 30 % of each recording held out where none is there to judge by."""
        if self.judge:
            return self.fit, self.judge
        pairs = [e.split(FITTED) for e in self.fit]
        return [first for first, _ in pairs], [rest for _, rest in pairs]


def recordings(folder: Path, name: str, device: Device) -> Recordings:
    """Return the recordings of a subject as they lie in its folder."""
    found = {
        part: seen(read_recording(description_file(folder, name, part)), device)
        for part in recording_files(folder, name)
        if part in PARTS
    }
    judge = [e for part, e in found.items() if part == VALIDATION]
    return Recordings([e for part, e in found.items() if part != VALIDATION], judge)


def plain(value: Any) -> Any:
    """Return JSON's own types; what is not finite becomes null."""
    return msgspec.json.decode(msgspec.json.encode(value, enc_hook=float))

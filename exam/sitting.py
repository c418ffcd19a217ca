"""One sitting: a recording is diagnosed as anybody would, and what came out is written down."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from zwidth.diagnosis.diagnose import diagnose
from zwidth.exam.hidden import seen
from zwidth.logs.recording import read_recording
from zwidth.scenarios.concealed.handout import description_file, recording_files
from zwidth.scenarios.concealed.sealing import digest
from zwidth.sim.device_file import device_to_text, load_device


@dataclass(frozen=True)
class Paper:
    """A recording to be diagnosed, by its folder and name."""

    folder: str
    name: str


def sit(paper: Paper) -> dict[str, Any]:
    """Return what a diagnosis says of a recording, in JSON's types.

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
    recorded = seen(read_recording(description_file(folder, paper.name)), device)
    start, busy = time.perf_counter(), time.process_time()
    try:
        found = diagnose(device, [recorded])
    except Exception as error:
        answer["error"] = f"{type(error).__name__}: {error}"
    else:
        answer["diagnosis"] = plain(found.as_json())
        answer["device"] = device_to_text(found.device)
    answer["samples"] = recorded.ticks
    answer["seconds"] = time.perf_counter() - start
    answer["core_seconds"] = time.process_time() - busy
    return answer


def plain(value: Any) -> Any:
    """Return JSON's own types; what is not finite becomes null."""
    return msgspec.json.decode(msgspec.json.encode(value, enc_hook=float))

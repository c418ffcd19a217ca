"""What is handed out: recordings and a device file that say nothing of what is concealed.

DIR/recordings/r0001.csv, r0001.toml, r0001.device.toml
DIR/recordings/r0001_2.csv, r0001_2.toml                      a second recording of that device
DIR/recordings/r0001_validation.csv, r0001_validation.toml    one to judge by, not to fit to
DIR/keys/r0001.json                      to be kept apart until the diagnoses are in

A recording without a key is not finished, and made again in a folder whose DIR/keys/made.txt says
that it is the same work: files there are the work's own. Where there is no such list yet, none of
their names may be taken.
"""

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import tomli_w

from zwidth.files.whole import write_text
from zwidth.scenarios.concealed.sealing import MARK
from zwidth.sim.device import Device
from zwidth.sim.device_file import device_to_text
from zwidth.sim.trace import Trace

DIGITS = "%.10g"
TIME = "time"  # the channel of stamps, where a recording has them
VALIDATION = "validation"
PARTS: Mapping[str, str] = {"recording": "", "second": "_2", VALIDATION: "_validation"}
"""What is recorded of one device, by the ending of its files' names; all but the first may lack."""


def recording_files(folder: Path, name: str) -> dict[str, Path]:
    """Return the files of a recording that its key vouches for, those of further parts if there."""
    found = {part: data_file(folder, name, part) for part in PARTS}
    there = {part: f for part, f in found.items() if part == "recording" or f.exists()}
    return there | {"device": folder / "recordings" / f"{name}.device.toml"}


def data_file(folder: Path, name: str, part: str = "recording") -> Path:
    """Return the CSV of a part."""
    return folder / "recordings" / f"{name}{PARTS[part]}.csv"


def description_file(folder: Path, name: str, part: str = "recording") -> Path:
    """Return the recording TOML of a part."""
    return folder / "recordings" / f"{name}{PARTS[part]}.toml"


def key_file(folder: Path, name: str) -> Path:
    """Return the file of the key."""
    return folder / "keys" / f"{name}.json"


def all_files(folder: Path, name: str) -> list[Path]:
    """Return recordings, device file, descriptions and key, those too that are not there."""
    parts = [f(folder, name, part) for part in PARTS for f in (data_file, description_file)]
    return [*parts, recording_files(folder, name)["device"], key_file(folder, name)]


def made_file(folder: Path) -> Path:
    """Return the list of what the recordings were made by, which vouches for the folder."""
    return folder / "keys" / "made.txt"


def names(folder: Path) -> list[str]:
    """Return the recordings of a folder by name; those without a key are not finished."""
    return sorted(path.stem for path in (folder / "keys").glob("*.json"))


def write_data(folder: Path, name: str, traces: Mapping[str, Trace], device: Device) -> None:
    """Write samples of each part and device file, over those of one that was not finished."""
    for part, trace in traces.items():
        table = io.StringIO()
        table.write(",".join(trace.channels) + "\n")
        np.savetxt(table, np.column_stack(list(trace.channels.values())), DIGITS, ",")
        write_text(data_file(folder, name, part), table.getvalue(), own=True)
    write_text(recording_files(folder, name)["device"], device_to_text(device), own=True)


def write_descriptions(
    folder: Path, name: str, traces: Mapping[str, Trace], device: Device, sealed: str
) -> None:
    """Write the recording TOML of each part, which carries the seal."""
    for part, trace in traces.items():
        outputs = [channel for channel in trace.channels if channel not in ("command", TIME)]
        clock = {"time": TIME} if TIME in trace.channels else {"period_s": device.interface.period}
        top = {
            "schema": 1,
            "file": data_file(folder, name, part).name,
            "source": f"recording {name}, {MARK}{sealed}",
            "rotary": device.rotary,
            **clock,
            "input": {"signal": "command"},
            "output": [
                {"signal": c, "quantity": c.partition("_")[0], "at": c.partition("_")[2]}
                for c in outputs
            ],
        }
        write_text(description_file(folder, name, part), tomli_w.dumps(top), own=True)

"""What is handed out: a recording and a device file that say nothing of what is concealed.

DIR/recordings/r0001.csv, r0001.toml, r0001.device.toml
DIR/keys/r0001.json                      to be kept apart until the diagnoses are in

A recording without a key is not finished, and made again in a folder whose DIR/keys/made.txt says
that it is the same work: files there are the work's own. Where there is no such list yet, none of
their names may be taken.
"""

import io
from pathlib import Path

import numpy as np
import tomli_w

from zwidth.files.whole import write_text
from zwidth.scenarios.concealed.sealing import MARK
from zwidth.sim.device import Device
from zwidth.sim.device_file import device_to_text
from zwidth.sim.trace import Trace

DIGITS = "%.10g"


def recording_files(folder: Path, name: str) -> dict[str, Path]:
    """Return the files of a recording that its key vouches for."""
    stem = folder / "recordings" / name
    return {"recording": stem.with_suffix(".csv"), "device": stem.with_suffix(".device.toml")}


def description_file(folder: Path, name: str) -> Path:
    """Return the recording TOML."""
    return folder / "recordings" / f"{name}.toml"


def key_file(folder: Path, name: str) -> Path:
    """Return the file of the key."""
    return folder / "keys" / f"{name}.json"


def all_files(folder: Path, name: str) -> list[Path]:
    """Return recording, device file, description and key."""
    sealed = recording_files(folder, name).values()
    return [*sealed, description_file(folder, name), key_file(folder, name)]


def made_file(folder: Path) -> Path:
    """Return the list of what the recordings were made by, which vouches for the folder."""
    return folder / "keys" / "made.txt"


def names(folder: Path) -> list[str]:
    """Return the recordings of a folder by name; those without a key are not finished."""
    return sorted(path.stem for path in (folder / "keys").glob("*.json"))


def write_data(folder: Path, name: str, trace: Trace, device: Device) -> None:
    """Write samples and device file, over those of a recording that was not finished."""
    files = recording_files(folder, name)
    table = io.StringIO()
    table.write(",".join(trace.channels) + "\n")
    np.savetxt(table, np.column_stack(list(trace.channels.values())), DIGITS, ",")
    write_text(files["recording"], table.getvalue(), own=True)
    write_text(files["device"], device_to_text(device), own=True)


def write_description(folder: Path, name: str, trace: Trace, device: Device, sealed: str) -> None:
    """Write the recording TOML, which carries the seal."""
    outputs = [channel for channel in trace.channels if channel != "command"]
    top = {
        "schema": 1,
        "file": recording_files(folder, name)["recording"].name,
        "source": f"recording {name}, {MARK}{sealed}",
        "rotary": device.rotary,
        "period_s": device.interface.period,
        "input": {"signal": "command"},
        "output": [
            {"signal": c, "quantity": c.partition("_")[0], "at": c.partition("_")[2]}
            for c in outputs
        ],
    }
    write_text(description_file(folder, name), tomli_w.dumps(top), own=True)

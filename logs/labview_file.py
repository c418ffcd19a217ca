"""LabVIEW measurement files (.lvm): lines of header, names of the channels, columns of numbers.

Layout: "Specification for the LabVIEW Measurement File (.lvm)", NI. Each segment has its own
header, which gives unit and interval of each channel. The column Comment stands at the end of the
names and is empty in nearly every line.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from zwidth.logs.csv_file import decoded, read_csv
from zwidth.logs.csv_form import CsvOptions
from zwidth.logs.source import RecordingError, Signal, Source

START = b"LabVIEW Measurement"
END = "***End_of_Header***"
SEPARATORS = {"tab": "\t", "comma": ","}


def read_lvm(path: Path, data: bytes) -> Source:
    """Return the channels of the first segment; raises RecordingError."""
    lines = decoded(path, data).replace("\r\n", "\n").replace("\r", "\n").split("\n")
    ends = [i for i, line in enumerate(lines) if line.strip().startswith(END)]
    if not ends:
        raise RecordingError(f"{path.name} is a LabVIEW measurement without {END}: it is cut short")
    head = _header(lines[: ends[0]], "\t" if "\t" in "".join(lines[: ends[0]]) else ",")
    delimiter = SEPARATORS.get(head.get("Separator", ["tab"])[0].lower(), "\t")
    decimal = head.get("Decimal_Separator", ["."])[0] or "."
    own = _header(lines[ends[0] + 1 : ends[1]], delimiter) if len(ends) > 1 else {}
    start = ends[1] + 1 if len(ends) > 1 else ends[0] + 1
    stop = next((i - 1 for i in range(start + 2, len(lines)) if not lines[i].strip()), len(lines))
    names = [cell.strip() for cell in lines[start].split(delimiter)] if start < len(lines) else []
    width = len(names) - (names[-1:] == ["Comment"])
    if width < 1:
        raise RecordingError(f"{path.name} is a LabVIEW measurement without names of its channels")
    body = [delimiter.join(line.split(delimiter)[:width]) for line in lines[start : stop + 1]]
    table = "\n".join(line for line in body if line.strip(delimiter + " ")) + "\n"
    found = read_csv(path, table.encode(), CsvOptions(delimiter, decimal, 1))
    signals = _with_units(found, names[:width], head | own)
    notes = [f"only the first segment of {len(ends) - 1} is read"] if len(ends) > 2 else []
    return replace(found, kind="LabVIEW measurement", signals=signals, notes=tuple(notes))


def _header(lines: list[str], delimiter: str) -> dict[str, list[str]]:
    rows = [[cell.strip() for cell in line.split(delimiter)] for line in lines]
    return {row[0]: row[1:] for row in rows if row[0] and len(row) > 1}


def _with_units(found: Source, names: list[str], head: dict[str, list[str]]) -> dict[str, Signal]:
    """Return the signals with the units of the header, and the interval where no column is time."""
    units = head.get("Y_Unit_Label", [])
    channels = [name for name in names if not name.startswith("X_Value")]
    if head.get("X_Columns", [""])[0] == "Multi":  # a column of times before each channel
        units = units[::2]
    of = dict(zip(channels, units, strict=False))
    time = head.get("X_Dimension", ["Time"])[0] == "Time"
    signals = {
        name: replace(one, unit="s" if name.startswith("X_Value") and time else of.get(name, ""))
        for name, one in found.signals.items()
    }
    if not any(name.startswith("X_Value") for name in names) and "Delta_X" in head and time:
        try:
            interval = float(head["Delta_X"][0].replace(",", "."))
        except (ValueError, IndexError):
            return signals
        signals["Delta_X"] = Signal("Delta_X", np.array([interval]), "s")
    return signals

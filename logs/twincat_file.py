"""Tables that TwinCAT Scope exports as CSV: for each channel a column of times and one of values.

    Name          Axis1.fActPosition   Name          Axis1.fSetTorque
    SampleTime[ms] 1                   SampleTime[ms] 1
    SymbolName    MAIN.fActPosition    ...
    0             0.12                 0             0.3

Tabs, semicolons or commas separate the cells; lines about the whole file are above the channels.
Each channel has its own times, in milliseconds. Layout: TF3300 TC3 Scope Server, "Export formats:
CSV".
"""

import re
from pathlib import Path

import numpy as np

from zwidth.logs.cells import BLANKS, number_in
from zwidth.logs.csv_file import decoded
from zwidth.logs.source import RecordingError, Signal, Source

START = re.compile(rb"(?:\xef\xbb\xbf|\xff\xfe)?\s*Name\s*[\t;,]")
MARKS = ("SampleTime[ms]", "SymbolName", "Data-Type")  # words in a header of Scope
DELIMITERS = "\t;,"
LOOKED_AT = 20_000  # bytes
MILLISECOND = 1_000_000  # ns
LATEST = 9.2e12  # largest time in ms: nanoseconds with 63 bits


def is_scope(data: bytes) -> bool:
    """Return whether a text begins like an export of TwinCAT Scope."""
    head = data[:LOOKED_AT]
    return START.match(head) is not None and any(mark.encode() in head for mark in MARKS)


def read_scope(path: Path, data: bytes) -> Source:
    """Return the channels, each with its own stamps; raises RecordingError."""
    lines = decoded(path, data).splitlines()
    head = next(
        (line for line in lines if line.startswith(MARKS)),
        "",
    )
    delimiter = max(DELIMITERS, key=head.count)
    rows = [[cell.strip() for cell in line.split(delimiter)] for line in lines]
    width = len(next((row for row in rows if row[0] in MARKS), []))
    about = [row for row in rows if len(row) >= width and row[0] in ("Name", *MARKS)]
    decimal = "," if delimiter != "," else "."
    body = [
        row
        for row in rows
        if len(row) >= 2 and row[0] and number_in(row[0].replace(",", "."), ".") is not None
    ]
    if width < 2 or not body:
        raise RecordingError(
            f"{path.name} is an export of TwinCAT Scope without a sample; export it again"
        )
    names = next((row[1::2] for row in about if row[0] == "Name"), [])
    symbols = next((row[1::2] for row in about if row[0] == "SymbolName"), [])
    signals: dict[str, Signal] = {}
    lost = 0
    for k in range(width // 2):
        told: list[tuple[float, float]] = []
        for row in body:
            cells = row[2 * k : 2 * k + 2]
            if len(cells) < 2 or cells[0] in BLANKS:
                continue
            t, value = (number_in(cell.replace(decimal, "."), ".") for cell in cells)
            if t is None or not abs(t) < LATEST:
                lost += 1
                continue
            told.append((t, np.nan if value is None else value))
        if told:
            name = _free(_name(names, symbols, k), signals)
            table = np.array(told, dtype=np.float64)
            stamps = np.rint(table[:, 0] * MILLISECOND).astype(np.int64)
            signals[name] = Signal(name, table[:, 1], stamps={"stamp": stamps})
    if not signals:
        raise RecordingError(
            f"{path.name} is an export of TwinCAT Scope without a sample; export it again"
        )
    notes = (f"{lost} samples without a time are left out",) if lost else ()
    return Source(path, "TwinCAT Scope export", signals, notes=notes)


def _name(names: list[str], symbols: list[str], k: int) -> str:
    for known in (names, symbols):
        if k < len(known) and known[k]:
            return known[k]
    return f"channel {k + 1}"


def _free(name: str, taken: dict[str, Signal]) -> str:
    return name if name not in taken else f"{name} ({len(taken)})"

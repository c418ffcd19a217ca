"""Traces that CODESYS saves as CSV: for each variable a block of times and values.

    [key]; [value]
    0.Variable; GVL.fActPos
    0.Data;
    ; 0; 0.10
    ; 10; 0.12

Each variable has its own times, in milliseconds; blocks may differ in length.
"""

import re
from pathlib import Path

import numpy as np

from zwidth.logs.cells import number_in
from zwidth.logs.csv_file import decoded
from zwidth.logs.source import RecordingError, Signal, Source

VARIABLE = re.compile(r"(\d+)\.Variable\s*;\s*(.+?)\s*$")
START = re.compile(
    rb"(?:\xef\xbb\xbf)?\s*\[key\]\s*;\s*\[value\]|(?:\xef\xbb\xbf)?\d+\.Variable\s*;"
)
MILLISECOND = 1_000_000  # ns
LATEST = 9.2e12  # largest time in ms: nanoseconds with 63 bits


def is_trace(data: bytes) -> bool:
    """Return whether a text begins as a trace of CODESYS does."""
    return START.match(data[:256]) is not None


def read_trace(path: Path, data: bytes) -> Source:
    """Return the variables of a trace, each with its own stamps; raises RecordingError."""
    blocks: dict[str, list[tuple[float, float]]] = {}
    name, lost = "", 0
    for line in decoded(path, data).splitlines():
        if (matched := VARIABLE.match(line.strip())) is not None:
            name = _free(matched[2], blocks)
            blocks[name] = []
        elif name and line.lstrip().startswith(";"):
            cells = [cell.strip() for cell in line.split(";")][1:]
            pair = [number_in(cell, "," if "," in cell else ".") for cell in cells[:2]]
            if len(pair) == 2 and pair[0] is not None and abs(pair[0]) < LATEST:
                blocks[name].append((pair[0], np.nan if pair[1] is None else pair[1]))
            else:
                lost += 1
    signals = {name: _signal(name, rows) for name, rows in blocks.items() if rows}
    if not signals:
        raise RecordingError(f"{path.name} is a CODESYS trace without a sample; trace a variable")
    notes = (f"{lost} lines without a time are left out",) if lost else ()
    empty = {name: "is empty" for name, rows in blocks.items() if not rows}
    return Source(path, "CODESYS trace", signals, empty, notes)


def _free(name: str, taken: dict[str, list[tuple[float, float]]]) -> str:
    return name if name not in taken else f"{name} ({len(taken)})"


def _signal(name: str, rows: list[tuple[float, float]]) -> Signal:
    table = np.array(rows, dtype=np.float64)
    stamps = np.rint(table[:, 0] * MILLISECOND).astype(np.int64)
    return Signal(name, table[:, 1], stamps={"stamp": stamps})

"""Joint states written by `ros2 topic echo --csv`: one line per message, no line of names.

    1741089600,250000000,base_link,elbow,wrist,0.1,0.2,0.01,0.02,1.5,0.3

Seconds and nanoseconds, the frame, the names of the joints, then position, velocity and effort of
each; a cell is blank where a message lacks that quantity. Layout: fields in the order of
sensor_msgs/msg/JointState, arrays one after the other (ros2topic/verb/echo.py,
rosidl_runtime_py/convert.py, `message_to_csv`).
"""

import csv
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from zwidth.logs.cells import BLANKS, number_in
from zwidth.logs.csv_file import decoded
from zwidth.logs.source import RecordingError, Signal, Source

START = re.compile(rb"(?:\xef\xbb\xbf)?(\d{1,10}),(\d{1,9}),([^,\r\n]*),([A-Za-z_][^,\r\n]*),")
QUANTITIES = ("position", "velocity", "effort")
MOST_JOINTS = 200
SECOND = 1_000_000_000
LATEST = 9_200_000_000  # largest time in s: nanoseconds with 63 bits


def is_echo(data: bytes) -> bool:
    """Return whether a text begins with a joint state as a line without names."""
    first = data[:100_000].split(b"\n", 1)[0]
    return START.match(first) is not None and _layout(_cells(first.decode("latin1"))) is not None


def _cells(line: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line]), [])]
    except csv.Error:
        return []


def _layout(cells: Sequence[str]) -> tuple[list[str], list[tuple[str, int]]] | None:
    """Return the joints, and each quantity with the cell that it begins at; None for no message."""
    names: list[str] = []
    for cell in cells[3 : 3 + MOST_JOINTS]:
        if number_in(cell, ".") is not None or cell in BLANKS:
            break
        names.append(cell)
    if not names or len(set(names)) != len(names):
        return None
    at, found = 3 + len(names), list[tuple[str, int]]()
    for quantity in QUANTITIES:
        own = cells[at : at + len(names)]
        if len(own) == len(names) and all(number_in(cell, ".") is not None for cell in own):
            found.append((quantity, at))
            at += len(names)
        elif cells[at : at + 1] == [""]:
            at += 1
        else:
            return None
    return (names, found) if at == len(cells) and found else None


def read_echo(path: Path, data: bytes) -> Source:
    """Return the joints' signals, with the messages' clock; raises RecordingError."""
    lines = decoded(path, data).splitlines()
    layout = _layout(_cells(lines[0]))
    assert layout is not None, "is_echo said so"
    names, quantities = layout
    width = len(_cells(lines[0]))
    stamps, rows, lost = list[int](), list[list[float]](), 0
    for line in lines:
        cells = _cells(line)
        if not cells:
            continue
        whole = len(cells) == width and cells[3 : 3 + len(names)] == names
        counted = all(cell.isdecimal() and len(cell) <= 10 for cell in cells[:2])
        if not (whole and counted and int(cells[0]) < LATEST):
            lost += 1
            continue
        stamps.append(int(cells[0]) * SECOND + int(cells[1][:9]))
        numbers = (number_in(c, ".") for _, at in quantities for c in cells[at : at + len(names)])
        rows.append([np.nan if n is None else n for n in numbers])
    if not rows:
        raise RecordingError(f"{path.name} has no complete joint state; record it again")
    table, clock = np.array(rows, dtype=np.float64), np.array(stamps, dtype=np.int64)
    told = [f"{name}.{quantity}" for quantity, _ in quantities for name in names]
    signals = {
        name: Signal(name, table[:, k], stamps={"header.stamp": clock})
        for k, name in enumerate(told)
    }
    notes = (f"{lost} lines are no joint state of these joints and are left out",) if lost else ()
    return Source(path, "joint states of ros2 topic echo --csv", signals, notes=notes)

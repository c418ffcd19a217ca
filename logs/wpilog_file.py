"""WPILOG files (data logs of robots): each entry has its own stamps.

Layout: "WPILib Data Log File Format Specification", version 1.0. A record is an entry's number, the
size of its payload, a time in microseconds, and the payload; entry 0 begins and ends the others.
"""

import struct
from pathlib import Path
from typing import Any

import numpy as np

from zwidth.logs.source import RecordingError, Signal, Source

START = b"WPILOG"
KINDS = {"double": "<f8", "float": "<f4", "int64": "<i8", "boolean": "u1"}
MICROSECOND = 1000  # ns
MOST_ENTRIES, MOST_PLACES = 10_000, 1000
LATEST = (1 << 63) // MICROSECOND


def read_wpilog(path: Path, data: bytes) -> Source:
    """Return the entries of numbers; raises RecordingError."""
    if len(data) < 12:
        raise RecordingError(f"{path.name} is a WPILOG file that ends within its header")
    at = 12 + int.from_bytes(data[8:12], "little")
    names: dict[int, tuple[str, str]] = {}
    rows: dict[int, list[tuple[int, bytes]]] = {}
    notes: list[str] = []
    while at < len(data):
        head = data[at]
        sizes = (head & 3) + 1, (head >> 2 & 3) + 1, (head >> 4 & 7) + 1
        start = at + 1 + sum(sizes)
        entry, size, stamp = _numbers(data, at + 1, sizes)
        if start + size > len(data):
            notes.append("the last record is cut short and left out")
            break
        payload = data[start : start + size]
        at = start + size
        if entry == 0:
            if (begun := _begun(payload)) is not None and len(names) < MOST_ENTRIES:
                names[begun[0]] = begun[1:]
        elif entry in names and stamp < LATEST:
            rows.setdefault(entry, []).append((stamp * MICROSECOND, payload))
    signals: dict[str, Signal] = {}
    unreadable: dict[str, str] = {}
    for entry, (name, kind) in names.items():
        _take(signals, unreadable, name, kind, rows.get(entry, []))
    return Source(path, "WPILOG", signals, unreadable, tuple(notes))


def _numbers(data: bytes, at: int, sizes: tuple[int, int, int]) -> list[int]:
    found: list[int] = []
    for size in sizes:
        found.append(int.from_bytes(data[at : at + size], "little"))
        at += size
    return found


def _begun(payload: bytes) -> tuple[int, str, str] | None:
    """Return number, name and type of an entry that begins, None for another control record."""
    if payload[:1] != b"\0" or len(payload) < 9:
        return None
    entry, length = struct.unpack_from("<II", payload, 1)
    name, rest = payload[9 : 9 + length], payload[9 + length :]
    if len(rest) < 4:
        return None
    kind = rest[4 : 4 + int.from_bytes(rest[:4], "little")]
    return entry, name.decode(errors="replace"), kind.decode(errors="replace")


def _take(
    signals: dict[str, Signal],
    unreadable: dict[str, str],
    name: str,
    kind: str,
    rows: list[tuple[int, bytes]],
) -> None:
    single = kind.removesuffix("[]")
    if single not in KINDS:
        unreadable[name] = f"holds {kind}; a signal is numbers"
        return
    dtype: np.dtype[Any] = np.dtype(KINDS[single])
    size = len(rows[0][1]) if rows else 0
    places = size // dtype.itemsize
    whole = places * dtype.itemsize == size and all(len(payload) == size for _, payload in rows)
    if not whole or not 1 <= places <= MOST_PLACES:
        unreadable[name] = "is empty" if not rows else "holds values of differing lengths"
        return
    stamps = np.array([stamp for stamp, _ in rows], dtype=np.int64)
    table = np.frombuffer(b"".join(payload for _, payload in rows), dtype).reshape(-1, places)
    for k in range(places):
        part = f"{name}[{k}]" if kind.endswith("[]") else name
        signals[part] = Signal(part, table[:, k], stamps={"stamp": stamps})

"""JSON: records in a list or one per line, columns in an object, arrays of joints, settings.

A field of an object is `a.b`, an element of a list `a[k]`, counted from 0. A list of objects with
numbers in them is a table; a list of numbers is a signal; a list of equally long lists of numbers
is a matrix, a signal for each column.
"""

import json
from collections.abc import Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from zwidth.logs.source import Collector, RecordingError, Source

MOST_PARTS = 10_000  # signals of one file
DEEPEST = 16  # levels of nested objects
SCALAR = (int, float, str, bool, type(None))
LEAST_RECORDS = 3  # objects in a list; fewer are parts, not samples


def begins_as_json(data: bytes) -> bool:
    """Return whether a text begins like JSON, and not like a table with brackets in its header."""
    start = data[:4096].removeprefix(b"\xef\xbb\xbf").lstrip()
    if start[:1] == b"{":
        return start[1:].lstrip()[:1] in (b'"', b"}")
    return start[:1] == b"[" and start[1:].lstrip()[:1] in (b"{", b"[", b'"', b"]")


def read_json(path: Path, data: bytes) -> Source:
    """Return the signals of a JSON or JSON lines file; raises RecordingError."""
    notes: list[str] = []
    try:
        text = data.decode("utf-8-sig")
        try:
            value, kind = json.loads(text), "JSON"
        except ValueError as error:
            value, kind = _lines(text, error, notes), "JSON lines"
        found = _Parts(first=0)
        found.walk("", value, 0)
    except MemoryError:
        raise
    except (ValueError, RecursionError, OverflowError) as error:
        reason = " ".join(str(error).split())[:160]
        raise RecordingError(f"{path.name} cannot be read as JSON: {reason}") from None
    return Source(path, kind, found.signals, found.unreadable, tuple(notes))


def _lines(text: str, whole: ValueError, notes: list[str]) -> list[Any]:
    """Return the values of JSON lines; the last may be cut short. Raises ValueError."""
    lines = [line for line in text.splitlines() if line.strip()]
    if len(lines) < 2:
        raise whole
    found: list[Any] = []
    for number, line in enumerate(lines, start=1):
        try:
            found.append(json.loads(line))
        except ValueError:
            if number < len(lines) or number < 2:
                raise whole from None
            notes.append(f"the last line, {number}, is cut short and left out")
    return found


class _Parts(Collector):
    """A collector of the signals in nested objects and lists."""

    def walk(self, name: str, value: object, depth: int) -> None:
        """Take a value and all within it."""
        if len(self.signals) + len(self.unreadable) > MOST_PARTS:
            raise RecordingError(f"the file has more than {MOST_PARTS} signals")
        if depth > DEEPEST:
            self.unreadable[name] = f"lies more than {DEEPEST} objects deep"
        elif isinstance(value, dict):
            self._object(name, value, depth)
        elif isinstance(value, list):
            self._list(name, value, depth)
        elif isinstance(value, bool | int | float):
            self.take(name, [value])

    def take(self, name: str, values: Sequence[object]) -> None:
        """Take numbers, texts and nulls as a signal."""
        if all(isinstance(v, bool | int | float) for v in values):
            try:
                self.add(name, np.asarray(values, dtype=None))
            except (OverflowError, ValueError):
                self.unreadable[name] = "has numbers that no double holds"
            if name in self.unreadable and self.unreadable[name].startswith("holds object"):
                self.unreadable[name] = "has numbers that no double holds"
        else:
            self.add_cells(name, values)

    def _object(self, name: str, value: Mapping[str, object], depth: int) -> None:
        if isinstance(names := value.get("columns"), list) and _is_rows(value.get("data"), names):
            rows = value["data"]  # as pandas writes it with orient="split"
            assert isinstance(rows, list)
            records = [dict(zip(map(str, names), row, strict=True)) for row in rows]
            self._records(name, records, depth)
        elif len(value) >= LEAST_RECORDS and all(key.isdigit() for key in value):
            self._list(name, list(value.values()), depth)  # a column, as pandas writes it
        else:
            for key, part in value.items():
                self.walk(f"{name}.{key}" if name else key, part, depth + 1)

    def _list(self, name: str, value: Sequence[Any], depth: int) -> None:
        name = name or "values"
        if not value:
            self.unreadable[name] = "is empty"
        elif all(isinstance(v, SCALAR) for v in value):
            self.take(name, value)
        elif all(isinstance(v, dict) for v in value):
            if _are_records(value):
                self._records("" if name == "values" else name, value, depth)
            else:
                self._parts(name, value, depth)
        elif _is_rows(value, value[0]):
            for k, column in enumerate(zip(*value, strict=True)):
                self.take(f"{name}[{k}]", column)
        else:
            self._parts(name, value, depth)

    def _parts(self, name: str, value: Sequence[object], depth: int) -> None:
        for k, part in enumerate(islice(value, MOST_PARTS)):
            if isinstance(part, dict | list):
                self.walk(f"{name}[{k}]", part, depth + 1)

    def _records(self, name: str, records: Sequence[Mapping[str, object]], depth: int) -> None:
        columns: dict[str, list[object]] = {}
        for k, record in enumerate(records):
            for key, value in _leaves(record, depth):
                column = columns.setdefault(key, [])
                if len(column) <= k:
                    column.extend([None] * (k - len(column)))
                    column.append(value)
            if len(columns) > MOST_PARTS:
                raise RecordingError(f"the file has more than {MOST_PARTS} signals")
        for key, column in columns.items():
            column.extend([None] * (len(records) - len(column)))
            self.take(f"{name}.{key}" if name else key, column)


def _are_records(value: Sequence[Mapping[str, object]]) -> bool:
    """Return whether objects are samples: many, with numbers, and without long lists in them."""
    if len(value) < LEAST_RECORDS:
        return False
    first = value[0]
    return not any(isinstance(v, list) and len(v) >= 64 for v in first.values())


def _is_rows(value: object, like: object) -> bool:
    """Return whether a value is a list of lists of scalars, each as long as another list."""
    if not (isinstance(value, list) and isinstance(like, list) and value and like):
        return False
    return all(
        isinstance(row, list) and len(row) == len(like) and all(isinstance(v, SCALAR) for v in row)
        for row in value
    )


def _leaves(record: Mapping[str, object], depth: int) -> list[tuple[str, object]]:
    """Return the scalars within a record, each with its path in it."""
    found: list[tuple[str, object]] = []
    if depth > DEEPEST:
        return found
    for key, value in record.items():
        if isinstance(value, dict):
            found += [(f"{key}.{inner}", v) for inner, v in _leaves(value, depth + 1)]
        elif isinstance(value, list):
            found += [(f"{key}[{k}]", v) for k, v in enumerate(value) if isinstance(v, SCALAR)]
        elif isinstance(value, SCALAR):
            found.append((key, value))
    return found

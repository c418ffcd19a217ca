"""The content of a recorded file before it is interpreted: named signals, unconverted."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.logs.cells import column_of
from zwidth.logs.errors import LogError
from zwidth.logs.written_time import nanoseconds_of
from zwidth.sim.nearest import nearest

Floats = NDArray[np.float64]

TEXT = "is text; a signal is numbers"


class RecordingError(LogError):
    """An invalid recording or description; the message is a sentence with what to change."""


@dataclass(frozen=True)
class Signal:
    """A column, variable or field of a file.

    values: real numbers of the file's own type, shape (samples,); NaN for a blank cell. unit: as
    the file spells it, "" if it does not. stamps: of messages, clock -> (samples,) times [ns].
    note: a sentence on cells that are not numbers and count as gaps, "" for none. lost (samples,):
    True where whole numbers, which have no NaN, are missing; None for nowhere.
    """

    name: str
    values: NDArray[Any]
    unit: str = ""
    stamps: Mapping[str, NDArray[np.int64]] = field(default_factory=lambda: MappingProxyType({}))
    note: str = ""
    lost: NDArray[np.bool_] | None = None

    def floats(self) -> Floats:
        """Return the values as float64, NaN where one is missing, shape (samples,)."""
        values = np.asarray(self.values, dtype=np.float64)
        return values if self.lost is None else np.where(self.lost, np.nan, values)

    @property
    def known(self) -> NDArray[np.bool_]:
        """True for samples that have a finite value, (samples,)."""
        return np.isfinite(self.floats())


@dataclass(frozen=True)
class Source:
    """The signals of one file.

    kind: the format, in words. unreadable: signal -> why it is not a row of numbers. notes:
    sentences on irregularities of the file (lines above the header, a lost chunk). about: metadata
    that zwidth wrote into its own files; empty for other files. aliases: other names of signals.
    texts: text columns with few different values, (samples,), which say what each row belongs to.
    aside: signals that are used only where a description names them, such as a clock whose
    values already serve as time stamps.
    """

    path: Path
    kind: str
    signals: Mapping[str, Signal]
    unreadable: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    notes: tuple[str, ...] = ()
    about: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    aliases: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    texts: Mapping[str, NDArray[np.str_]] = field(default_factory=lambda: MappingProxyType({}))
    aside: Mapping[str, Signal] = field(default_factory=lambda: MappingProxyType({}))

    def __getitem__(self, name: str) -> Signal:
        """Return a signal by its name, or by its name and unit as in the file, "angle [deg]"."""
        name = self.aliases.get(name, name)
        if name in self.signals:
            return self.signals[name]
        if name in self.aside:
            return self.aside[name]
        for signal in self.signals.values():
            if name in (f"{signal.name} [{signal.unit}]", f"{signal.name} ({signal.unit})"):
                return signal
        if name in self.unreadable:
            raise RecordingError(f"{self.path.name}: {name!r} {self.unreadable[name]}")
        if not self.signals:
            raise RecordingError(f"{self.path.name} holds no signal of numbers at all")
        raise RecordingError(
            f"{self.path.name} has no signal {name!r}; {nearest(name, self.signals)}"
        )


@dataclass
class Collector:
    """The signals of a file: from arrays of any shape to named rows of numbers."""

    index: str = "{name}[{k}]"  # the name of the k-th signal of a matrix, k from first
    first: int = 0
    signals: dict[str, Signal] = field(default_factory=dict[str, Signal])
    unreadable: dict[str, str] = field(default_factory=dict[str, str])

    def add(self, name: str, values: Any, unit: str = "") -> None:
        """Add an array: a vector is a signal, a matrix one signal for each column.

        Time runs along the longer side of a matrix.
        """
        array, lost = _plain(np.asarray(values))
        if array.dtype.kind in "SU" and max(array.shape, default=1) == array.size > 1:
            self.add_cells(name, array.reshape(-1).astype(np.str_).tolist(), unit)
        elif array.dtype.names is not None:
            for part in array.dtype.names:
                self.add(f"{name}.{part}" if name else part, array[part], unit)
        elif (reason := _no_numbers(array)) is not None:
            self.unreadable[name] = reason
        elif max(array.shape, default=1) == array.size:
            self.signals[name] = Signal(name, array.reshape(-1), unit, lost=lost)
        elif array.ndim > 2:
            self.unreadable[name] = f"has {array.ndim} dimensions; a signal has one"
        else:
            columns = array if array.shape[0] >= array.shape[1] else array.T
            for k in range(columns.shape[1]):
                part = self.index.format(name=name, k=k + self.first)
                self.signals[part] = Signal(part, columns[:, k], unit)

    def add_cells(self, name: str, cells: Iterable[object], unit: str = "") -> None:
        """Add a column of texts and numbers: a signal with gaps if numbers are the majority."""
        cells = list(cells)
        column = column_of(name, cells)
        if column is None and (times := nanoseconds_of(cells)) is not None:
            lost = times[1] if times[1].any() else None
            self.signals[name] = Signal(name, times[0], "ns", lost=lost)
        elif column is None:
            self.unreadable[name] = TEXT
        else:
            self.signals[name] = Signal(name, column[0], unit, note=column[1])


def _plain(array: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.bool_] | None]:
    """Return dates and durations as int64 nanoseconds and which are missing; others as they are."""
    if array.dtype.kind not in "mM":
        return array, None
    missing = np.isnat(array)
    if missing.all() or (missing.any() and array.ndim != 1):
        return array, None
    since = array.astype(f"{array.dtype.kind}8[ns]").astype(np.int64)
    if not missing.any():
        return since, None
    return np.where(missing, since[~missing].min(), since), missing


def _no_numbers(array: NDArray[Any]) -> str | None:
    """Return why an array is not a row of real numbers, or None."""
    if array.dtype.kind in "US":
        return TEXT
    if array.dtype.kind == "c":
        return "is complex; a signal is real numbers"
    if array.dtype.kind in "mM":
        return "holds dates that are missing; a signal is numbers"
    if array.dtype.kind not in "biuf":
        return f"holds {array.dtype}; a signal is numbers"
    return "is empty" if array.size == 0 else None

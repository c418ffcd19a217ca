"""Tables in a program's memory (data frames, dictionaries of arrays, arrays) as signals by name.

From a frame of pandas or polars or a table of Arrow only the column names, the columns and
`__array__` are used, so none of these libraries is needed. An index of times, or of numbers that
are not row numbers, is a column too.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from zwidth.logs.source import Collector, RecordingError, Source

INDEX = "time"  # name of an index without a name


@runtime_checkable
class Frame(Protocol):
    """A data frame, of pandas, polars or alike."""

    @property
    def columns(self) -> Iterable[Any]:
        """The names of its columns."""
        ...

    def __getitem__(self, name: Any, /) -> Any: ...


AnyTable = Frame | Mapping[str, Any] | NDArray[Any]


def is_table(given: object) -> bool:
    """Return whether a value is a table."""
    return isinstance(given, Mapping | np.ndarray | Frame)


def source_of(given: AnyTable, name: str = "the table") -> Source:
    """Return a table as signals; columns of an array without names are "0", "1" ...

    Raises RecordingError for one whose columns differ in length or that has none.
    """
    found = Collector("{name}")
    for column, values in _columns(given):
        found.add(column, values)
    if not found.signals:
        reasons = "; ".join(f"{key} {why}" for key, why in list(found.unreadable.items())[:4])
        raise RecordingError(f"{name} has no column of numbers{f': {reasons}' if reasons else ''}")
    return Source(Path(name), "table in memory", found.signals, found.unreadable)


def _columns(given: AnyTable) -> list[tuple[str, Any]]:
    if isinstance(given, np.ndarray):
        if given.dtype.names is not None:
            return [(column, given[column]) for column in given.dtype.names]
        if given.ndim != 2:
            raise RecordingError(
                f"an array of {given.ndim} dimensions is given as a recording; give two"
                " dimensions, with one column per signal"
            )
        return [(str(k), given[:, k]) for k in range(given.shape[1])]
    if isinstance(given, Mapping):
        return [(str(column), np.asarray(values)) for column, values in given.items()]
    if (
        hasattr(given, "collect_schema")
        and hasattr(given, "collect")
        and not hasattr(given, "rows")
    ):
        raise RecordingError("a LazyFrame of polars holds no numbers yet; give frame.collect()")
    # In Arrow, `columns` contains the columns themselves; their names are here.
    names = getattr(given, "column_names", given.columns)
    found = [(str(column), np.asarray(given[column])) for column in names]
    index = getattr(given, "index", None)
    if index is not None and not callable(index):
        values = np.asarray(index)
        named = getattr(index, "name", None)
        if values.dtype.kind in "mMf" or (named is not None and values.dtype.kind in "iu"):
            found.insert(0, (str(named or INDEX), values))
    return found

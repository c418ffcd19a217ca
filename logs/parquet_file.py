"""Parquet files: every column of numbers, fields of structures as `s.f`."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from zwidth.logs.source import Collector, RecordingError, Signal, Source
from zwidth.logs.unpacked import refuse_bomb

MOST_PLACES = 1000  # most elements of a list that become separate signals
ABOUT = b"zwidth"  # the key in the file's own metadata


def read_parquet(path: Path, data: bytes) -> Source:
    """Return the columns of a Parquet file, NaN for null; raises RecordingError."""
    import pyarrow as pa
    from pyarrow import parquet

    found = Collector()
    try:
        file = parquet.ParquetFile(pa.BufferReader(data))
        refuse_bomb(path, _unpacked(file.metadata), len(data))
        texts = [c.path for c in map(file.schema.column, range(len(file.schema))) if _is_text(c)]
        # A text that is repeated in millions of rows is stored only once, here too.
        file = parquet.ParquetFile(pa.BufferReader(data), read_dictionary=texts)
        table = file.read(use_threads=False)
        table.validate(full=True)
        about = _about(path, table.schema.metadata or {})
        for _ in range(16):  # nested structures
            if not any(pa.types.is_struct(column.type) for column in table.columns):
                break
            table = table.flatten()
        for name, column in zip(table.column_names, table.columns, strict=True):
            _take(found, name, column)
    except (RecordingError, MemoryError):
        raise
    except Exception as error:  # Arrow raises OSError, ArrowInvalid, NotImplementedError, KeyError
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        raise RecordingError(f"{path.name} is a damaged Parquet file: {reason}") from None
    return Source(path, "Parquet", found.signals, found.unreadable, about=about)


def _unpacked(metadata: Any) -> int:
    """Return to how many bytes the columns unpack, by the metadata.

    Values that repeat are stored once, so that the sizes of pages alone say too little.
    """
    widths = [max(8, metadata.schema.column(k).length) for k in range(metadata.num_columns)]
    total = 0
    for group in map(metadata.row_group, range(metadata.num_row_groups)):
        columns = [group.column(k) for k in range(group.num_columns)]
        for width, column in zip(widths, columns, strict=True):
            total += max(column.total_uncompressed_size, width * column.num_values)
    return total


def _is_text(column: Any) -> bool:
    return column.physical_type == "BYTE_ARRAY" and column.max_repetition_level == 0


def _cells(column: Any) -> list[object]:
    """Return the cells of texts with a dictionary, each text once in memory."""
    cells: list[object] = []
    for chunk in column.chunks:
        words = chunk.dictionary.to_pylist()
        cells += [None if k is None else words[k] for k in chunk.indices.to_pylist()]
    return cells


def _take(found: Collector, name: str, column: Any) -> None:
    import pyarrow as pa

    kind = column.type
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
        if pa.types.is_string(kind) or pa.types.is_large_string(kind):
            found.add_cells(name, _cells(column))
            return
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        column = column.cast(
            pa.timestamp("ns", kind.tz) if hasattr(kind, "tz") else pa.duration("ns")
        )
        _take_dates(found, name, column.cast(pa.int64()))
    elif pa.types.is_string(kind) or pa.types.is_large_string(kind):
        found.add_cells(name, column.to_pylist())
    elif pa.types.is_decimal(kind):
        found.add(name, column.cast(pa.float64()).to_numpy())
    elif _is_list(kind):
        _take_lists(found, name, column)
    elif pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind):
        values = column.to_numpy()
        found.add(name, values if values.dtype != object else values.astype(np.float64))
    else:
        found.unreadable[name] = f"holds {kind}; a signal is numbers"


def _is_list(kind: Any) -> bool:
    import pyarrow as pa

    lists = (pa.types.is_list, pa.types.is_large_list, pa.types.is_fixed_size_list)
    if not any(is_one(kind) for is_one in lists):
        return False
    inner = kind.value_type
    return pa.types.is_integer(inner) or pa.types.is_floating(inner) or pa.types.is_boolean(inner)


def _take_lists(found: Collector, name: str, column: Any) -> None:
    """Take lists of equally many numbers, as of the joints of a robot: a signal for each place."""
    import pyarrow as pa
    import pyarrow.compute

    compute: Any = pyarrow.compute  # created at import, unknown to type checkers
    lengths = compute.unique(compute.drop_null(compute.list_value_length(column))).to_pylist()
    if len(lengths) != 1 or not 1 <= lengths[0] <= MOST_PLACES:
        found.unreadable[name] = "holds lists of differing lengths; a signal is numbers"
        return
    for k in range(lengths[0]):
        part = compute.list_element(column, k).cast(pa.float64()).to_numpy()
        found.add(f"{name}[{k}]", part)


def _take_dates(found: Collector, name: str, column: Any) -> None:
    """Take times [ns] as whole numbers, which a double would round, and mark the missing ones."""
    if not column.null_count:
        found.add(name, column.to_numpy(), "ns")
    elif column.null_count == len(column):
        found.unreadable[name] = "holds dates that are missing; a signal is numbers"
    else:
        lost = column.is_null().to_numpy()
        earliest = column.drop_null().to_numpy().min()
        values = column.fill_null(int(earliest)).to_numpy()
        found.signals[name] = Signal(name, values, "ns", lost=lost)


def _about(path: Path, metadata: dict[bytes, bytes]) -> dict[str, Any]:
    try:
        about = json.loads(metadata.get(ABOUT, b"{}"))
    except (ValueError, RecursionError):
        raise RecordingError(
            f"{path.name}: what zwidth wrote into its metadata is damaged; describe the columns in"
            " a TOML"
        ) from None
    return about if isinstance(about, dict) else {}

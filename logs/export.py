"""A log as CSV, Parquet or NPZ: every sample to the bit, and a sentence on each part left out.

NPZ can store all of a log, Parquet all but the substep trace, CSV one table and a line of JSON. The
functions write to an open binary file; the caller keeps an older file of that name until the new
one is complete.
"""

import io
import zipfile
from collections.abc import Callable
from typing import IO, Any

import numpy as np

from zwidth.logs.csv_file import ABOUT as CSV_ABOUT
from zwidth.logs.mcap_reader import Log
from zwidth.logs.npz_file import ABOUT as NPZ_ABOUT
from zwidth.logs.parquet_file import ABOUT as PARQUET_ABOUT
from zwidth.logs.table_log import (
    ATTACHMENT,
    SUBSTEP,
    about_of,
    as_json,
    columns_of,
    encoded,
    events_of,
)

Writer = Callable[[IO[bytes], Log], list[str]]


def write_csv(stream: IO[bytes], log: Log) -> list[str]:
    """Write the trace of ticks as CSV; return a sentence on each part that is left out.

    Numbers have the fewest digits that read back to the same double.
    """
    import pyarrow as pa
    from pyarrow import csv

    columns, _ = columns_of(log.tick)
    stream.write(f"{CSV_ABOUT}{as_json(about_of(log))}\n{','.join(columns)}\n".encode())
    if len(log.tick):
        csv.write_csv(pa.table(columns), stream, csv.WriteOptions(include_header=False))
    return [*_no_substep(log), *_no_events(log), *_no_attachments(log)]


def write_parquet(stream: IO[bytes], log: Log) -> list[str]:
    """Write the trace of ticks as Parquet; return a sentence on each part that is left out."""
    import pyarrow as pa
    from pyarrow import parquet

    columns, described = columns_of(log.tick)
    about = about_of(log) | {"events": events_of(log), "attachments": encoded(log.attachments)}
    units = {column: unit for column, (_, unit, _) in described["columns"].items()}
    fields = [
        pa.field(column, pa.float64(), metadata={"unit": units.get(column, "s")})
        for column in columns
    ]
    schema = pa.schema(fields, metadata={PARQUET_ABOUT: as_json(about).encode()})
    parquet.write_table(
        pa.table(columns, schema=schema),
        stream,
        compression="zstd",
        use_dictionary=False,
        use_byte_stream_split=True,  # stores equal bytes of neighbouring doubles together
    )
    return _no_substep(log)


def write_npz(stream: IO[bytes], log: Log) -> list[str]:
    """Write all of a log as NPZ; nothing is left out."""
    columns, _ = columns_of(log.tick)
    about = about_of(log) | {
        "events": events_of(log),
        "attachments": {name: len(data) for name, data in log.attachments.items()},
    }
    arrays: dict[str, np.ndarray[Any, Any]] = dict(columns)
    if log.substep is not None:
        fine, described = columns_of(log.substep, SUBSTEP)
        arrays |= fine
        about["substep"] = described
    for name, data in log.attachments.items():
        arrays[f"{ATTACHMENT}{name}"] = np.frombuffer(data, dtype=np.uint8)
    arrays[NPZ_ABOUT] = np.frombuffer(as_json(about).encode(), dtype=np.uint8)
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=3) as archive:
        for name, values in arrays.items():
            entry = io.BytesIO()
            np.lib.format.write_array(entry, np.ascontiguousarray(values), allow_pickle=False)
            # With the current date, the archive would differ each time it is written.
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), entry.getvalue(), zipfile.ZIP_DEFLATED)
    return []


WRITERS: dict[str, Writer] = {".csv": write_csv, ".parquet": write_parquet, ".npz": write_npz}
"""Suffix of a file name -> the function that writes it."""


def _no_substep(log: Log) -> list[str]:
    if log.substep is None:
        return []
    return [f"the substep trace of {len(log.substep)} samples (NPZ and MCAP keep it)"]


def _no_events(log: Log) -> list[str]:
    return [f"{len(log.events)} events (Parquet, NPZ and MCAP keep them)"] if log.events else []


def _no_attachments(log: Log) -> list[str]:
    if not log.attachments:
        return []
    names = ", ".join(log.attachments)
    return [f"the attachments {names} (Parquet, NPZ and MCAP keep them)"]

"""Rows of the comparison, kept between runs so that the table can be drawn without computing.

ROWS.json beside an .npz of every free run, in a folder of results; written whole or not at all.
"""

import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from benchmarks.peer.sets import Error, Floats
from zwidth.files.protection import writing_as
from zwidth.files.whole import write_text, write_with

ROWS = "rows.json"


class Row(msgspec.Struct, frozen=True):
    """What a method reaches on a set: errors as in `sets.Error`, None if its run diverges.

    peer: what to run to get it; seconds of CPU of the fit, the choice of its settings included,
    None if it came with another.
    """

    set: str
    peer: str
    method: str
    units: tuple[str, ...]
    rms: tuple[float | None, ...]
    share: tuple[float | None, ...]
    seconds: float | None
    found: str


def row_of(error: Error, **rest: Any) -> Row:
    """Return a row; what is infinite is None, as JSON has it."""
    finite = [[v if math.isfinite(v) else None for v in each] for each in (error.rms, error.share)]
    return Row(rms=tuple(finite[0]), share=tuple(finite[1]), **rest)


def kept(folder: Path) -> list[Row]:
    """Return the rows of a folder, none where nothing was computed.

    Raises ValueError if the file is not one of rows.
    """
    path = folder / ROWS
    if not path.exists():
        return []
    try:
        return msgspec.json.decode(path.read_bytes(), type=list[Row])
    except msgspec.DecodeError as error:
        raise ValueError(
            f"{path} is not what benchmarks/peers.py wrote ({error}); remove it and compute again"
        ) from error


def keep(folder: Path, new: Sequence[Row]) -> None:
    """Put rows into a folder, in the place of those of the same set and peer."""
    redone = {(row.set, row.peer) for row in new}
    rows = [row for row in kept(folder) if (row.set, row.peer) not in redone] + list(new)
    with writing_as("peers", overwrite=True):
        text = msgspec.json.format(msgspec.json.encode(rows), indent=1).decode()
        write_text(folder / ROWS, text + "\n")


def keep_run(folder: Path, name: str, run: Floats) -> None:
    """Keep a series (ticks, o)."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, run=run)
    with writing_as("peers", overwrite=True):
        write_with(folder / f"{file_name(name)}.npz", lambda f: f.write(buffer.getvalue()))


def kept_run(folder: Path, name: str) -> Floats:
    """Return a series that was kept (ticks, o); raises OSError if it is not there."""
    with np.load(folder / f"{file_name(name)}.npz") as file:
        return np.asarray(file["run"], dtype=np.float64)


def file_name(name: str) -> str:
    """A name of letters, digits and underscores."""
    return "".join(c if c.isalnum() else "_" for c in name)

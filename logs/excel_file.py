"""Excel workbooks: the first sheet that is a table, read like a text table.

A sheet becomes lines of cells with tabs between them, so that headers, units on a line of their
own, gaps and written times are found as in any text table (`csv_form.py`). Formulas give the value
that Excel last saved; dates become the time of day and date that they show.
"""

import io
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from datetime import date, datetime, time, timedelta
from pathlib import Path

from zwidth.logs.csv_file import read_csv
from zwidth.logs.csv_form import NOTHING_SAID, CsvOptions
from zwidth.logs.source import RecordingError, Source
from zwidth.logs.unpacked import refuse_bomb

MOST_BYTES = 1 << 31  # of a workbook, unpacked
LEAST_ROWS = 3  # of numbers, that make a sheet a table
INSIDE = "xl/"  # the folder within the archive that tells a workbook from an NPZ


def is_workbook(data: bytes) -> bool:
    """Return whether an archive that begins as a ZIP does is a workbook."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return any(name.startswith(INSIDE) for name in archive.namelist())
    except Exception:  # zipfile raises what it meets in a damaged one
        return False


def read_excel(path: Path, data: bytes, options: CsvOptions = NOTHING_SAID) -> Source:
    """Return the columns of the first sheet that is a table; raises RecordingError."""
    import python_calamine as calamine

    refused = "it has no sheet"
    try:
        _refuse_huge(path, data)
        book = calamine.load_workbook(io.BytesIO(data))
        for name in book.sheet_names:
            rows = book.get_sheet_by_name(name).to_python()
            try:
                return _table(path, name, rows, options)
            except RecordingError as error:
                refused = f"sheet {name!r}: {error}"
    except (RecordingError, MemoryError, KeyboardInterrupt):
        raise
    except BaseException as error:  # calamine is Rust: where it panics, that is no Exception
        if isinstance(error, SystemExit | GeneratorExit):
            raise
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        raise RecordingError(
            f"{path.name} cannot be read as an Excel workbook ({reason}); save the sheet as CSV"
        ) from None
    raise RecordingError(
        f"{path.name} is an Excel workbook without a table of numbers ({refused}); save the sheet"
        " with one row of names above the numbers, or as CSV"
    )


def _refuse_huge(path: Path, data: bytes) -> None:
    if not data.startswith(b"PK"):
        return
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        unpacked = sum(entry.file_size for entry in archive.infolist())
    refuse_bomb(path, unpacked, len(data), MOST_BYTES)


def _table(path: Path, sheet: str, rows: Sequence[Sequence[object]], options: CsvOptions) -> Source:
    text = "\n".join("\t".join(map(_cell, row)) for row in rows) + "\n"
    found = read_csv(path, text.encode(), replace(options, delimiter="\t"))
    if max((one.known.sum() for one in found.signals.values()), default=0) < LEAST_ROWS:
        raise RecordingError(f"it has fewer than {LEAST_ROWS} rows of numbers")
    return replace(found, kind=f"Excel workbook, sheet {sheet!r}")


def _cell(value: object) -> str:
    match value:
        case bool():
            return str(int(value))
        case float() | int():
            return repr(value)
        case datetime() | date() | time():
            return value.isoformat()
        case timedelta():
            return repr(value.total_seconds())
        case _:
            return " ".join(str(value).split())

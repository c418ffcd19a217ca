"""Excel workbooks: the first sheet that is a table, read like a text table.

A sheet becomes lines of cells with tabs between them, so that headers, units on a line of their
own, gaps and written times are found as in any text table (`csv_form.py`). Formulas give the value
that Excel last saved; dates become the time of day and date that they show.
"""

import io
import zipfile
from dataclasses import replace
from pathlib import Path

from zwidth.logs.csv_file import read_csv
from zwidth.logs.csv_form import NOTHING_SAID, CsvOptions
from zwidth.logs.excel_bounds import MOST_BYTES, bounded
from zwidth.logs.excel_text import sheets, sheets_apart
from zwidth.logs.source import RecordingError, Source
from zwidth.logs.unpacked import most_bytes

LEAST_ROWS = 3  # least rows of numbers in a table
INSIDE = "xl/"  # a folder in the archive that distinguishes a workbook from an NPZ


def is_workbook(data: bytes) -> bool:
    """Return whether an archive that begins like a ZIP is a workbook."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return any(name.startswith(INSIDE) for name in archive.namelist())
    except Exception:  # for a damaged archive zipfile raises many types
        return False


def read_excel(path: Path, data: bytes, options: CsvOptions = NOTHING_SAID) -> Source:
    """Return the columns of the first sheet that is a table; raises RecordingError."""
    refused = "it has no sheet"
    try:
        if data.startswith(b"PK"):
            found = sheets(bounded(path, data))
        else:  # older than 2007
            found = sheets_apart(data, most_bytes(len(data), MOST_BYTES))
        for name, text in found:
            try:
                return _table(path, name, text, options)
            except RecordingError as error:
                refused = f"sheet {name!r}: {error}"
    except (RecordingError, MemoryError, KeyboardInterrupt):
        raise
    except BaseException as error:  # calamine is Rust: a panic is not an Exception
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


def _table(path: Path, sheet: str, text: str, options: CsvOptions) -> Source:
    found = read_csv(path, text.encode(), replace(options, delimiter="\t"))
    if max((one.known.sum() for one in found.signals.values()), default=0) < LEAST_ROWS:
        raise RecordingError(f"it has fewer than {LEAST_ROWS} rows of numbers")
    return replace(found, kind=f"Excel workbook, sheet {sheet!r}")

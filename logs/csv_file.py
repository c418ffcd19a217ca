"""Text tables: CSV, TSV and columns of blanks, by whatever tool they were written.

Lines that begin with #, % or // are comments. A blank cell is NaN, and so is a cell of text in a
column of numbers, which the signal's note tells with its line. A column of text does not spoil the
others: it is reported as unreadable, with line and column of its first text.
"""

import json
from collections.abc import Iterable, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.logs.cells import BLANKS, NOT_A_NUMBER, Tally, number_in
from zwidth.logs.csv_form import (
    NOTHING_SAID,
    SNIFFED,
    CsvOptions,
    Form,
    Lines,
    cells_of,
    find_form,
)
from zwidth.logs.labelled_text import table_of
from zwidth.logs.source import Floats, RecordingError, Signal, Source
from zwidth.logs.written_time import is_date, nanoseconds_of

ABOUT = "# zwidth "  # begins the line of JSON in a file of our own
COMMENTS = ("#", "%", "//")


def read_csv(path: Path, data: bytes, options: CsvOptions = NOTHING_SAID) -> Source:
    """Return the columns of a text table; raises RecordingError where it is none."""
    text = decoded(path, data)
    notes: list[str] = []
    if options == NOTHING_SAID and (table := table_of(text)) is not None:
        text = table
        notes.append("each number stands beside its name, and other lines are left out")
    lines = _lines(text)
    about = _about(path, lines.comments)
    if about and len(lines.text) == 1:  # a log of ours without a sample
        empty = dict.fromkeys(lines.text[0].split(","), "is empty")
        return Source(path, "text table (commas)", {}, empty, about=about)
    if about:  # whatever its columns are called, "nan" among them
        options = CsvOptions(",", ".", lines.numbers[0])
    form = find_form(path, lines, options)
    if form.left_out:
        notes.append(f"lines above the table are left out: {', '.join(map(str, form.left_out))}")
    rows, numbers = lines.text[form.first :], lines.numbers[form.first :]
    if rows and len(cells_of(rows[-1], form.delimiter)) < len(form.names):
        notes.append(f"the last line, {numbers[-1]}, is cut short and left out")
        rows = rows[:-1]
    elif not text.endswith(("\n", "\r")):
        notes.append("the last line has no end; if the file was cut off, its last number may be")
    if not rows:
        raise RecordingError(f"{path.name} has column names but no line of numbers")
    if form.decimal == "," and len(form.names) == 1 and any("," in row for row in rows[:SNIFFED]):
        notes.append('one column with decimal commas is read; if it is two, say delimiter = ","')
    columns = _columns(path, rows, numbers, form)
    signals: dict[str, Signal] = {}
    unreadable: dict[str, str] = {}
    texts = [j for j, column in enumerate(columns) if isinstance(column, str)]
    times = _times(rows, form, texts)
    for j, (name, unit, column) in enumerate(zip(form.names, form.units, columns, strict=True)):
        if j in times:
            name = name or f"column{j + 1}"
            values, lost = times[j]
            signals[name] = Signal(name, values, "ns", lost=lost if lost.any() else None)
            continue
        if isinstance(column, str):
            unreadable[name] = column
            continue
        values, note = column
        if name or not np.isnan(values).all():  # a delimiter at the end of every line names none
            name = name or f"column{len(signals) + 1}"
            signals[name] = Signal(name, values, unit, note=note)
    return Source(path, _kind(form), signals, unreadable, tuple(notes), about)


def decoded(path: Path, data: bytes) -> str:
    """Return the text: UTF-16 by its mark, UTF-8, or else the Windows code page."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        try:
            return data.decode("utf-16")
        except UnicodeDecodeError as error:
            raise RecordingError(f"{path.name} is no UTF-16 text: {error.reason}") from None
    if b"\0" in data:
        raise RecordingError(
            f"{path.name} is neither text nor a format known here; known are MCAP, MAT, NPZ, NPY,"
            " Parquet, HDF5 and text tables"
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def _lines(text: str) -> Lines:
    if "\r" in text:
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    split = text.split("\n")
    comments = [line for line in split if line.startswith(COMMENTS)]
    if not comments and all(map(str.strip, split[:-1])):
        kept = split if split[-1].strip() else split[:-1]
        return Lines(kept, range(1, len(kept) + 1), comments)
    numbered = [
        (line, number)
        for number, line in enumerate(split, start=1)
        if line.strip() and not line.startswith(COMMENTS)
    ]
    return Lines([line for line, _ in numbered], [number for _, number in numbered], comments)


def _columns(
    path: Path, rows: list[str], numbers: Sequence[int], form: Form
) -> list[tuple[Floats, str] | str]:
    """Return each column as float64 with its note, or the sentence that says why it is text."""
    try:
        return [(column, "") for column in _fast(rows, form)]
    except ValueError:  # a text, a ragged line, a plus sign: the slow way says which, or reads it
        return _slow(path, rows, numbers, form)


def _fast(rows: list[str], form: Form) -> Iterable[Floats]:
    """Parse with Arrow; raises ValueError for anything that is not a plain table of numbers."""
    import pyarrow as pa
    from pyarrow import csv as arrow

    joined = "\n".join(rows)
    if form.delimiter == " ":
        joined = "\n".join("\t".join(row.split()) for row in rows)
    columns = [str(i) for i in range(len(form.names))]
    table = arrow.read_csv(
        pa.BufferReader(joined.encode()),
        arrow.ReadOptions(column_names=columns, use_threads=False),
        arrow.ParseOptions(delimiter="\t" if form.delimiter == " " else form.delimiter),
        arrow.ConvertOptions(
            column_types=dict.fromkeys(columns, pa.float64()),
            decimal_point=form.decimal,
            null_values=[*BLANKS, *NOT_A_NUMBER],
        ),
    )
    if table.num_rows != len(rows):
        raise ValueError("a cell contains a line end")
    return [table[c].to_numpy(zero_copy_only=False).astype(np.float64) for c in columns]


def _slow(
    path: Path, rows: list[str], numbers: Sequence[int], form: Form
) -> list[tuple[Floats, str] | str]:
    width = len(form.names)
    table = np.full((width, len(rows)), np.nan)
    tallies = [Tally() for _ in range(width)]
    for i, row in enumerate(rows):
        cells = cells_of(row, form.delimiter)
        if len(cells) != width:
            raise RecordingError(
                f"{path.name}: line {numbers[i]} has {len(cells)} cells where the table has"
                f" {width}; mend the line, or name delimiter and decimal in [csv]"
            )
        for j, cell in enumerate(cells):
            if cell in BLANKS:
                continue
            value = number_in(cell, form.decimal)
            if value is not None:
                table[j, i] = value
                tallies[j].numbers += 1
            else:
                tallies[j].text(cell, f"line {numbers[i]}")
    return [
        _text(tally, j + 1)
        if tally.is_text
        else (table[j], tally.note(form.names[j] or f"column{j + 1}", len(rows)))
        for j, tally in enumerate(tallies)
    ]


def _times(
    rows: list[str], form: Form, texts: Sequence[int]
) -> dict[int, tuple[NDArray[np.int64], NDArray[np.bool_]]]:
    """Return those columns of text that are times, a day beside a clock taken with it."""
    found: dict[int, tuple[NDArray[np.int64], NDArray[np.bool_]]] = {}
    if not texts:
        return found
    first = cells_of(rows[0], form.delimiter)
    table = [cells_of(row, form.delimiter) for row in rows]
    for j in texts:
        cells = [row[j].strip('"') for row in table]
        beside = next((i for i in (j - 1, j + 1) if i in texts and is_date(first[i])), None)
        if beside is not None:
            cells = [f"{row[beside]} {cell}" for row, cell in zip(table, cells, strict=True)]
        if (times := nanoseconds_of(cells)) is not None:
            found[j] = times
    return found


def _text(tally: Tally, column: int) -> str:
    more = "" if tally.texts == 1 else f"; {tally.texts - 1} below it are none either"
    return f"has {tally.first} in {tally.where}, column {column}, which is no number{more}"


def _about(path: Path, comments: list[str]) -> dict[str, Any]:
    line = next((line for line in islice(comments, 1) if line.startswith(ABOUT + "{")), None)
    if line is None:
        return {}
    try:
        about = json.loads(line.removeprefix(ABOUT))
    except (ValueError, RecursionError):
        raise RecordingError(
            f"{path.name}: the line of JSON at its head is damaged; describe the columns in a TOML"
        ) from None
    return about if isinstance(about, dict) else {}


def _kind(form: Form) -> str:
    named = {"\t": "tabs", " ": "blanks", ";": "semicolons", ",": "commas"}
    comma = ", decimal comma" if form.decimal == "," else ""
    return f"text table ({named.get(form.delimiter, repr(form.delimiter))}{comma})"

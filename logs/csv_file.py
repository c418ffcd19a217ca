"""Text tables of any tool: CSV, TSV and tables separated by blanks.

Lines that begin with #, % or // are comments. A blank cell is NaN, and so is a cell of text in a
column of numbers; the signal's note reports it with its line. A column of text does not affect the
others: it is reported as unreadable, with line and column of its first text.
"""

import json
from collections.abc import Iterable, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.logs.cells import BLANKS, NOT_A_NUMBER, Tally, brief, number_in
from zwidth.logs.csv_form import (
    MOST_COLUMNS,
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

ABOUT = "# zwidth "  # beginning of the line of JSON in a file that zwidth wrote
COMMENTS = ("#", "%", "//")
MOST_WORDS = 64  # most different words in a column that says what each row belongs to
TORN, SPOKEN = 0.01, 0.1  # largest shares of rows that are damaged, and that are words


def read_csv(path: Path, data: bytes, options: CsvOptions = NOTHING_SAID) -> Source:
    """Return the columns of a text table; raises RecordingError if it is not one."""
    text = decoded(path, data)
    notes: list[str] = []
    if options == NOTHING_SAID and (table := table_of(text)) is not None:
        text = table
        notes.append("each number stands beside its name, and other lines are left out")
    lines = _lines(text)
    about = _about(path, lines.comments)
    if about and len(lines.text) == 1:  # a log of zwidth without a sample
        empty = dict.fromkeys(lines.text[0].split(","), "is empty")
        return Source(path, "text table (commas)", {}, empty, about=about)
    if about:  # even if a column is called "nan"
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
    rows, numbers, note = _whole_rows(path, rows, numbers, form)
    notes += [note] if note else []
    columns = _columns(rows, numbers, form)
    signals: dict[str, Signal] = {}
    unreadable: dict[str, str] = {}
    texts = [j for j, column in enumerate(columns) if isinstance(column, str)]
    times = _times(rows, form, texts)
    words = {form.names[j]: _words(rows, form, j) for j in texts if j not in times}
    for j, (name, unit, column) in enumerate(zip(form.names, form.units, columns, strict=True)):
        if j in times:
            name = name or f"column{j + 1}"
            values, lost = times[j]
            signals[name] = Signal(name, values, "ns", lost=lost if lost.any() else None)
            continue
        if isinstance(column, str):
            if (lists := _lists(rows, form, j)) is None:
                unreadable[name] = column
                continue
            for k in range(lists.shape[1]):
                signals[f"{name}[{k}]"] = Signal(f"{name}[{k}]", lists[:, k], unit)
            continue
        values, note = column
        if name or not np.isnan(values).all():  # else only a delimiter at the end of every line
            name = name or f"column{len(signals) + 1}"
            signals[name] = Signal(name, values, unit, note=note)
    told = {name: column for name, column in words.items() if column is not None}
    return Source(path, _kind(form), signals, unreadable, tuple(notes), about, texts=told)


def decoded(path: Path, data: bytes) -> str:
    """Return the text: UTF-16 by its mark, UTF-8, or else the Windows code page."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        try:
            return data.decode("utf-16")
        except UnicodeDecodeError as error:
            raise RecordingError(f"{path.name} is not UTF-16 text: {error.reason}") from None
    if b"\0" in data:
        raise RecordingError(
            f"{path.name} is not in a format that can be read (MCAP, MAT, NPZ, NPY, Parquet, HDF5,"
            " text tables)"
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


def _columns(rows: list[str], numbers: Sequence[int], form: Form) -> list[tuple[Floats, str] | str]:
    """Return each column as float64 with its note, or a sentence on why it is text."""
    try:
        return [(column, "") for column in _fast(rows, form)]
    except ValueError:  # text, a ragged line, a plus sign: the slow parser reads or reports it
        return _slow(rows, numbers, form)


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
        raise ValueError("a cell contains a line break")
    return [_doubles(table[c].chunks) for c in columns]


def _doubles(chunks: Iterable[Any]) -> Floats:
    """Return a column of Arrow's, NaN where it is blank.

    Arrow's own `to_numpy` imports pandas, where that is installed, which takes longer than to read.
    """
    parts: list[Floats] = []
    for chunk in (c for c in chunks if len(c)):
        known, values = chunk.buffers()
        found = np.frombuffer(values, np.float64, len(chunk), 8 * chunk.offset).copy()
        if known is not None:
            bits = np.unpackbits(np.frombuffer(known, np.uint8), bitorder="little")
            found[bits[chunk.offset : chunk.offset + len(chunk)] == 0] = np.nan
        parts.append(found)
    return np.concatenate(parts)


def _slow(rows: list[str], numbers: Sequence[int], form: Form) -> list[tuple[Floats, str] | str]:
    width = len(form.names)
    table = np.full((width, len(rows)), np.nan)
    tallies = [Tally() for _ in range(width)]
    for i, row in enumerate(rows):
        for j, cell in enumerate(cells_of(row, form.delimiter)):
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


def _words(rows: list[str], form: Form, column: int) -> NDArray[np.str_] | None:
    """Return a column of few different words, (rows,), None for any other."""
    found = [cells_of(row, form.delimiter)[column].strip('"') for row in rows]
    return np.array(found) if 2 <= len(set(found)) <= MOST_WORDS else None


def _lists(rows: list[str], form: Form, column: int) -> Floats | None:
    """Return the numbers of cells that are lists of equal length, (rows, length); None for others.

    "[0.1, 0.2]" as pandas writes a list, "[0.1 0.2]" as it writes an array.
    """
    found: list[list[float]] = []
    for row in rows:
        cell = cells_of(row, form.delimiter)[column].strip('"')
        if not (cell.startswith("[") and cell.endswith("]")):
            return None
        numbers = [number_in(part, ".") for part in cell[1:-1].replace(",", " ").split()]
        if None in numbers or not 0 < len(numbers) <= MOST_COLUMNS:
            return None
        found.append([number for number in numbers if number is not None])
        if len(found[-1]) != len(found[0]):
            return None
    return np.array(found, dtype=np.float64)


def _whole_rows(
    path: Path, rows: list[str], numbers: Sequence[int], form: Form
) -> tuple[list[str], Sequence[int], str]:
    """Return the rows that have a cell for each column, and a note on the other rows.

    Words of a board between its rows are left out, and of rows that a serial line spoiled a few.
    Raises RecordingError if more are spoiled.
    """
    if form.delimiter != " " and all(
        row.count(form.delimiter) == len(form.names) - 1 for row in rows
    ):
        return rows, numbers, ""
    cells = [cells_of(row, form.delimiter) for row in rows]
    torn = [i for i, row in enumerate(cells) if len(row) != len(form.names)]
    if not torn:
        return rows, numbers, ""
    counted = [i for i in torn if any(number_in(c, form.decimal) is not None for c in cells[i])]
    if len(counted) > TORN * len(rows) or len(torn) > SPOKEN * len(rows):
        i = (counted or torn)[0]
        raise RecordingError(
            f"{path.name}: line {numbers[i]} has {len(cells[i])} cells but the table has"
            f" {len(form.names)}; correct the line, or give delimiter and decimal in [csv]"
        )
    left = set(torn)
    kept = [i for i in range(len(rows)) if i not in left]
    few = "1 line is not a row" if len(torn) == 1 else f"{len(torn)} lines are not rows"
    note = f"{few} of the table and left out, first line {numbers[torn[0]]}, {brief(rows[torn[0]])}"
    return [rows[i] for i in kept], [numbers[i] for i in kept], note


def _text(tally: Tally, column: int) -> str:
    more = "" if tally.texts == 1 else f"; {tally.texts - 1} below it are not numbers either"
    return f"has {tally.first} in {tally.where}, column {column}, which is not a number{more}"


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

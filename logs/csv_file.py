"""Text tables: CSV, TSV and columns of blanks, by whatever tool they were written.

The delimiter and the decimal mark are those with which most cells of a run of lines are numbers.
The line before the first number names the columns, with units in brackets behind the names or on a
line of their own; lines that begin with #, % or // are comments. A blank cell is NaN. A text cell
does not spoil the other columns: its own is reported as unreadable, with line and column.

What cannot be found out can be said, in the table [csv] of a recording TOML: delimiter, decimal,
header_line (the line that names the columns, counted from 1; 0 where none does).
"""

import csv
import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from logs.source import Floats, RecordingError, Signal, Source
from logs.units import find_unit

ABOUT = "# zwidth "  # begins the line of JSON in a file of our own
COMMENTS = ("#", "%", "//")
BLANKS = ("", "NA", "N/A", "n/a", "null", "NULL", "None", "-", "--")
NOT_A_NUMBER = ("nan", "NaN", "NAN", "-nan", "-NaN", "nan(ind)", "-nan(ind)", "1.#QNAN", "#N/A")
DIALECTS = [
    *((delimiter, decimal) for decimal in ".," for delimiter in "\t;,"),
    *((" ", decimal) for decimal in ".,"),
]
SNIFFED = 200  # lines from which the dialect is found out
MOST_COLUMNS = 10_000
BEGINS_A_NUMBER = re.compile(r"[+-]?[.,]?\d")
NAME_AND_UNIT = re.compile(r"(?P<name>.*\S)\s*[\[(](?P<unit>[^\[\]()]*)[\])]$")


@dataclass(frozen=True)
class CsvOptions:
    """What the recording TOML says about a text table; None where it says nothing."""

    delimiter: str | None = None
    decimal: str | None = None
    header_line: int | None = None


NOTHING_SAID = CsvOptions()


@dataclass(frozen=True)
class Lines:
    """The lines that are neither blank nor comments, and where each stands in the file, from 1."""

    text: list[str]
    numbers: Sequence[int]
    comments: list[str]


class Run(NamedTuple):
    """Lines that follow each other, of `width` cells each, with a number in every one of them.

    weight: cells that are numbers, times their share; times three where the line above names them,
    which outweighs that a comma taken for a delimiter makes two numbers of one.
    """

    weight: float
    width: int


@dataclass(frozen=True)
class Form:
    """How the table is laid out; first: index of the first line of data."""

    delimiter: str
    decimal: str
    names: list[str]
    units: list[str]
    first: int


def read_csv(path: Path, data: bytes, options: CsvOptions = NOTHING_SAID) -> Source:
    """Return the columns of a text table; raises RecordingError where it is none."""
    text = _decode(path, data)
    notes: list[str] = []
    lines = _lines(text)
    about = _about(path, lines.comments)
    if about and len(lines.text) == 1:  # a log of ours without a sample
        empty = dict.fromkeys(lines.text[0].split(","), "is empty")
        return Source(path, "text table (commas)", {}, empty, about=about)
    form = _form(path, lines, CsvOptions(",", ".", options.header_line) if about else options)
    rows, numbers = lines.text[form.first :], lines.numbers[form.first :]
    if rows and len(_cells(rows[-1], form.delimiter)) < len(form.names):
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
    for name, unit, column in zip(form.names, form.units, columns, strict=True):
        if isinstance(column, str):
            unreadable[name] = column
        elif name or not np.isnan(column).all():  # a delimiter at the end of every line names none
            signals[name or f"column{len(signals) + 1}"] = Signal(name, column, unit)
    return Source(path, _kind(form), signals, unreadable, tuple(notes), about)


def _decode(path: Path, data: bytes) -> str:
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


def _form(path: Path, lines: Lines, options: CsvOptions) -> Form:
    dialects = [
        (delimiter, decimal)
        for delimiter, decimal in DIALECTS
        if options.delimiter in (None, delimiter) and options.decimal in (None, decimal)
    ] or [(options.delimiter or ",", options.decimal or ".")]
    sample = lines.text[:SNIFFED]
    runs = [_best_run(sample, *dialect) for dialect in dialects]
    best = max(range(len(runs)), key=lambda i: runs[i])
    if runs[best].width == 0:
        raise RecordingError(
            f"{path.name} has no line of numbers among its first {len(sample)}; if it is a table,"
            " say delimiter, decimal and header_line in [csv]"
        )
    delimiter, decimal = dialects[best]
    width = runs[best].width
    if width > MOST_COLUMNS:
        raise RecordingError(f"{path.name} has {width} columns; at most {MOST_COLUMNS} are read")
    first = _first_data(lines, options.header_line, sample, (delimiter, decimal), width)
    header = [] if options.header_line == 0 else _header(lines, first, delimiter, width)
    names, units = _names(header, width)
    return Form(delimiter, decimal, names, units, first)


def _best_run(sample: list[str], delimiter: str, decimal: str) -> Run:
    """Return the run that speaks most for a dialect."""
    best, above = Run(0.0, 0), list[str]()
    named, numbers, filled = False, 0, 0
    for line in sample:
        cells = _cells(line, delimiter)
        spoken = [cell for cell in cells if cell not in BLANKS]
        count = sum(_is_number(cell, decimal) for cell in spoken)
        if not numbers or not count or len(cells) != len(above):
            numbers = filled = 0
            named = len(cells) == len(above) and not any(BEGINS_A_NUMBER.match(c) for c in above)
        numbers, filled, above = numbers + count if count else 0, filled + len(spoken), cells
        if numbers:
            best = max(best, Run(numbers * numbers / filled * (3 if named else 1), len(cells)))
    return best


def _first_data(
    lines: Lines, header_line: int | None, sample: list[str], dialect: tuple[str, str], width: int
) -> int:
    """Return the index of the first line of the table's width with a number in it.

    A line of text and numbers is data with a stray cell, not a header: nothing is lost in silence.
    """
    if header_line is not None:
        return int(np.searchsorted(np.asarray(lines.numbers), header_line, "right"))
    for i, line in enumerate(sample):
        cells = _cells(line, dialect[0])
        if len(cells) == width and any(_is_number(cell, dialect[1]) for cell in cells):
            return i
    raise AssertionError("a run of numbers was found, so there is a first line of them")


def _header(lines: Lines, first: int, delimiter: str, width: int) -> list[list[str]]:
    """Return the rows of cells that name the columns: none, names, or names and units."""
    above = [_cells(line, delimiter) for line in lines.text[max(0, first - 2) : first]]
    open_ended = first < len(lines.text) and lines.text[first].rstrip().endswith(delimiter)
    rows = [c for c in above if len(c) == width or (open_ended and len(c) == width - 1)]
    if not rows and lines.comments:  # numpy.savetxt writes names as a comment
        spoken = lines.comments[-1].lstrip("#%/ ")
        cells = _cells(spoken, delimiter if delimiter in spoken else " ")
        return [cells] if len(cells) == width and not spoken.startswith("zwidth {") else []
    if len(rows) == 2 and not all(cell == "" or _unit_of(cell) for cell in rows[1]):
        return rows[1:]
    return rows


def _names(header: list[list[str]], width: int) -> tuple[list[str], list[str]]:
    """Return the names, each once, and the units of the columns."""
    if not header:
        return [f"column{i}" for i in range(1, width + 1)], [""] * width
    padded = [[*cells, *[""] * (width - len(cells))] for cells in header]
    names, units = list(padded[0]), [""] * width
    for i, name in enumerate(names):
        matched = NAME_AND_UNIT.match(name)
        if matched:
            names[i], units[i] = matched["name"], matched["unit"].strip()
        elif len(padded) == 2:
            units[i] = padded[1][i].strip("[]() ")
    for i, name in enumerate(names):
        if name and name in names[:i]:
            names[i] = f"{name} (column {i + 1})"
    return names, units


def _unit_of(cell: str) -> bool:
    return (cell[0] in "[(" and cell[-1] in ")]") or find_unit(cell) is not None


def _cells(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    if '"' in line:
        try:
            return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]
        except (csv.Error, StopIteration):
            return [line]
    return [cell.strip() for cell in line.split(delimiter)]


def _is_number(cell: str, decimal: str) -> bool:
    return _number(cell, decimal) is not None


def _number(cell: str, decimal: str) -> float | None:
    if cell in NOT_A_NUMBER:
        return np.nan
    if "_" in cell or (decimal == "," and "." in cell):
        return None
    try:
        return float(cell.replace(",", ".") if decimal == "," else cell)
    except ValueError:
        return None


def _columns(path: Path, rows: list[str], numbers: Sequence[int], form: Form) -> list[Floats | str]:
    """Return each column as float64, or the sentence that says which cell is no number."""
    try:
        return list(_fast(rows, form))
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


def _slow(path: Path, rows: list[str], numbers: Sequence[int], form: Form) -> list[Floats | str]:
    width = len(form.names)
    table = np.full((width, len(rows)), np.nan)
    wrong: dict[int, str] = {}
    for i, row in enumerate(rows):
        cells = _cells(row, form.delimiter)
        if len(cells) != width:
            raise RecordingError(
                f"{path.name}: line {numbers[i]} has {len(cells)} cells where the table has"
                f" {width}; mend the line, or name delimiter and decimal in [csv]"
            )
        for j, cell in enumerate(cells):
            if cell in BLANKS:
                continue
            value = _number(cell, form.decimal)
            if value is not None:
                table[j, i] = value
            else:
                where = f"line {numbers[i]}, column {j + 1}"
                wrong.setdefault(j, f"has {_brief(cell)} in {where}, which is no number")
    return [wrong[j] if j in wrong else table[j] for j in range(width)]


def _brief(cell: str) -> str:
    return repr(cell if len(cell) <= 24 else cell[:21] + "...")


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

"""The layout of a text table, detected from its first lines.

The delimiter and decimal mark are those with which most cells of consecutive lines are numbers. The
line before the first number names the columns, with units in brackets behind the names or on a line
of their own. What cannot be detected can be stated in the table [csv] of a recording TOML.
"""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from zwidth.logs.cells import BLANKS, number_in
from zwidth.logs.source import RecordingError
from zwidth.logs.units import find_unit

DIALECTS = [
    *((delimiter, decimal) for decimal in ".," for delimiter in "\t;,"),
    *((" ", decimal) for decimal in ".,"),
]
SNIFFED = 200  # lines from which the dialect is detected
MOST_COLUMNS = 10_000
BEGINS_A_NUMBER = re.compile(r"[+-]?[.,]?\d")
NAME_AND_UNIT = re.compile(r"(?P<name>.*\S)\s*[\[(](?P<unit>[^\[\]()]*)[\])]$")


OBJECT = re.compile(r"(?:0x)?\d[0-9A-Fa-f]{3}h?(?::\w{1,4})?h?$")
"""The index of an object of a CANopen or EtherCAT drive, "Position actual value (6064h)"."""


@dataclass(frozen=True)
class CsvOptions:
    """The settings of a text table in the recording TOML; None if it has none."""

    delimiter: str | None = None
    decimal: str | None = None
    header_line: int | None = None


NOTHING_SAID = CsvOptions()


@dataclass(frozen=True)
class Lines:
    """The lines that are neither blank nor comments, and their line numbers in the file, from 1."""

    text: list[str]
    numbers: Sequence[int]
    comments: list[str]


class Run(NamedTuple):
    """Consecutive lines of `width` cells, each with at least one number.

    weight: cells that are numbers, times their share; times three if the line above names them. The
    factor outweighs the doubled count of numbers if a decimal comma is read as a delimiter.
    """

    weight: float
    width: int


@dataclass(frozen=True)
class Form:
    """The layout of a table.

    first: index of the first line of data. left_out: numbers of the lines above that are neither
    names nor units.
    """

    delimiter: str
    decimal: str
    names: list[str]
    units: list[str]
    first: int
    left_out: list[int]


def find_form(path: Path, lines: Lines, options: CsvOptions) -> Form:
    """Return the layout of a table; raises RecordingError if none is recognised."""
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
            " give delimiter, decimal and header_line in [csv]"
        )
    delimiter, decimal = dialects[best]
    width = runs[best].width
    if width > MOST_COLUMNS:
        raise RecordingError(f"{path.name} has {width} columns; at most {MOST_COLUMNS} are read")
    first = _first_data(lines, options.header_line, sample, (delimiter, decimal), width)
    header = [] if options.header_line == 0 else _header(lines, first, delimiter, width)
    names, units = _names([cells for _, cells in header] or _spoken(lines, delimiter, width), width)
    named = {index for index, _ in header}
    left_out = [number for i, number in enumerate(lines.numbers[:first]) if i not in named]
    return Form(delimiter, decimal, names, units, first, left_out)


def _best_run(sample: list[str], delimiter: str, decimal: str) -> Run:
    """Return the run that speaks most for a dialect."""
    best, above = Run(0.0, 0), list[str]()
    named, numbers, filled = False, 0, 0
    for line in sample:
        cells = cells_of(line, delimiter)
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

    A line of text and numbers is data with a stray cell, not a header, so that nothing is lost
    silently.
    """
    if header_line is not None:
        return int(np.searchsorted(np.asarray(lines.numbers), header_line, "right"))
    for i, line in enumerate(sample):
        cells = cells_of(line, dialect[0])
        if len(cells) == width and any(_is_number(cell, dialect[1]) for cell in cells):
            return i
    raise AssertionError("a run of numbers was found, so there is a first line of them")


def _header(lines: Lines, first: int, delimiter: str, width: int) -> list[tuple[int, list[str]]]:
    """Return index and cells of the lines of names: none, names, or names and units."""
    above = [(i, cells_of(lines.text[i], delimiter)) for i in range(max(0, first - 2), first)]
    open_ended = first < len(lines.text) and lines.text[first].rstrip().endswith(delimiter)
    rows = [(i, c) for i, c in above if len(c) == width or (open_ended and len(c) == width - 1)]
    if len(rows) == 2 and not _are_units(rows[0][1], rows[1][1]):
        return rows if _is_of_groups(rows[0][1], rows[1][1]) else rows[1:]
    return rows


def _are_units(names: Sequence[str], cells: Sequence[str]) -> bool:
    """Return whether a line has the units of the names above it, some of which may be unknown."""
    spoken = [cell for cell in cells if cell]
    known = sum(map(_unit_of, spoken))
    full = all(names) and len(set(names)) == len(names) and not any(map(_unit_of, names))
    return known == len(spoken) or (full and 2 * known > len(spoken))


def _is_of_groups(upper: Sequence[str], lower: Sequence[str]) -> bool:
    """Return whether there are two lines of names, such as joint1 over pos and vel.

    A group may be named once, over its first column.
    """
    spoken = [cell for cell in lower if cell]
    return len(set(spoken)) < len(spoken) and len({cell for cell in upper if cell}) > 1


def _grouped(upper: Sequence[str], lower: Sequence[str]) -> list[str]:
    names: list[str] = []
    group = ""
    for above, cell in zip(upper, lower, strict=True):
        group = above or group
        names.append(f"{group} {cell}".strip() if cell else group)
    return names


def _spoken(lines: Lines, delimiter: str, width: int) -> list[list[str]]:
    """Return the names in the last comment, where numpy.savetxt writes them."""
    comment = lines.comments[-1].lstrip("#%/ ") if lines.comments else ""
    cells = cells_of(comment, delimiter if delimiter in comment else " ")
    return [cells] if len(cells) == width and not comment.startswith("zwidth {") else []


def _names(header: list[list[str]], width: int) -> tuple[list[str], list[str]]:
    """Return the names, each once, and the units of the columns."""
    if not header:
        return [f"column{i}" for i in range(1, width + 1)], [""] * width
    padded = [[*cells, *[""] * (width - len(cells))] for cells in header]
    if len(padded) == 2 and _is_of_groups(*padded):
        padded = [_grouped(*padded)]
    names, units = list(padded[0]), [""] * width
    for i, name in enumerate(names):
        matched = NAME_AND_UNIT.match(name)
        if matched and not matched["unit"].strip().isdigit():  # "pos (1)": a motor
            unit = matched["unit"].strip()
            names[i], units[i] = matched["name"], "" if OBJECT.match(unit) else unit
        elif len(padded) == 2:
            units[i] = padded[1][i].strip("[]() ")
    for i, name in enumerate(names):
        if name and name in names[:i]:
            names[i] = f"{name} (column {i + 1})"
    return names, units


def _unit_of(cell: str) -> bool:
    return (cell[0] in "[(" and cell[-1] in ")]") or find_unit(cell) is not None


def cells_of(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line without the blanks around them."""
    if delimiter == " ":
        return line.split()
    if '"' in line:
        try:
            return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]
        except (csv.Error, StopIteration):
            return [line]
    return [cell.strip() for cell in line.split(delimiter)]


def _is_number(cell: str, decimal: str) -> bool:
    return number_in(cell, decimal) is not None

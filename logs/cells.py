"""Cells of text: which are numbers, which are blank, and which columns of them are signals.

A column in which numbers outnumber text is a signal with gaps: each cell of text becomes NaN, is
counted, and the first is quoted. A gap loses only its sample, since nothing is computed across it,
so stray text does not make a column useless; even if nearly half of a column is text, the numbers
in between may be complete stretches. A column with at least as many texts as numbers is a column of
words, some of which are digits. Blank cells do not count.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

BLANKS = ("", "NA", "N/A", "n/a", "null", "NULL", "None", "-", "--")
NOT_A_NUMBER = ("nan", "NaN", "NAN", "-nan", "-NaN", "nan(ind)", "-nan(ind)", "1.#QNAN", "#N/A")
LONGEST_QUOTED = 24


@dataclass
class Tally:
    """How many cells of a column are numbers, how many are text, and the first text.

    where: the place of the first text, in words.
    """

    numbers: int = 0
    texts: int = 0
    first: str = ""
    where: str = ""

    def text(self, cell: str, where: str) -> None:
        """Count a cell of text."""
        if not self.texts:
            self.first, self.where = brief(cell), where
        self.texts += 1

    @property
    def is_text(self) -> bool:
        """True if there are at least as many texts as numbers."""
        return self.texts >= max(self.numbers, 1)

    def note(self, name: str, cells: int) -> str:
        """Return the sentence on texts among the cells of a column of numbers, "" for none."""
        if not self.texts:
            return ""
        few = "1 cell" if self.texts == 1 else f"{self.texts} cells"
        are, gaps = ("is", "a gap") if self.texts == 1 else ("are", "gaps")
        return (
            f"{few} of {cells} in column {name!r} {are} no number, first {self.first} in"
            f" {self.where}; taken as {gaps}"
        )


def column_of(name: str, cells: Iterable[object]) -> tuple[Floats, str] | None:
    """Return a column of texts and numbers as float64, and its note; None if it is text.

    A blank cell, or None, is NaN.
    """
    values: list[float] = []
    tally = Tally()
    for k, cell in enumerate(cells):
        number = math.nan
        if isinstance(cell, str):
            spoken = cell.strip()
            found = None if spoken in BLANKS else number_in(spoken, ".")
            if found is not None:
                number = found
                tally.numbers += 1
            elif spoken not in BLANKS:
                tally.text(spoken, f"sample {k}")
        elif isinstance(cell, bool | int | float | np.number | np.bool_):
            number = float(cell)
            tally.numbers += 1
        values.append(number)
    if tally.is_text or not tally.numbers:
        return None
    return np.array(values, dtype=np.float64), tally.note(name, len(values))


def number_in(cell: str, decimal: str) -> float | None:
    """Return the number in a cell, NaN for a cell that means NaN, or None."""
    if cell in NOT_A_NUMBER:
        return math.nan
    if "_" in cell or (decimal == "," and "." in cell):
        return None
    try:
        return float(cell.replace(",", ".") if decimal == "," else cell)
    except ValueError:
        return None


def brief(cell: str) -> str:
    """Return a cell in quotes, shortened."""
    return repr(cell if len(cell) <= LONGEST_QUOTED else cell[: LONGEST_QUOTED - 3] + "...")

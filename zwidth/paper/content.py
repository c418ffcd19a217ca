"""The parts of a section of the report: words, pictures, tables."""

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure


@dataclass(frozen=True)
class Picture:
    """A figure with its caption; name: of its files; command: computes its numbers again."""

    name: str
    figure: Figure
    caption: str
    command: str


@dataclass(frozen=True)
class Table:
    """A table with its caption; rows of text, one cell per column; numeric columns align right."""

    caption: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    command: str
    text_columns: Sequence[int] = (0,)


Part = str | Picture | Table


@dataclass(frozen=True)
class Section:
    """A section of the report: title and, in order, paragraphs, pictures and tables."""

    title: str
    parts: tuple[Part, ...]


def number(value: float | None, digits: int = 4) -> str:
    """Return a number with some significant digits, "none" for None."""
    return "none" if value is None else f"{value:.{digits}g}"

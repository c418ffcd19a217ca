"""A result as a table: a few lines in a terminal, HTML in a notebook."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from textwrap import shorten, wrap
from typing import Literal

from zwidth.console import APART, fitted

WIDTH, LINES = 100, 12  # width and lines of the text
SENTENCES = 4  # most lines for sentences
ROWS = 60  # most rows of the HTML
CELL = "padding: 0.15em 0.8em; text-align: {}"
NONE = "-"
MORE = " \u2026"  # replaces text that does not fit
Side = Literal["left", "right"]


@dataclass(frozen=True)
class Table:
    """A title, sentences about the whole, headings with their units, rows of text."""

    title: str
    said: Sequence[str] = ()
    headings: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = ()


def number(value: float | None) -> str:
    """Return four significant digits, a dash for unknown values."""
    return NONE if value is None or math.isnan(value) else f"{value:.4g}"


def as_text(table: Table) -> str:
    """Return at most 12 lines of at most 100 columns; omitted rows are counted."""
    lines = [shorten(table.title, WIDTH, placeholder=" ...")]
    said = [line for one in table.said for line in wrap(one, WIDTH)]
    lines += said[:SENTENCES]
    if len(said) > SENTENCES:
        lines[-1] = f"{lines[-1][: WIDTH - 4]} ..."
    room = LINES - len(lines) - 1  # without the line of headings
    if table.rows:
        fits = len(table.rows) <= room
        shown = table.rows if fits else table.rows[: room - 1]
        lines += _ruled(table.headings, shown)
        if not fits:
            lines.append(f"... and {len(table.rows) - len(shown)} more")
    return "\n".join(lines)


def as_html(table: Table) -> str:
    """Return the table as self-contained HTML, with at most 60 rows."""
    parts = [f"<p><b>{escape(table.title)}</b></p>"]
    parts += [f"<p>{escape(one)}</p>" for one in table.said]
    if table.rows:
        sides = _sides(table.rows)
        head = _row("th", table.headings, sides)
        body = "".join(_row("td", row, sides) for row in table.rows[:ROWS])
        parts.append(f"<table><thead>{head}</thead><tbody>{body}</tbody></table>")
    if len(table.rows) > ROWS:
        parts.append(f"<p>... and {len(table.rows) - ROWS} more</p>")
    return f"<div>{''.join(parts)}</div>"


def _row(kind: str, cells: Sequence[str], sides: Sequence[Side]) -> str:
    every = (
        f'<{kind} style="{CELL.format(side)}">{escape(cell)}</{kind}>'
        for cell, side in zip(cells, sides, strict=True)
    )
    return f"<tr>{''.join(every)}</tr>"


def _sides(rows: Sequence[Sequence[str]]) -> list[Side]:
    """Columns of numbers stand to the right, so that their digits line up."""
    return ["right" if all(map(_numeric, column)) else "left" for column in zip(*rows, strict=True)]


def _numeric(cell: str) -> bool:
    return cell == NONE or cell.lstrip("+-")[:1].isdigit()


def _ruled(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return a line of headings and one per row; what is too long is cut between two words."""
    columns = list(zip(headings, *rows, strict=True))
    widest = [max(map(len, column)) for column in columns]
    widths = fitted(widest, [1] * len(columns), WIDTH - APART * (len(columns) - 1))
    sides = _sides(rows)
    lines: list[str] = []
    for row in (headings, *rows):
        cells = [cut(cell, width) for cell, width in zip(row, widths, strict=True)]
        beside = zip(cells, widths, sides, strict=True)
        line = (c.rjust(width) if s == "right" else c.ljust(width) for c, width, s in beside)
        lines.append((" " * APART).join(line).rstrip())
    return lines


def cut(cell: str, width: int) -> str:
    """Return the words of a cell that fit, and an ellipsis for those that do not."""
    if len(cell) <= width:
        return cell
    if " " in cell and width > len(MORE):
        return shorten(cell, width, placeholder=MORE)
    return cell[: width - 1] + MORE.strip()

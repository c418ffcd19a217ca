"""The output of commands: tables for people, JSON for programs, progress."""

import math
import re
import shutil
import sys
import textwrap
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from zwidth.errors import one_line
from zwidth.files.protection import check
from zwidth.files.whole import json_text, write_text
from zwidth.heartbeat import HEART

PLAIN_LINE_EVERY = 3.0  # [s] between lines of progress without a terminal
PLAIN_WIDTH = 160  # columns, without a terminal
APART = 2  # spaces between columns of a table
LONGEST_NAME = 34  # characters of a name that stays on one line in a table
GLUE = "\ue000"  # replaces spaces within units while text is wrapped
UNIT = re.compile(
    r"(?:(?<![\w.])[-+\u00b1]?\d[\d.]*(?:e-?\d+)? )?"
    r"(?<!\w)(?:[n\u00b5mkM]?(?:N|V|A|J|W)|k?g|m?rad|[n\u00b5mk]?m|[n\u00b5m]?s|k?Hz|counts|%)"
    r"(?: (?:m2?|s2?))*(?:/(?:rad|m|s|count)\d?)*(?: (?:m2?|s2?))*(?![\w])"
)

Advance = Callable[..., None]


@dataclass(frozen=True)
class Column:
    """A column of a table; numbers align right, so that their digits line up."""

    heading: str
    number: bool = True


@dataclass(frozen=True)
class Console:
    """The destinations of a command's output.

    json: None for no JSON, "-" for standard output, else a file. If JSON goes to standard output,
    text for people goes to standard error.
    """

    json: str | None = None

    @property
    def stream(self) -> TextIO:
        """The stream that people read."""
        return sys.stderr if self.json == "-" else sys.stdout

    def say(self, text: str = "") -> None:
        """Write a line for people; on a terminal it is wrapped at words."""
        HEART.said()
        print(wrapped(text, self.stream), file=self.stream)

    def show(self, text: str) -> None:
        """Write text unchanged, such as a file to be copied."""
        HEART.said()
        print(text, file=self.stream)

    def doing(self, text: str, at: float | None = None) -> None:
        """Write the current step to standard error, as `progress` does.

        at: the time since the beginning [s], written in front.
        """
        HEART.said(text)
        head = "... " if at is None else f"... {at:4.0f} s  "
        line = hanging(head, text) if sys.stderr.isatty() else f"{head}{text}"
        print(line, file=sys.stderr)

    def note(self, text: str) -> None:
        """Write a line for people to standard error, for instance an assumption."""
        HEART.said()
        print(wrapped(text, sys.stderr), file=sys.stderr)

    def warn(self, text: str) -> None:
        """Write one line that begins with ``warning:`` to standard error."""
        HEART.said()
        print(wrapped(f"warning: {one_line(text)}", sys.stderr), file=sys.stderr)

    def table(self, title: str, columns: Sequence[Column], rows: Sequence[Sequence[str]]) -> None:
        """Write a table: ruled on a terminal, plain columns elsewhere.

        Empty columns are left out. If a terminal is too narrow, cells wrap at words, never inside
        one; names, the first column, stay whole. If not even the longest words fit side by side,
        each row becomes a table of its own, with a line for each column.
        """
        from rich.box import SIMPLE_HEAD
        from rich.console import Console as Terminal
        from rich.table import Table

        terminal = self.stream.isatty()
        columns = [Column(glued(c.heading), c.number) for c in columns]
        rows = [[glued(cell) for cell in row] for row in rows]
        used = [i for i in range(len(columns)) if not rows or any(row[i] for row in rows)]
        every = [[columns[i].heading, *(row[i] for row in rows)] for i in used]
        room = shutil.get_terminal_size().columns if terminal else PLAIN_WIDTH
        least = narrowest(every)
        if terminal and sum(least) + APART * len(used) > room:
            self.say(title)
            for row in rows:
                self.say("")
                wide = max(len(columns[i].heading) for i in used) + 2
                for i in (i for i in used if row[i]):
                    self.show(hanging(columns[i].heading.ljust(wide), row[i]).replace(GLUE, " "))
            return
        widest = [max(map(len, cells), default=0) for cells in every]
        widths = fitted(widest, least, room - APART * len(used))
        box, padding = (SIMPLE_HEAD, (0, 0, 0, 1)) if terminal else (None, (0, 1))  # both two wide
        table = Table(box=box, padding=padding, pad_edge=False)
        for i, width in zip(used, widths, strict=True):
            justify = "right" if columns[i].number else "left"
            table.add_column(columns[i].heading, justify=justify, overflow="fold", width=width)
        for row in rows:
            table.add_row(*(row[i] for i in used))
        writer = Terminal(
            file=self.stream,
            width=max(room, sum(widths) + APART * len(used)),  # else cells would be cut off
            markup=False,
            emoji=False,
            highlight=False,
        )
        self.say(title)
        with writer.capture() as drawn:
            writer.print(table)
        print(drawn.get().replace(GLUE, " "), end="", file=self.stream)

    def will_write(self, *files: Path) -> None:
        """Refuse, before any work is done, if these files or the JSON may not be written.

        Called after the inputs are read, with every result whose name is already known. Raises
        Protected.
        """
        asked = [] if self.json in (None, "-") else [Path(self.json)]
        check(*files, *asked)

    def keep(self, value: Any) -> None:
        """Write an unfinished result to its file, silently; raises as `result`."""
        if self.json is None or self.json == "-":
            return
        path = Path(self.json)
        if path.is_file() or not path.exists():  # a pipe gets only one result
            write_text(path, json_text(value))

    def result(self, value: Any) -> None:
        """Write the result as JSON if requested; raises OSError, ValueError for NaN."""
        if self.json == "-":
            sys.stdout.write(json_text(value))
        elif self.json is not None:
            self.say(f"wrote {write_text(Path(self.json), json_text(value))}")


def wrapped(text: str, stream: TextIO) -> str:
    """Return text wrapped between words to the width of the terminal.

    Paths and other long words stay whole, and indented lines are unchanged. Without a terminal all
    text is unchanged.
    """
    if not stream.isatty():
        return text
    width = shutil.get_terminal_size().columns
    wrapper = textwrap.TextWrapper(width, break_long_words=False, break_on_hyphens=False)
    lines = glued(text).split("\n")
    fitted = "\n".join(line if line.startswith(" ") else wrapper.fill(line) for line in lines)
    return fitted.replace(GLUE, " ")


def glued(text: str) -> str:
    """Return text in which wrapping does not separate units from numbers or split them."""
    return UNIT.sub(lambda found: found[0].replace(" ", GLUE), text)


def hanging(head: str, text: str) -> str:
    """Return a head with text beside it, wrapped at words to the terminal's width."""
    width = shutil.get_terminal_size().columns
    return textwrap.fill(
        glued(text), width, initial_indent=head, subsequent_indent=" " * len(head),
        break_long_words=False, break_on_hyphens=False,
    ).replace(GLUE, " ")  # fmt: skip


def narrowest(columns: Sequence[Sequence[str]]) -> list[int]:
    """Return the least width of each column: whole names in the first, longest words elsewhere.

    columns: the heading of each, and its cells.
    """
    widths: list[int] = []
    for i, cells in enumerate(columns):
        whole = i == 0 and all(len(cell) <= LONGEST_NAME for cell in cells[1:])
        names = cells[1:] if whole else []
        words = [word for cell in (cells[:1] if whole else cells) for word in cell.split()]
        widths.append(max(map(len, (*names, *words)), default=0))
    return widths


def fitted(widest: Sequence[int], least: Sequence[int], room: int) -> list[int]:
    """Return widths of columns that fit into the room: the widest shrink first.

    No column gets narrower than `least`, so the sum is larger than `room` if that of `least` is.
    """
    widths = list(widest)
    while sum(widths) > room:
        wide = max((w for w, low in zip(widths, least, strict=True) if w > low), default=0)
        if wide == 0:
            break
        i = next(i for i, w in enumerate(widths) if w == wide and w > least[i])
        widths[i] -= 1
    return widths


@contextmanager
def progress(doing: str, total: int) -> Generator[Advance]:
    """Show the progress of long work on standard error.

    Yields ``advance(steps=1, now="")``; `now` describes the current step. A terminal gets a bar
    with the remaining time, anything else a plain line every few seconds.
    """
    show = _bar if sys.stderr.isatty() else _lines
    HEART.begins(doing)
    with show(doing, total) as advance:
        yield advance
    HEART.begins("finishing")


@contextmanager
def _bar(doing: str, total: int) -> Generator[Advance]:
    from rich.console import Console as Terminal
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
    from rich.progress import TimeRemainingColumn as TimeLeft

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeLeft(),
        TextColumn("{task.fields[now]}", markup=False),
    )
    with HEART.held(), Progress(*columns, console=Terminal(stderr=True), transient=True) as bar:
        task = bar.add_task(doing, total=total, now="")

        def advance(steps: int = 1, now: str = "") -> None:
            bar.update(task, advance=steps, now=now)

        yield advance


@contextmanager
def _lines(doing: str, total: int) -> Generator[Advance]:
    done = 0
    due = time.monotonic() + PLAIN_LINE_EVERY

    def advance(steps: int = 1, now: str = "") -> None:
        nonlocal done, due
        done += steps
        if time.monotonic() >= due:
            due = time.monotonic() + PLAIN_LINE_EVERY
            line = f"{doing}: {done} of {total} {now}".rstrip()
            HEART.said(line)
            print(line, file=sys.stderr)

    yield advance


def json_number(value: float | None) -> float | str | None:
    """Return the number; "nan", "inf" or "-inf" as text."""
    return value if value is None or math.isfinite(value) else repr(float(value))

"""Reads a SQLite3 file as plain tables; runs no code from it, and no table is larger than the file.

A table of SQLite may be a view, even an endless one, have computed columns, or pages that are read
many times. So only ordinary tables are read here, at most as many bytes of each as the file has,
and SQLite stops after more steps than a file of that size needs.
"""

import re
import sqlite3
from collections.abc import Generator, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from zwidth.logs.source import RecordingError

ROW_BYTES = 4  # least bytes of a row in a file, beside its texts and data
ALWAYS_BYTES = 1 << 16  # of a value, so that SQLite can read the declarations of a small file
ALWAYS_STEPS, STEPS = 20_000_000, 8  # steps of SQLite's machine: for any file, and per byte
EVERY = 100_000  # steps
ORDINARY = re.compile(r"CREATE\s+TABLE\b", re.IGNORECASE)


class Tables:
    """The tables of a file. Raises RecordingError for other things, else sqlite3.Error."""

    def __init__(self, path: Path, base: sqlite3.Connection) -> None:
        self.name, self.size, self.base = path.name, path.stat().st_size, base
        self.left = (ALWAYS_STEPS + STEPS * self.size) // EVERY
        base.set_progress_handler(self._has_ended, EVERY)
        base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, max(self.size, ALWAYS_BYTES))
        base.setlimit(sqlite3.SQLITE_LIMIT_ATTACHED, 0)
        base.execute("PRAGMA trusted_schema = OFF")

    def has(self, table: str) -> bool:
        """Whether the file has a table. Raises RecordingError if it is not an ordinary one."""
        found = list(self._each(
            "SELECT type, rootpage, coalesce(sql, '') FROM sqlite_master WHERE lower(name) = ?"
            " AND type NOT IN ('index', 'trigger')", table,
        ))  # fmt: skip
        for kind, page, text in found:
            if kind != "table" or not page or not ORDINARY.match(str(text)):
                what = "virtual table" if kind == "table" else kind
                raise self._refused(table, f"is a {what}, but a bag has only ordinary tables")
        for column, hidden in self._each("SELECT name, hidden FROM pragma_table_xinfo(?)", table):
            if hidden:
                raise self._refused(
                    table, f"has the computed column {column!r}, but a bag has no computed columns"
                )
        return bool(found)

    def rows(self, table: str, columns: str, order: str = "") -> Iterator[tuple[Any, ...]]:
        """Yield the rows of an ordinary table. Raises RecordingError for more than the file has.

        columns: the last one is the largest. order: SQLite may first sort all rows.
        """
        if not self.has(table):
            raise self._refused(table, "is missing, and a bag has it")
        query = f"SELECT {columns} FROM {table}"
        if order:
            query += f" ORDER BY {order}"
            read = 0
            for (length,) in self._each(f"SELECT length({columns.split()[-1]}) FROM {table}"):
                read += ROW_BYTES + (length or 0)
                self._refuse_more(table, read)
        read = 0
        for row in self._each(query):
            read += ROW_BYTES + sum(len(one) for one in row if isinstance(one, str | bytes))
            self._refuse_more(table, read)
            yield row

    def _refuse_more(self, table: str, read: int) -> None:
        if read > self.size:
            raise self._refused(
                table, f"gives more than {self.size} bytes, which is all that the file has"
            )

    def _refused(self, table: str, why: str) -> RecordingError:
        return RecordingError(f"table {table!r} of {self.name} {why}; record the bag again")

    def _has_ended(self) -> bool:
        """Count steps, and return True where there are no more."""
        self.left -= 1
        return self.left < 0

    def _each(self, statement: str, *values: str) -> Iterator[tuple[Any, ...]]:
        try:
            yield from self.base.execute(statement, values)
        except sqlite3.Error as error:
            code = getattr(error, "sqlite_errorcode", 0)
            if code == sqlite3.SQLITE_INTERRUPT and self.left >= 0:
                raise KeyboardInterrupt from None  # for SQLite it is a handler's answer
            if code == sqlite3.SQLITE_INTERRUPT:
                raise RecordingError(
                    f"{self.name} takes SQLite more than {ALWAYS_STEPS + STEPS * self.size} steps,"
                    f" too many for a file of {self.size} bytes; record the bag again"
                ) from None
            if code == sqlite3.SQLITE_TOOBIG:
                raise RecordingError(
                    f"{self.name} has a value that is larger than the file itself ({self.size}"
                    " bytes); record the bag again"
                ) from None
            raise


@contextmanager
def tables(path: Path) -> Generator[Tables]:
    """Open a file read-only, without a log or journal beside it."""
    address = f"{path.resolve().as_uri()}?mode=ro&immutable=1"
    with closing(sqlite3.connect(address, uri=True)) as base:
        yield Tables(path, base)

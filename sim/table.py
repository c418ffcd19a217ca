"""Reads a TOML table key by key; every error names the place, the value, what is allowed."""

from collections.abc import Iterable, Mapping
from reprlib import repr as brief
from typing import TypeVar, cast

from zwidth.sim.nearest import nearest

T = TypeVar("T")


class TableError(ValueError):
    """A table with an invalid entry; the message is one sentence."""


class Table:
    """A table of a TOML file and its place ("" at the top, "interface", "modal.mode[1]").

    Every method raises TableError for a key that is missing (without a default) or whose value is
    of another type.
    """

    def __init__(self, values: Mapping[str, object], path: str = "") -> None:
        self._values = values
        self.path = path

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def only(self, known: Iterable[str]) -> "Table":
        """Return the table itself if it has only these keys."""
        known = list(known)
        for key in self._values:
            if key not in known:
                raise TableError(f"unknown key {self._at(key)!r}; {nearest(key, known)}")
        return self

    @property
    def values(self) -> Mapping[str, object]:
        """The table as it was read."""
        return self._values

    def keys(self) -> list[str]:
        """Return the keys of the table."""
        return list(self._values)

    def number(self, key: str, default: float | None = None) -> float:
        """Return a float; an integer counts as one."""
        return _number(self._get(key, default), self._at(key))

    def numbers(self, key: str, default: list[float] | None = None) -> list[float]:
        """Return a list of floats."""
        values = self._typed(key, default, list, "a list of numbers")
        return [_number(v, f"{self._at(key)}[{i}]") for i, v in enumerate(values)]

    def rows(self, key: str, width: int) -> list[list[float]]:
        """Return a list of rows with `width` floats each."""
        allowed = f"a list of rows of {width} numbers"
        rows = self._typed(key, None, list, allowed)
        for i, row in enumerate(rows):
            if not isinstance(row, list) or len(cast("list[object]", row)) != width:
                raise TableError(
                    f"{self._at(key)}[{i}] is {brief(row)}; it must be a list of {width} numbers"
                )
        return [
            [_number(v, f"{self._at(key)}[{i}][{j}]") for j, v in enumerate(row)]
            for i, row in enumerate(rows)
        ]

    def text(self, key: str, default: str | None = None) -> str:
        """Return a string."""
        return self._typed(key, default, str, "a string in quotes")

    def texts(self, key: str) -> list[str]:
        """Return a list of strings."""
        allowed = "a list of strings in quotes"
        values = self._typed(key, None, list, allowed)
        for i, value in enumerate(values):
            if not isinstance(value, str):
                raise TableError(
                    f"{self._at(key)}[{i}] is {brief(value)}; it must be a string in quotes"
                )
        return cast("list[str]", values)

    def boolean(self, key: str, default: bool | None = None) -> bool:
        """Return true or false."""
        return self._typed(key, default, bool, "true or false")

    def table(self, key: str) -> "Table":
        """Return a table inside this one, or an empty table if the key is missing."""
        return Table(self._typed(key, {}, dict, f"a table [{self._at(key)}]"), self._at(key))

    def tables(self, key: str) -> list["Table"]:
        """Return the tables of an array of tables; none if it is missing."""
        allowed = f"an array of tables [[{self._at(key)}]]"
        entries = self._typed(key, [], list, allowed)
        for entry in entries:
            if not isinstance(entry, dict):
                raise TableError(f"{self._at(key)} contains {brief(entry)}; it must be {allowed}")
        return [
            Table(cast("dict[str, object]", entry), f"{self._at(key)}[{i}]")
            for i, entry in enumerate(entries)
        ]

    def _at(self, key: str) -> str:
        return f"{self.path}.{key}" if self.path else key

    def _get(self, key: str, default: object) -> object:
        value = self._values.get(key, default)
        if value is None:
            raise TableError(f"{self._at(key)} is missing; add it")
        return value

    def _typed(self, key: str, default: T | None, kind: type[T], allowed: str) -> T:
        value = self._get(key, default)
        if not isinstance(value, kind):
            raise TableError(f"{self._at(key)} is {brief(value)}; it must be {allowed}")
        return value


def _number(value: object, at: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TableError(f"{at} is {brief(value)}; it must be a number")
    try:
        return float(value)
    except OverflowError:
        raise TableError(f"{at} is too large; it must be a number up to 1.8e308, or inf") from None

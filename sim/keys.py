"""The description of a key of a TOML file: one declaration for comments, reference and tests."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Key:
    """A key of a file.

    table: "", "chain", "modal.mode" ...; unit on a rotary device and linear_unit on another ("" for
    none; one unit applies to both if only one is given); default: as written in a file, "" for a
    required key; meaning and example: for people.
    """

    table: str
    name: str
    meaning: str
    unit: str = ""
    linear_unit: str = ""
    default: str = ""
    example: str = ""

    def unit_for(self, rotary: bool) -> str:
        """Return the unit on a rotary or a linear device."""
        return self.unit if rotary or not self.linear_unit else self.linear_unit

    @property
    def units(self) -> str:
        """Both units, as in "N m | N"."""
        other = self.linear_unit
        return f"{self.unit} | {other}" if other and other != self.unit else self.unit

    def comment(self, rotary: bool) -> str:
        """Return unit and meaning."""
        unit = self.unit_for(rotary)
        return f"[{unit}] {self.meaning}" if unit else self.meaning


def commented(text: str, comments: Mapping[tuple[str, str], str]) -> str:
    """Return a TOML text with comments, given by (table, key), after the lines of these keys."""
    return "\n".join(_with_comments(text.split("\n"), comments))


def _with_comments(lines: Iterable[str], comments: Mapping[tuple[str, str], str]) -> Iterator[str]:
    table = ""
    for line in lines:
        if line.startswith("["):
            table = line.strip("[] ")
        key = line.split(" = ")[0]
        said = comments.get((table, key)) if " = " in line else None
        yield f"{line}  # {said}" if said else line


def rows(keys: Iterable[Key]) -> list[dict[str, Any]]:
    """Return keys in their JSON form."""
    return [vars(key) for key in keys]

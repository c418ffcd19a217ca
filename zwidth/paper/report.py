"""The report as one HTML file, with all pictures inside it."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup, escape

from zwidth.figures.style import KINDS, picture_bytes
from zwidth.files.whole import write_text, write_with
from zwidth.paper.content import Picture, Section, Table
from zwidth.report_page import embedded, page

# K_CR, B_t, omega_1 as mathematics.
SYMBOL = re.compile(r"\b(K|B|omega|[cvdt])_(CR|max|t|d|[1-4])\b")
GREEK = {"omega": "\N{GREEK SMALL LETTER OMEGA}"}


@dataclass(frozen=True)
class Drawn:
    """A picture as files: name, caption, command, and the bytes of each format."""

    name: str
    caption: str
    command: str
    files: dict[str, bytes]

    @property
    def data(self) -> str:
        """The picture as a data URL."""
        return embedded(self.files["svg"])


@dataclass(frozen=True)
class DrawnSection:
    """A section whose pictures are drawn; kind and content of each part."""

    key: str
    title: str
    parts: tuple[tuple[str, Any], ...]
    seconds: float


def draw(key: str, section: Section, seconds: float) -> DrawnSection:
    """Draw the pictures of a section."""
    parts: list[tuple[str, Any]] = []
    for part in section.parts:
        match part:
            case Picture():
                files = {kind: picture_bytes(part.figure, kind) for kind in KINDS}
                parts.append(("picture", Drawn(part.name, part.caption, part.command, files)))
            case Table():
                parts.append(("table", part))
            case str():
                parts.append(("words", part))
    return DrawnSection(key, section.title, tuple(parts), seconds)


def save_pictures(section: DrawnSection, out: Path) -> list[Path]:
    """Write each picture as PNG and SVG; returns the paths."""
    written: list[Path] = []
    for kind, part in section.parts:
        if kind == "picture":
            for suffix, data in part.files.items():
                path = out / f"{part.name}.{suffix}"
                written.append(write_with(path, lambda stream, data=data: stream.write(data)))
    return written


def save_report(sections: Sequence[DrawnSection], missing: Sequence[str], path: Path) -> Path:
    """Write the report; missing: titles of sections that were not computed. Returns the path."""
    text = page("paper/report.html", {"symbols": symbols}, sections=sections, missing=missing)
    return write_text(path, text)


def symbols(text: str) -> Markup:
    """Return text as HTML, with the indices of symbols as subscripts."""

    def set_in_type(match: re.Match[str]) -> str:
        letter, index = match.groups()
        return f"<i>{GREEK.get(letter, letter)}</i><sub>{index}</sub>"

    return Markup(SYMBOL.sub(set_in_type, str(escape(text))))

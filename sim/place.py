"""Places of physics in a device, which files write as "m2", "link12", "command"."""

import re
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from zwidth.shown import Valued

Kind = Literal["mass", "link", "ground", "command", "clock", "sensor", "velocity"]
GROUND = -1  # index of the fixed ground
MOST_MASSES = 5  # of a chain (`sim/chain.py`)


@dataclass(frozen=True)
class Place(Valued):
    """A place; `str` writes it as files do, `place_at` reads it.

    index: of the mass, or of the link's first mass, from 0. ground: between m1 and the fixed
    ground. velocity: every reading of a velocity; sensor: every reading.
    """

    kind: Kind
    index: int = 0

    def __str__(self) -> str:
        if self.kind == "mass":
            return f"m{self.index + 1}"
        if self.kind == "link":
            return f"link{self.index + 1}{self.index + 2}"
        return self.kind

    @property
    def masses_needed(self) -> int:
        """The number of masses that it needs in a chain: 3 for m3 and link23."""
        return self.ends[0] + 1 if self.ends[1] == GROUND else self.ends[1] + 1

    @property
    def ends(self) -> tuple[int, int]:
        """The masses between which a force here acts: m2 -> (1, `GROUND`), link12 -> (0, 1)."""
        return self.index, self.index + 1 if self.kind == "link" else GROUND

    @property
    def acts_on(self) -> "Place":
        """The mass or link on which it acts: an effect between m1 and ground acts on m1."""
        return Place("mass", 0) if self.kind == "ground" else self

    def row(self, masses: int) -> NDArray[np.float64]:
        """The row vector that gives the displacement of a force here from the masses' positions."""
        first, second = self.ends
        found = np.zeros(masses)
        found[first] = 1.0
        if second != GROUND:
            found[second] = -1.0
        return found


def masses_and_links(masses: int) -> list[Place]:
    """Return every mass and link of a chain, masses first."""
    links = [Place("link", i) for i in range(masses - 1)]
    return [*(Place("mass", i) for i in range(masses)), *links]


MASSES = tuple(str(Place("mass", i)) for i in range(MOST_MASSES))
LINKS = tuple(str(Place("link", i)) for i in range(MOST_MASSES - 1))


@cache
def place_at(text: str) -> Place:
    """Return the place with this name in files; raises ValueError if there is none."""
    if text in ("ground", "command", "clock", "sensor", "velocity"):
        return Place(text)
    if mass := re.fullmatch(r"m([1-9])", text):
        return Place("mass", int(mass[1]) - 1)
    link = re.fullmatch(r"link([1-9])([1-9])", text)
    if link and int(link[2]) == int(link[1]) + 1:
        return Place("link", int(link[1]) - 1)
    raise ValueError(
        f"at is {text!r}; it must be a mass (m1), a link (link12), ground, command, clock, sensor"
        " or velocity"
    )


def label_of(effect: str, place: Place) -> str:
    """Return "effect@place"."""
    return f"{effect}@{place}"


def of_label(label: str) -> tuple[str, Place]:
    """Return effect and place of "effect@place"; raises ValueError for other text."""
    effect, _, at = label.partition("@")
    return effect, place_at(at)

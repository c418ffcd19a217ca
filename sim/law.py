"""The law of the walls of an ensemble, and its numbers besides stiffness and damping."""

import math
from dataclasses import dataclass
from typing import Literal, get_args

from zwidth.shown import Valued
from zwidth.sim.nearest import nearest
from zwidth.sim.wall_law import GUARDED, PLAIN, REGION, TEXTURE

Kind = Literal["wall", "texture", "region", "guarded"]
CODES: dict[Kind, int] = {"wall": PLAIN, "texture": TEXTURE, "region": REGION, "guarded": GUARDED}


@dataclass(frozen=True)
class Law(Valued):
    """A law of walls (`sim/wall_law.py`); fields that its kind does not use are 0.

    kind: wall (spring and damper), texture, region or guarded. wavelength [rad | m] and share of a
    texture; width [rad | m] of a region, 0 for unlimited; most_damping [N m s/rad | N s/m] of a
    passivity controller.

    Raises ValueError (field, value, what is allowed).
    """

    kind: Kind = "wall"
    wavelength: float = 0.0
    share: float = 1.0
    width: float = 0.0
    most_damping: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in CODES:
            raise ValueError(f"law.kind is {self.kind!r}; {nearest(self.kind, get_args(Kind))}")
        for name in ("wavelength", "width", "most_damping"):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ValueError(f"law.{name} is {value}; it must be 0 or more, and finite")
        if not 0.0 <= self.share <= 1.0:
            raise ValueError(f"law.share is {self.share}; it must be from 0 to 1")
        if self.kind == "texture" and self.wavelength == 0.0:
            raise ValueError("law.wavelength is 0; a texture needs one above 0 [rad | m]")

    @property
    def code(self) -> int:
        """The number by which compiled code selects the law."""
        return CODES[self.kind]

    @property
    def numbers(self) -> tuple[float, float]:
        """The two numbers of a wall beyond those of a plain one."""
        match self.kind:
            case "texture":
                return 2.0 * math.pi / self.wavelength, self.share
            case "region":
                return self.width, 0.0
            case "guarded":
                return self.most_damping, 0.0
            case _:
                return 0.0, 0.0

    @property
    def linear(self) -> bool:
        """Whether a two-sided wall of this law is linear."""
        return self.kind == "wall" or (self.kind == "region" and self.width == 0.0)

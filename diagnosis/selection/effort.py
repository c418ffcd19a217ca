"""How much a search may try."""

from dataclasses import dataclass
from typing import ClassVar


@dataclass(frozen=True)
class Effort:
    """How many hypotheses a search fits.

    effects: most effects in one hypothesis. beam: number of hypotheses that continue. near, far:
    starts fitted from a view with the most likely noise, and from a long-horizon view; judged:
    starts of each view that are evaluated with their own noise; ended: starts of a round that are
    fitted to the end. rivals: starts in place of each effect, beside: those of them that are fitted
    to the end. generations, members: of a population that searches for the valley again. rounds: of
    adding and exchanging. surfaces: whether laws over two states are learned.
    """

    effects: int = 5
    beam: int = 1
    near: int = 5
    far: int = 3
    rivals: int = 4
    judged: int = 3
    ended: int = 3
    beside: int = 2
    generations: int = 80
    members: int = 16
    rounds: int = 3
    surfaces: bool = True
    first_rounds: ClassVar[int] = 4
    own_rounds: ClassVar[int] = 2
    most_ended: ClassVar[int] = 2  # times `ended`, if laws differ only in their places


QUICK = Effort(effects=3, near=3, far=2, rivals=2, ended=2, generations=0, rounds=1, surfaces=False)
NORMAL = Effort()
THOROUGH = Effort(beam=3, near=8, far=6, rivals=8, ended=8, generations=200, members=32, rounds=5)
EFFORTS = {"quick": QUICK, "normal": NORMAL, "thorough": THOROUGH}

"""The measured boundary of the ETHZ haptic paddle: seven pairs of damping and stiffness."""

import tomllib
from functools import cache
from pathlib import Path
from typing import NamedTuple

TABLE = Path(__file__).parent / "data" / "ethz_haptic_paddle.toml"
DEVICE = "ethz_haptic_paddle"


class PaddlePoint(NamedTuple):
    """A wall at the edge of stability: damping B [N m s/rad], stiffness K [N m/rad]."""

    damping: float
    stiffness: float


@cache
def paddle_boundary() -> tuple[PaddlePoint, ...]:
    """Return the measured points in rising order of damping."""
    with TABLE.open("rb") as file:
        rows = tomllib.load(file)["row"]
    return tuple(PaddlePoint(float(row["damping"]), float(row["stiffness"])) for row in rows)

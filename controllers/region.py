"""A region of damping, or of damping and stiffness, between two places (`sim/wall_law.py`)."""

from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np

from zwidth.sim.controller import Controller, compile_step
from zwidth.sim.wall_law import region_push


def region_step(k, t, y, v, p, m):  # pyright: ignore
    """Push back by spring and damper inside the region."""
    m[0] = 1.0 if p[4] == 0.0 or 0.0 < y - p[2] < p[4] else 0.0
    return -region_push(p, y, v)


@cache
def _compiled() -> Any:
    return compile_step(region_step)


def region(
    damping: float, stiffness: float = 0.0, position: float = 0.0, width: float = 0.0
) -> Controller:
    """Return a region of damping B [N m s/rad | N s/m] from position to position + width.

    stiffness K [N m/rad | N/m]: of a spring to its beginning, 0 for damping alone. width [rad | m]:
    0 for everywhere. Inside, it presses and pulls.

    Raises ValueError for a width < 0 or values that are not finite.
    """
    values = {"damping": damping, "stiffness": stiffness, "position": position, "width": width}
    for name, value in values.items():
        if not np.isfinite(value):
            raise ValueError(f"controller.{name} is {value}; only finite numbers are allowed")
    if width < 0.0:
        raise ValueError(
            f"controller.width is {width}; it must be positive, or 0 for a wall everywhere"
        )
    parameters = np.array([stiffness, damping, position, 0.0, width, 0.0])
    facts = {name: float(value) for name, value in values.items()}
    return Controller("region", _compiled(), parameters, 1, MappingProxyType(facts))

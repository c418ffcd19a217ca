"""The virtual wall: a spring K and a damper B on the measured position.

Two-sided: u = -(K (y - x_w) + B v) everywhere. One-sided: the wall fills y > x_w, acts only there,
and never pulls: u = -max(0, K (y - x_w) + B v) inside, 0 outside.
"""

from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np

from zwidth.sim.controller import Controller, compile_step


def wall_step(k, t, y, v, p, m):  # pyright: ignore
    """Push back by spring and damper, everywhere or inside only."""
    depth = y - p[2]
    push = p[0] * depth + p[1] * v
    if p[3] == 0.0:
        m[0] = 1.0
        return -push
    if depth > 0.0:
        m[0] = 1.0
        return -max(0.0, push)
    m[0] = 0.0
    return 0.0


@cache
def _compiled() -> Any:
    return compile_step(wall_step)


def wall(
    stiffness: float, damping: float, position: float = 0.0, one_sided: bool = False
) -> Controller:
    """Return a wall of stiffness K [N m/rad | N/m], damping B [N m s/rad | N s/m] at position.

    Raises ValueError for values that are not finite.
    """
    for name, value in (("stiffness", stiffness), ("damping", damping), ("position", position)):
        if not np.isfinite(value):
            raise ValueError(f"controller.{name} is {value}; only finite numbers are allowed")
    facts = {
        "stiffness": float(stiffness),
        "damping": float(damping),
        "position": float(position),
        "one_sided": bool(one_sided),
    }
    parameters = np.array([stiffness, damping, position, float(one_sided)])
    return Controller("wall", _compiled(), parameters, 1, MappingProxyType(facts))

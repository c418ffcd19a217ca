"""A virtual wall with a passivity observer and a passivity controller (`sim/wall_law.py`).

m[1] is the observer's energy [J]. Without delay, and if the amplifier changes nothing, it equals,
to rounding, the energy that the command has taken out of the device (`wall` in the ledger).
"""

from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np

from zwidth.sim.controller import Controller, compile_step
from zwidth.sim.wall_law import MEMORY, guarded_push


def guarded_step(k, t, y, v, p, m):  # pyright: ignore
    """Push back like a wall, with added damping where the wall would otherwise generate energy."""
    return -guarded_push(p, k, t, y, v, m)


@cache
def _compiled() -> Any:
    return compile_step(guarded_step)


def guarded(
    stiffness: float,
    damping: float,
    most_damping: float,
    position: float = 0.0,
    one_sided: bool = False,
) -> Controller:
    """Return a wall of stiffness K and damping B under a passivity observer and controller.

    most_damping [N m s/rad | N s/m]: the most that the controller may add. Sampled damping above
    `last_stable_damping` makes the device unstable, so stay below it.

    Raises ValueError for values that are not finite, or a most_damping < 0.
    """
    values = {
        "stiffness": stiffness, "damping": damping, "most_damping": most_damping,
        "position": position,
    }  # fmt: skip
    for name, value in values.items():
        if not np.isfinite(value):
            raise ValueError(f"controller.{name} is {value}; only finite numbers are allowed")
    if most_damping < 0.0:
        raise ValueError(f"controller.most_damping is {most_damping}; it must be 0 or more")
    facts = {n: float(v) for n, v in values.items()} | {"one_sided": bool(one_sided)}
    parameters = np.array([stiffness, damping, position, float(one_sided), most_damping, 0.0])
    return Controller("guarded", _compiled(), parameters, MEMORY, MappingProxyType(facts))

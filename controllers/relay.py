"""The relay of Fig. 9: an on-off force against the position, plus virtual damping.

u = -(D sign(y) + B v), where sign(0) is the previous side. Both parts go through the loop's delay.
m[1] keeps the relay's side, so that the square wave can be separated from the damping: m[0] logs
the relay's own force over D (+1 or -1).
"""

from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np

from zwidth.sim.controller import Controller, compile_step


def relay_step(k, t, y, v, p, m):  # pyright: ignore
    """Push against the side the position is on, and against its velocity."""
    side = m[1]
    if y > p[2]:
        side = 1.0
    elif y < p[2]:
        side = -1.0
    m[1] = side
    m[0] = -side
    return -(p[0] * side + p[1] * v)


@cache
def _compiled() -> Any:
    return compile_step(relay_step)


def relay(force: float, damping: float = 0.0, reference: float = 0.0) -> Controller:
    """Return a relay of force D [N m | N] with virtual damping B, switching at a reference.

    Raises ValueError for a force that is not > 0, or values that are not finite.
    """
    if not 0.0 < force < np.inf:
        raise ValueError(f"controller.force is {force}; a relay needs a finite force > 0")
    for name, value in (("damping", damping), ("reference", reference)):
        if not np.isfinite(value):
            raise ValueError(f"controller.{name} is {value}; only finite numbers are allowed")
    facts = {"force": float(force), "damping": float(damping), "reference": float(reference)}
    return Controller(
        "relay", _compiled(), np.array([force, damping, reference]), 2, MappingProxyType(facts)
    )

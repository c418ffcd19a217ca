"""A recorded command, one value per tick; after its end the command is zero."""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.controller import Controller, compile_step


def recorded_step(k, t, y, v, p, m):  # pyright: ignore
    """Command what was recorded at this tick."""
    return p[k] if k < p.size else 0.0


@cache
def _compiled() -> Any:
    return compile_step(recorded_step)


def recorded(commands: NDArray[np.float64]) -> Controller:
    """Return the controller that plays commands [N m | N], shape (ticks,).

    Raises ValueError if they are not one-dimensional or not finite.
    """
    values = np.ascontiguousarray(commands, dtype=np.float64)
    if values.ndim != 1:
        raise ValueError(
            f"recorded commands have shape {values.shape}; give one value for each tick"
        )
    return Controller("recorded", _compiled(), values)

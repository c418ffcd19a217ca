"""No controller: the command is zero."""

from functools import cache
from typing import Any

import numpy as np

from zwidth.sim.controller import Controller, compile_step


def no_step(k, t, y, v, p, m):  # pyright: ignore
    """Command nothing."""
    return 0.0


@cache
def _compiled() -> Any:
    return compile_step(no_step)


def none() -> Controller:
    """Return the controller that never commands anything."""
    return Controller("none", _compiled(), np.zeros(1))

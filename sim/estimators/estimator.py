"""An estimator of velocity: its settings, memory, numbers of its step, and linear equations."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


class Settings(NamedTuple):
    """Settings of an estimator; `Interface` has each as velocity_NAME.

    period h [s] from one estimate to the next; window: periods that FOAW looks back at most; band
    [rad | m]: half the width of FOAW's band; noise [rad | m]: standard deviation of a reading;
    acceleration [rad/s2 | m/s2]: the bound of Levant's, or a standard deviation of Kalman's model.
    """

    period: float
    window: int
    band: float
    noise: float
    acceleration: float


class Linear(NamedTuple):
    """A linear estimator: s' = keep s + take y, and h v = out s + through y.

    keep (n, n), take, out (n,); s the memory before the reading y, v the estimate [1/s of y], h the
    time between estimates. rest (n,): the memory at rest with y = 1.
    """

    keep: Floats
    take: Floats
    out: Floats
    through: float
    rest: Floats


@dataclass(frozen=True)
class Estimator:
    """An estimator of velocity.

    name in device files; code in the kernel; settings: names of `Settings` that it takes, each to
    be above 0 unless in may_be_zero; meaning: one line; reference: where it comes from.

    room: how many numbers it remembers. numbers: those of its step. begin: its memory before the
    first reading, given `read(k)`, the reading k periods before the start (0: at the start) of a
    device that arrived with the velocity `speed`. linear: its equations, None if it has none;
    response: over the backward difference, at z.
    """

    name: str
    code: int
    settings: tuple[str, ...]
    meaning: str
    reference: str
    room: Callable[[Settings], int]
    numbers: Callable[[Settings], tuple[float, ...]]
    begin: Callable[[Settings, Callable[[int], float], float], list[float]]
    linear: Callable[[Settings], Linear] | None = None
    response: Callable[[Settings, Complexes], Complexes] | None = None
    may_be_zero: tuple[str, ...] = ()

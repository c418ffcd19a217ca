"""Coordinates in which a fit cannot leave the stable, interlacing models.

They are the logarithms of m, b and, for each mode, of w_i - v_i, c_i, v_i - w_{i-1} and d_i: every
real vector is a model with v_1 < w_1 < v_2 < w_2 < ... If a delay is fitted too, it is the last
coordinate, in periods.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.chain import MAX_MASSES
from zwidth.sim.modal import ModalModel, Mode

Floats = NDArray[np.float64]
MAX_MODES = MAX_MASSES - 1  # the most that a device may have
MOST_DAMPED = 1.99  # c over omega, so that a mode oscillates
STEP = 1e-6
RANGE = 7.0  # of a logarithm on either side of the start
MOST_DELAY = 50.0  # periods


@dataclass(frozen=True)
class Coordinates:
    """Which coordinates are fitted: those of some modes and, unless it is known, the delay [s]."""

    modes: int
    period: float
    delay: float | None = 0.0

    @property
    def names(self) -> tuple[str, ...]:
        """m, b, omega_1, c_1, v_1, d_1, ... and, if it is fitted, delay."""
        each = [f"{name}_{i + 1}" for i in range(self.modes) for name in Mode._fields]
        return ("m", "b", *each, *(("delay",) if self.delay is None else ()))

    def of(self, model: ModalModel, delay: float) -> Floats:
        """Return the coordinates of a model with v_1 < w_1 < v_2 < ..., (p,)."""
        x = [np.log(model.inertia), np.log(model.damping)]
        last = 0.0
        for omega, c, v, d in model.modes:
            x += [np.log(omega - v), np.log(c), np.log(v - last), np.log(d)]
            last = omega
        return np.array(x if self.delay is not None else [*x, delay / self.period])

    def model(self, x: Floats) -> tuple[ModalModel, float]:
        """Return model and delay [s] of coordinates (p,)."""
        values = np.exp(x[: 2 + 4 * self.modes])
        built: list[Mode] = []
        last = 0.0
        for above, c, over, d in values[2:].reshape(-1, 4):
            v = last + over
            last = v + above
            built.append(Mode(last, min(c, MOST_DAMPED * last), v, d))
        delay = self.period * float(x[-1]) if self.delay is None else self.delay
        return ModalModel(values[0], values[1], tuple(built)), delay

    def values(self, x: Floats) -> Floats:
        """Return the parameters in the order of `names`, the delay in s, (p,)."""
        model, delay = self.model(x)
        return parameters(model, delay if self.delay is None else None)

    def slope(self, x: Floats) -> Floats:
        """Return the derivative by the coordinates of ln(parameter), of the delay [s], (p, p)."""
        scale = self.values(x)
        if self.delay is None:
            scale[-1] = 1.0
        steps = STEP * np.eye(x.size)
        columns = [self.values(x + step) - self.values(x - step) for step in steps]
        return np.column_stack(columns) / (2.0 * STEP) / scale[:, None]

    def bounds(self, x: Floats) -> tuple[Floats, Floats]:
        """Return bounds about a start (p,): a factor of 1e3, at most half the sampling rate."""
        top = np.log(np.pi / self.period)
        lower, upper = x - RANGE, x + RANGE
        for first in range(2, 2 + 4 * self.modes, 4):
            for j in (first, first + 2):
                upper[j] = max(min(upper[j], top), x[j] + 1e-3)
        if self.delay is None:
            lower[-1], upper[-1] = 0.0, max(MOST_DELAY, x[-1] + 1.0)
            x[-1] = max(x[-1], 1e-3)
        return lower, upper


def parameters(model: ModalModel, delay: float | None = None) -> Floats:
    """Return m, b, omega_1, c_1, v_1, d_1, ..., and the delay [s] if one is given."""
    each = [x for mode in model.modes for x in mode]
    return np.array([model.inertia, model.damping, *each, *(() if delay is None else (delay,))])

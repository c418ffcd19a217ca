"""Estimators of velocity as the PHANToM may have them, and each again in slow, plain words."""

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

Floats = NDArray[np.float64]
STEP = 2e-5  # of the encoder [rad]

SET: dict[str, dict[str, Any]] = {
    "foaw": {"velocity_window": 9, "velocity_band": STEP},
    "foaw_end": {"velocity_window": 7, "velocity_band": 1.5 * STEP, "velocity_cutoff_hz": 90.0},
    "levant": {"velocity_acceleration": 30.0},
    "kalman": {"velocity_noise": 6e-6, "velocity_acceleration": 12.0},
    "kalman_acceleration": {
        "velocity_noise": 6e-6, "velocity_acceleration": 3.0, "velocity_cutoff_hz": 150.0,
        "velocity_order": 2,
    },
}  # fmt: skip
for _name, _settings in SET.items():
    _settings |= {"velocity_estimator": _name, "encoder_step": STEP, "delay": 0.0013}


def by_foaw(counts: Sequence[int], window: int, band: Fraction, best: bool) -> list[Fraction]:
    """Slopes in counts per period by the definition, exactly; counts[:window] came before."""
    found: list[Fraction] = []
    for k in range(window, len(counts)):
        slope = Fraction(0)
        for n in range(1, window + 1):
            ys = [counts[k - i] for i in range(n + 1)]
            if best:  # least squares over the times -i
                mean_t, mean_y = Fraction(-n, 2), Fraction(sum(ys), n + 1)
                times = [-i - mean_t for i in range(n + 1)]
                pairs = zip(times, ys, strict=True)
                across = sum((t * (y - mean_y) for t, y in pairs), Fraction(0))
                tried = across / sum((t * t for t in times), Fraction(0))
            else:
                tried = Fraction(ys[0] - ys[n], n)
            outside = any(abs(ys[i] - (ys[0] - i * tried)) > band for i in range(1, n + 1))
            if n > 1 and outside:
                break
            slope = tried
        found.append(slope)
    return found


def by_levant(y: Floats, bound: float, period: float, speed: float) -> Floats:
    """Velocities by Euler's step of the differential equations of 1998, in SI units."""
    z0, z1 = float(y[0]), speed
    found: list[float] = []
    for reading in y.tolist():
        e = z0 - reading
        side = math.copysign(1.0, e) if e != 0.0 else 0.0
        z0, z1 = (
            z0 + period * (z1 - 1.5 * math.sqrt(bound * abs(e)) * side),
            z1 - period * 1.1 * bound * side,
        )
        found.append(z1)
    return np.array(found)


def model(period: float, order: int) -> tuple[Floats, Floats]:
    """Moves (n, n) and the entry (n, 1) of what disturbs a constant velocity or acceleration."""
    h = period
    if order == 2:
        return np.array([[1.0, h], [0.0, 1.0]]), np.array([[0.5 * h * h], [h]])
    moves = np.array([[1.0, h, 0.5 * h * h], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
    return moves, np.array([[0.5 * h * h], [h], [1.0]])


def kalman_gain(period: float, order: int, noise: float, acceleration: float) -> Floats:
    """The steady gain (n,) by the Riccati equation, in SI units."""
    moves, entry = model(period, order)
    scale = np.diag([period**i for i in range(order)])  # else the equation is ill-scaled
    inverse = np.linalg.inv(scale)
    a, g = scale @ moves @ inverse, scale @ entry * acceleration / noise
    c = np.eye(order)[:1]
    spread = solve_discrete_are(a.T, c.T, g @ g.T, np.eye(1))
    gain = spread @ c.T / (c @ spread @ c.T + 1.0)
    return (inverse @ gain).ravel()


def by_kalman(y: Floats, gain: Floats, period: float, first: Sequence[float]) -> Floats:
    """Velocities by prediction and correction, in SI units; first: the state before y[0]."""
    moves, _ = model(period, gain.size)
    state = np.array(first)
    found: list[float] = []
    for reading in y.tolist():
        state = moves @ state
        state = state + gain * (reading - state[0])
        found.append(float(state[1]))
    return np.array(found)

"""The readings of a relay beyond the boundary, where the amplifier's limit bounds the oscillation.

The relay's force D and the damper's B v together make the command. At amplitude A the relay reads K
= 4 D / (pi A), and the command's first harmonic is |K + B w| A. An amplifier of limit lambda D
passes the share N of this (that of a saturation, `stability/describing.py`), so there is a cycle
where

    (N K, N B) is on the linear boundary,    command over limit = 4 |K + B w| / (pi lambda K).

With B' = N B and K' = K_CR(B') this is one equation in B'. Without saturation N = 1, K = K_CR(B).
Beyond the last stable B the linear loop has no reading. The limited loop has one on the flank of
the boundary, where K' falls steeply: B' is almost constant there, and the reading falls slowly with
B.

Limits: one harmonic. Of several cycles, the one farthest out on the flank is returned, which
belongs to the fast branch.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from zwidth.sim.device import Device
from zwidth.stability.linear import boundary, corner, critical_stiffness
from zwidth.stability.types import LinearPoint

Floats = NDArray[np.float64]
WITHIN = 1e-9  # of B


def limited_reading(device: Device, damping: float, ratio: float) -> LinearPoint:
    """Return the reading of a relay at one B; see `limited_boundary`."""
    return limited_boundary(device, [damping], ratio)[0]


def limited_boundary(device: Device, dampings: Iterable[float], ratio: float) -> list[LinearPoint]:
    """Return the K and frequency that a relay reads at each B; the limit is ratio times its force.

    Departures are those of the linear boundary at the damping B' that the limit passes. Raises
    ValueError for a ratio that is not above 1.
    """
    if not ratio > 1.0:
        raise ValueError(f"ratio is {ratio}; it must be above 1, or the amplifier limits the relay")
    points = boundary(device, dampings)
    limited = [_passed(device, point, ratio) < 1.0 for point in points]
    top = corner(device) if any(limited) else None
    if top is None:
        return points
    return [
        _on_the_flank(device, point, ratio, top.damping) if beyond else point
        for point, beyond in zip(points, limited, strict=True)
    ]


def _on_the_flank(device: Device, free: LinearPoint, ratio: float, top: float) -> LinearPoint:
    """Return the cycle on the flank beyond B_t (top); the free point if there is no such cycle."""

    def excess(left: float) -> float:
        return _passed(device, critical_stiffness(device, left), ratio) - left / free.damping

    if top >= free.damping or excess(top) <= 0.0:
        return free
    left = brentq(excess, top, free.damping, xtol=WITHIN * free.damping)
    point = critical_stiffness(device, float(left))  # pyright: ignore[reportArgumentType]
    if point.stiffness is None:
        return free
    stiffness = point.stiffness * free.damping / point.damping
    return LinearPoint(free.damping, stiffness, point.frequency_hz, point.departure)


def command_share(wall: ArrayLike, stiffness: ArrayLike, ratio: float) -> Floats:
    """Return the command's first harmonic over the limit for walls K + B w, infinite for K = 0."""
    with np.errstate(divide="ignore"):
        return np.asarray(4.0 * np.abs(wall) / (np.pi * ratio) / np.asarray(stiffness))


def passed_share(share: ArrayLike) -> Floats:
    """Return N, the share of a command that a limit passes, from the command over the limit."""
    r = 1.0 / np.maximum(share, 1.0)
    return 2.0 / np.pi * (np.arcsin(r) + r * np.sqrt(1.0 - r * r))


def _passed(device: Device, point: LinearPoint, ratio: float) -> float:
    """Share of the command that the limit passes at a point of the linear boundary."""
    if point.stiffness is None or point.frequency_hz is None:
        return 0.0
    period = device.interface.period
    back = np.exp(-2j * np.pi * point.frequency_hz * period)
    wall = point.stiffness + point.damping * (1.0 - back) / period
    return float(passed_share(command_share(wall, point.stiffness, ratio)))

"""The linear boundary: the largest K at a given B before the exact one-tick loop goes unstable.

K_CR is the end of the stable interval of K that begins at 0. The gains at which any eigenvalue is
on the unit circle come all at once from `stability/crossings.py`; between them stability cannot
change, so it is read from the eigenvalues at one K in each interval, and no band is missed. Above
the last of them every K is unstable: a held command that grows with K pushes an eigenvalue to
infinity. The same holds for B.

Near K = 0 a free device has an eigenvalue 1 - K T / (b + B): inside iff b + B > 0, which is when
the slow eigenvalue 1 - (b + B) T / m of the loop without drift is inside. So that loop decides for
K -> 0. (A gain-margin routine gives a number even if K -> 0 is unstable.)

Limits: a decay of less than `SETTLED` per tick counts as none at K -> 0, a growth of less than
`ROUNDING` per tick counts as none at any K.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from zwidth.sim.device import Device
from zwidth.sim.interface import DIFFERENCE_ALONE
from zwidth.sim.loop import Loop, open_loop
from zwidth.stability.crossings import Crossings, crossings
from zwidth.stability.periodic import (
    PeriodicLoop,
    periodic_boundary,
    periodic_corner,
    periodic_last_damping,
    periodic_loop,
)
from zwidth.stability.types import Corner, LinearPoint

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
SETTLED = 1e-9
ROUNDING = 1e-12
CORNER_GRID = 50
JUMP = 1e-3


def critical_stiffness(device: Device, damping: float) -> LinearPoint:
    """Return K_CR and the ultimate frequency at a virtual damping B [N m s/rad | N s/m].

    Raises ValueError if B is not finite.
    """
    return boundary(device, [damping])[0]


def boundary(device: Device, dampings: Iterable[float]) -> list[LinearPoint]:
    """Return the critical stiffness at each B, for several rates by `stability/periodic.py`."""
    if device.interface.multirate:
        return periodic_boundary(device, dampings)
    loop = open_loop(device)
    return [_critical(loop, damping) for damping in dampings]


def has_theory(device: Device) -> bool:
    """Whether linear theory applies to the device: whether its velocity estimator is linear."""
    return device.interface.estimator.linear is not None


def known_boundary(device: Device, dampings: Iterable[float]) -> list[LinearPoint]:
    """Return `boundary`, or points without a stiffness if linear theory does not apply."""
    if has_theory(device):
        return boundary(device, dampings)
    return [LinearPoint(damping, None, None, None) for damping in dampings]


def stand_in(device: Device) -> Device:
    """Return a device whose linear boundary sets the range of a search.

    It is the device itself if linear theory applies to it, else the device with the backward
    difference as its velocity estimator. The boundary of the latter is only a range of K and B to
    try, not a statement about the device.
    """
    return device if has_theory(device) else device.with_interface(**DIFFERENCE_ALONE)


def any_loop(device: Device) -> Loop | PeriodicLoop:
    """Return the loop of a device: `closed(K, B)` spans a tick or, with several rates, a cycle."""
    return periodic_loop(device) if device.interface.multirate else open_loop(device)


def stable_dampings(device: Device) -> list[tuple[float, float]]:
    """Return all intervals (from, to) of B >= 0 [N m s/rad | N s/m] with a stable K near 0.

    B is a rank-one change of the loop, as K is: the same eigenproblem, at K = 0 and without the
    drift, gives all B at which an eigenvalue is on the unit circle.
    """
    return _stable_dampings(open_loop(device))


def last_stable_damping(device: Device) -> float | None:
    """Return the B above which every small K is unstable; None if it is unstable at every B."""
    if device.interface.multirate:
        return periodic_last_damping(device)
    bands = stable_dampings(device)
    return bands[-1][1] if bands else None


def corner(device: Device) -> Corner | None:
    """Return the highest point of the boundary for B from 0 to the last stable B, or None.

    None: no K is stable. The search begins on a grid of `CORNER_GRID` dampings and continues to
    rounding precision.
    """
    if device.interface.multirate:
        return periodic_corner(device)
    loop = open_loop(device)
    bands = _stable_dampings(loop)
    if not bands:
        return None
    grid = np.concatenate([np.linspace(low, high, CORNER_GRID) for low, high in bands])
    top = int(np.argmax([_height(loop, damping) for damping in grid.tolist()]))

    def depth(damping: float) -> float:
        return -_height(loop, float(damping))

    peak = minimize_scalar(
        depth,
        bounds=(grid[max(top - 1, 0)], grid[min(top + 1, grid.size - 1)]),
        method="bounded",
        options={"xatol": 1e-9 * grid[-1]},
    )
    nearby = 1e-7 * float(grid[-1])
    return _meeting(loop, max(float(peak.x) - nearby, 0.0), float(peak.x) + nearby)


def _critical(loop: Loop, damping: float) -> LinearPoint:
    found = _crossings(loop, damping)
    if not _begins_stable(loop, damping, found):
        return LinearPoint(damping, None, None, None)
    later = _between(found.gains)[1:]
    kept = (_stable(loop.closed(stiffness, damping)) for stiffness in later)
    i = next((i for i, stable in enumerate(kept) if not stable), found.gains.size - 1)
    return LinearPoint(
        damping,
        stiffness=float(found.gains[i]),
        frequency_hz=float(found.angles[i]) / (2.0 * np.pi * loop.period),
        departure=float(found.departures[i]) / loop.period,
    )


def _crossings(loop: Loop, damping: float) -> Crossings:
    if not np.isfinite(damping):
        raise ValueError(f"damping is {damping}; only finite numbers are allowed")
    return crossings(loop.damped(damping), loop.entry, loop.reading)


def _begins_stable(loop: Loop, damping: float, found: Crossings) -> bool:
    """Tell whether the loop is stable for K -> 0.

    In a free device a slow eigenvalue at 1 means b + B = 0: any delayed spring then drives the
    motion. If another eigenvalue starts on the circle, the spring moves it in or out, so the loop
    is checked a little above K = 0. Without any crossing the loop is unstable there, as it is for
    large K.
    """
    if found.gains.size == 0:
        return False
    start = loop.without_drift() if loop.free else loop
    eigenvalues = _eigenvalues(start.damped(damping))
    excess = np.abs(eigenvalues) - 1.0
    marginal = np.abs(excess) < SETTLED
    undamped = loop.free and np.any(np.abs(eigenvalues - 1.0) < SETTLED)
    if undamped or np.any(excess >= SETTLED):
        return False
    return not marginal.any() or _stable(loop.closed(_between(found.gains)[0], damping))


def _between(gains: Floats) -> Floats:
    """One gain inside each interval into which the gains divide (0, last gain)."""
    return 0.5 * (gains + np.concatenate([[0.0], gains[:-1]]))


def _eigenvalues(matrix: Floats) -> Complexes:
    return np.linalg.eigvals(matrix).astype(np.complex128)


def _stable(matrix: Floats) -> bool:
    """Tell whether no eigenvalue is outside the circle by more than rounding."""
    return bool(np.abs(_eigenvalues(matrix)).max() < 1.0 + ROUNDING)


def _height(loop: Loop, damping: float) -> float:
    return _critical(loop, damping).stiffness or 0.0


def _stable_dampings(loop: Loop) -> list[tuple[float, float]]:
    start = loop.without_drift() if loop.free else loop
    found = crossings(start.transition, start.entry, start.velocity)
    stable = [_stable(start.damped(damping)) for damping in _between(found.gains)]
    return _joined(found.gains, stable)


def _joined(gains: Floats, stable: list[bool]) -> list[tuple[float, float]]:
    """Join neighbouring stable intervals; stable: whether each of (0, g1), (g1, g2), ... is."""
    bands: list[tuple[float, float]] = []
    edges = [0.0, *gains.tolist()]
    for low, high, inside in zip(edges, edges[1:], stable, strict=False):
        if inside and bands and bands[-1][1] == low:
            bands[-1] = (bands[-1][0], high)
        elif inside:
            bands.append((low, high))
    return bands


def _meeting(loop: Loop, low: float, high: float) -> Corner | None:
    """Bisect [low, high] for the corner where the critical branch changes."""
    left, right = _critical(loop, low), _critical(loop, high)
    while _apart(left, right) and right.damping - left.damping > 2.0 * np.spacing(high):
        middle = _critical(loop, 0.5 * (left.damping + right.damping))
        if _apart(left, middle):
            right = middle
        else:
            left = middle
    above = right if right.stable else left
    top = max(left, above, key=lambda point: point.stiffness or 0.0)
    below = left if left.stable else above
    if top.stiffness is None or below.frequency_hz is None or above.frequency_hz is None:
        return None
    return Corner(top.damping, top.stiffness, below.frequency_hz, above.frequency_hz)


def _apart(left: LinearPoint, right: LinearPoint) -> bool:
    """Tell whether two neighbouring points of the boundary lie on different branches."""
    if left.frequency_hz is None or right.frequency_hz is None:
        return left.stable != right.stable
    return abs(left.frequency_hz - right.frequency_hz) > JUMP * left.frequency_hz

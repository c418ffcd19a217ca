"""The closed loop of a device with several rates, as the map of the state over one cycle.

The state is that of `sim/loop.py` and, in this order, the readings: the position y^ that the law
uses, the reading y* of the last velocity estimate (or the memory of another estimator), the
estimate v, and its filter's slope r. Before each tick's command a linear map M of the state renews
the readings that are due at this tick. Then u = -(K y^ + B v), and P moves the chain over one tick:

    s_{k+1} = (P - b (K c_y + B c_v)) M_k s_k.

M_k repeats after N ticks, the least common multiple of `position_ticks` and `velocity_ticks`, and
the loop is stable iff all eigenvalues of the product over N ticks lie inside the unit circle.
(Lifting; P. Voulgaris and B. Bamieh, Systems & Control Letters 20, 249, 1993.) K enters the product
in many places and not as a rank-one change, so the end of its stable interval is found by a scan
with the ratio `RATIO` between neighbouring K, and then by Brent's method on the spectral radius.

Limits: a band of instability narrower than the scan's ratio can be stepped over.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from zwidth.sim.device import Device
from zwidth.sim.estimators import Linear
from zwidth.sim.interface import DIFFERENCE_ALONE, Interface
from zwidth.sim.loop import linear_estimator, open_loop
from zwidth.stability.types import Corner, LinearPoint

Floats = NDArray[np.float64]
RATIO = 1.05
LOWEST = 1e-8  # of 4 m / T^2, above which no sampled wall is stable with the whole mass m
CORNER_GRID = 40


@dataclass(frozen=True)
class PeriodicLoop:
    """One cycle of ticks of a device and a two-sided wall.

    moves (M, M): P; entry (M,): b; measure (N, M, M): M_k; places: of y^ and v in the state; period
    [s]: of the cycle; free: the device has no spring to ground.
    """

    moves: Floats
    entry: Floats
    measure: Floats
    position: int
    velocity: int
    period: float
    free: bool

    def tick(self, stiffness: float | Floats, damping: float) -> Floats:
        """Return the map of the measured state over one tick, shape (..., M, M) for K (...)."""
        k = np.asarray(stiffness)[..., None]
        moves = np.broadcast_to(self.moves, (*k.shape[:-1], *self.moves.shape)).copy()
        moves[..., self.position] -= k * self.entry
        moves[..., self.velocity] -= damping * self.entry
        return moves

    def closed(self, stiffness: float | Floats, damping: float) -> Floats:
        """Return the map of the state over a cycle with spring and damper, (..., M, M)."""
        tick = self.tick(stiffness, damping)
        return reduce(lambda whole, m: tick @ (m @ whole), self.measure, np.eye(self.entry.size))

    def radii(self, stiffness: Floats, damping: float) -> Floats:
        """Return the spectral radius of a cycle, less one, at each K."""
        return np.abs(np.linalg.eigvals(self.closed(stiffness, damping))).max(axis=-1) - 1.0

    def radius(self, stiffness: float, damping: float) -> float:
        """Return the spectral radius of a cycle, less one."""
        return float(self.radii(np.array(stiffness), damping))


def periodic_loop(device: Device) -> PeriodicLoop:
    """Return the cycle of a device; raises ValueError as `open_loop` does for a long delay."""
    face = device.interface
    plain = open_loop(device.with_interface(**ONE_RATE))
    n = plain.entry.size - 1  # without the stored reading
    estimator = linear_estimator(face)
    more = 3 + estimator.rest.size
    moves = np.eye(n + more)
    moves[:n, :n] = plain.transition[:n, :n]
    entry = np.append(plain.entry[:n], np.zeros(more))
    cycle = math.lcm(int(face.position_ticks), int(face.velocity_ticks))
    measure = np.array([_measured(face, estimator, n, k) for k in range(cycle)])
    return PeriodicLoop(moves, entry, measure, n, n + more - 2, cycle * face.period, plain.free)


ONE_RATE = {
    "velocity_ticks": 1, "position_ticks": 1, "velocity_cutoff_hz": math.inf, "velocity_order": 1,
    **DIFFERENCE_ALONE,
}  # fmt: skip


def _measured(face: Interface, estimator: Linear, n: int, tick: int) -> Floats:
    """Return M of a tick: it renews those of y^, y*, v and r that are due at this tick."""
    straight, from_slope, to_slope, kept = face.velocity_filter
    given, v = n, n + 1 + estimator.rest.size
    kept_there, slope = slice(n + 1, v), v + 1
    m = np.eye(slope + 1)
    if tick % face.position_ticks == 0:
        m[given] = 0.0
        m[given, 0] = 1.0
    if tick % face.velocity_ticks == 0:
        rate = 1.0 / face.velocity_period
        m[[v, slope]] = 0.0
        for row, weight in ((v, straight), (slope, to_slope)):
            m[row, 0], m[row, v] = weight * estimator.through * rate, -weight
            m[row, kept_there] = weight * estimator.out * rate
        m[v, v] += 1.0
        m[v, slope], m[slope, slope] = from_slope, kept
        m[kept_there, :] = 0.0
        m[kept_there, kept_there] = estimator.keep
        m[kept_there, 0] = estimator.take
    return m


def periodic_boundary(device: Device, dampings: Iterable[float]) -> list[LinearPoint]:
    """Return the critical stiffness of a device with several rates at each B.

    Raises ValueError for a damping that is not finite.
    """
    loop = periodic_loop(device)
    return [_critical(device, loop, damping) for damping in dampings]


def periodic_last_damping(device: Device) -> float | None:
    """Return the B above which every small K is unstable; None if small K is unstable at B = 0."""
    loop, scan = periodic_loop(device), _scan(device)
    low = float(scan[0])
    if loop.radius(low, 0.0) >= 0.0:
        return None
    b = 0.0
    for more in (scan * device.interface.period).tolist():
        if loop.radius(low, more) >= 0.0:
            return float(brentq(lambda x: loop.radius(low, x), b, more))
        b = more
    return b


def periodic_corner(device: Device) -> Corner | None:
    """Return the highest point of the boundary for B from 0 to the last stable B, or None.

    None: no K is stable. The search begins on a grid of `CORNER_GRID` dampings.
    """
    last = periodic_last_damping(device)
    if last is None:
        return None
    loop = periodic_loop(device)
    grid = np.linspace(0.0, last, CORNER_GRID)
    heights = [_critical(device, loop, b).stiffness or 0.0 for b in grid.tolist()]
    top = int(np.argmax(heights))
    step = grid[1] - grid[0]
    peak = minimize_scalar(
        lambda b: -(_critical(device, loop, float(b)).stiffness or 0.0),
        bounds=(max(grid[top] - step, 0.0), min(grid[top] + step, last)),
        method="bounded",
        options={"xatol": 1e-4 * last},
    )
    best = max(float(peak.x), 0.0) if -peak.fun > heights[top] else float(grid[top])
    sides = [_critical(device, loop, b) for b in (best - 1e-3 * last, best, best + 1e-3 * last)]
    below, at, above = sides
    if at.stiffness is None or at.frequency_hz is None:
        return None
    return Corner(
        best, at.stiffness, below.frequency_hz or at.frequency_hz,
        above.frequency_hz or at.frequency_hz,
    )  # fmt: skip


def _scan(device: Device) -> Floats:
    """Return the K of the scan [N m/rad | N/m], rising."""
    scale = 4.0 * float(device.chain.masses.sum()) / device.interface.period**2
    return scale * RATIO ** np.arange(math.log(LOWEST) / math.log(RATIO), 1.0)


def _critical(device: Device, loop: PeriodicLoop, damping: float) -> LinearPoint:
    if not np.isfinite(damping):
        raise ValueError(f"damping is {damping}; only finite numbers are allowed")
    scan = _scan(device)
    outside = loop.radii(scan, damping) >= 0.0
    first = int(np.argmax(outside))
    if not outside.any() or first == 0:
        return LinearPoint(damping, None, None, None)
    low, high = float(scan[first - 1]), float(scan[first])
    end = float(brentq(lambda x: loop.radius(x, damping), low, high, xtol=1e-12 * low))
    step = 1e-4
    rise = (loop.radius(end * (1.0 + step), damping) - loop.radius(end * (1.0 - step), damping)) / (
        2.0 * step * end * loop.period
    )
    return LinearPoint(damping, end, _frequency(loop, end, damping), rise)


def _frequency(loop: PeriodicLoop, stiffness: float, damping: float) -> float:
    """Frequency [Hz] of the critical oscillation; the eigenvalue of a cycle shows only its alias.

    The alias is resolved by following the eigenvector through the cycle and summing the phase by
    which m1's velocity turns from tick to tick.
    """
    values, vectors = np.linalg.eig(loop.closed(stiffness, damping))
    state = vectors[:, int(np.argmax(np.abs(values)))].astype(np.complex128)
    tick = loop.tick(stiffness, damping)
    turned = 0.0
    for m in loop.measure:
        after = tick @ m @ state
        turned += float(np.angle(after[0] / state[0]))
        state = after
    return abs(turned) / (2.0 * np.pi * loop.period)

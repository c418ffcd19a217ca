"""The passive walls: (K, B) that stay stable in contact with any passive hand.

Colgate and Schenkel (J. Robotic Systems 14, 37, 1997): a rigid device of damping b rendering H(z),
H = K + B w(z), is passive iff at every frequency

    b > Re[H (1 - 1/z)] T / (2 (1 - cos wT)),    z = exp(j wT).

The hand adds any passive impedance Z, so at each alias w_n = w + 2 pi n/T the admittance
1/(Z + b) is any point of the disc of diameter [0, 1/b]. The sampled loop gain is then any point of
a disc of radius S about D, both times (1 - 1/z)/(2 b),

    D = (1/T) sum exp(-j w_n t_d)/w_n^2,    S = (1/T) sum 1/w_n^2 = T/(2 (1 - cos wT)),

and 1 must stay outside H times that disc. A delay of d T shifts all aliases alike; a remainder r
does not, so |D| < S, and the condition becomes, with u = (1 - 1/z) D,

    b^2 - b Re(H u) - |H|^2 r (T - r)/4 > 0,    u = -z^{-d-1} (T - r + r/z)/(1 - 1/z),

where Re u = (T - r) s_d + r s_{d+1}, s_n = sin((n + 1/2) wT)/(2 sin(wT/2)). For each frequency this
allows one interval of K; the passive walls are their intersection. With B = 0 and whole delays it
is b > K (T/2 + t_d), without delay b > K T/2 + |B|.

Limits: the device is one rigid mass at the hand, of all its dampers to ground; its springs and
masses count as part of the hand. No lag of the amplifier.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.stability.types import PassivePoint
from zwidth.stability.velocity import filter_response, refuse_force

Floats = NDArray[np.float64]
POINTS_PER_TICK = 64
HILL = 17  # dampings of the first grid in the search for the largest passive K


class Band(NamedTuple):
    """K that the condition allows at each angle wT: from low to high, none if low > high."""

    low: Floats
    high: Floats


def passive_boundary(device: Device, dampings: Iterable[float]) -> list[PassivePoint]:
    """Return the passive stiffness at each virtual damping B [N m s/rad | N s/m].

    Raises ValueError for a B that is not finite, or a device whose amplifier lags.
    """
    if device.plant().lag > 0.0:
        raise ValueError(
            "actuator_lag is set, which the passivity criterion cannot take: remove it, or add its"
            " time_constant to delay_s"
        )
    if device.interface.multirate:
        raise ValueError(
            "velocity_ticks or position_ticks is more than 1, but the passivity criterion takes"
            " only one rate: set both to 1"
        )
    if device.reading().followers.size:
        raise ValueError(
            "readings are filtered, which the passivity criterion cannot take: remove sensor_lag,"
            " sensor_filter and moving_average, or add their delay to delay_s"
        )
    refuse_force(device, "the passivity criterion")
    b = float(device.chain.ground_dampers.sum())
    return [_passive(device.interface, b, damping) for damping in dampings]


def passive_stiffness(device: Device, damping: float) -> PassivePoint:
    """Return the passive stiffness at one virtual damping; see `passive_boundary`."""
    return passive_boundary(device, [damping])[0]


def stiffest_passive(device: Device) -> PassivePoint | None:
    """Return the stiffest passive wall over all dampings >= 0; None if no wall is passive.

    At each frequency the condition above is a concave quadratic in (K, B), so the passive walls are
    a convex set, and the largest passive K has a single maximum over B; no wall is passive beyond B
    = sum b_i.

    Raises as `passive_boundary`.
    """
    grid = np.linspace(0.0, max(float(device.chain.ground_dampers.sum()), 0.0), HILL)
    coarse = [p.stiffness or 0.0 for p in passive_boundary(device, grid.tolist())]
    best = int(np.argmax(coarse))
    if coarse[best] == 0.0:
        return None
    top = minimize_scalar(
        lambda damping: -(passive_stiffness(device, damping).stiffness or 0.0),
        bounds=(grid[max(best - 1, 0)], grid[min(best + 1, HILL - 1)]),
        method="bounded",
        options={"xatol": 1e-5 * grid[1]},
    )
    found = [passive_stiffness(device, b) for b in (float(grid[best]), float(top.x))]
    return max(found, key=lambda p: p.stiffness or 0.0)


def _passive(interface: Interface, b: float, damping: float) -> PassivePoint:
    if not np.isfinite(damping):
        raise ValueError(f"damping is {damping}; only finite numbers are allowed")
    if b <= 0.0:
        return PassivePoint(damping, None, None)
    # Everything is a trigonometric polynomial of degree d + 2 in wT, times the smooth filter.
    whole, _ = interface.delay_ticks
    angles = np.linspace(0.0, np.pi, POINTS_PER_TICK * (whole + 2) + 1)
    band = allowed(interface, b, damping, angles)
    low, _ = _refined(interface, b, damping, angles, -band.low, upper=False)
    high, angle = _refined(interface, b, damping, angles, band.high, upper=True)
    if not max(-low, 0.0) < high:
        return PassivePoint(damping, None, None)
    return PassivePoint(damping, high, angle / (2.0 * np.pi * interface.period))


def allowed(interface: Interface, b: float, damping: float, angles: Floats) -> Band:
    """Return the interval of K that the condition allows at each angle wT in [0, pi]."""
    whole, r = interface.delay_ticks
    period = interface.period
    behind = np.exp(-1j * angles)
    u = (period - r) * _kernel(whole, angles) + r * _kernel(whole + 1, angles)
    filtered = filter_response(interface, np.exp(1j * angles)) / period
    w = filtered * (1.0 - behind)
    wu = -filtered * behind ** (whole + 1) * (period - r + r * behind)
    # -square K^2 - linear K + constant > 0
    square = np.full_like(angles, 0.25 * r * (period - r))
    linear = b * u + 2.0 * square * damping * w.real
    constant = b * b - b * damping * wu.real - square * (damping * np.abs(w)) ** 2
    return _between_roots(square, linear, constant)


def _between_roots(square: Floats, linear: Floats, constant: Floats) -> Band:
    """Return the interval of K in which -square K^2 - linear K + constant > 0, for square >= 0."""
    discriminant = linear**2 + 4.0 * square * constant
    root = np.sqrt(np.maximum(discriminant, 0.0))
    # The root of smaller magnitude, without cancellation; the other grows as 1/square.
    q = -0.5 * (linear + np.where(linear >= 0.0, root, -root))
    with np.errstate(divide="ignore", invalid="ignore"):
        near = np.where(q == 0.0, np.inf, -constant / q)
        far = np.where(square > 0.0, q / square, -np.inf * np.where(linear >= 0.0, 1.0, -1.0))
    empty = (discriminant < 0.0) | ((square == 0.0) & (linear == 0.0) & (constant <= 0.0))
    low = np.where(linear >= 0.0, far, near)
    high = np.where(linear >= 0.0, near, far)
    return Band(np.where(empty, np.inf, low), np.where(empty, -np.inf, high))


def _kernel(n: int, angles: Floats) -> Floats:
    """sin((n + 1/2) x)/(2 sin(x/2)), n + 1/2 at x = 0."""
    half = np.sin(0.5 * angles)
    numerator = 0.5 * np.sin((n + 0.5) * angles)
    return np.divide(numerator, half, out=np.full_like(angles, n + 0.5), where=half != 0.0)


def _refined(
    interface: Interface, b: float, damping: float, angles: Floats, values: Floats, upper: bool
) -> tuple[float, float]:
    """Return the least value (high, or -low) over all angles, and its angle."""
    i = int(np.argmin(values))
    best = float(values[i]), float(angles[i])
    if not np.isfinite(best[0]):
        return best

    def value(angle: float) -> float:
        band = allowed(interface, b, damping, np.array([angle]))
        return float(band.high[0] if upper else -band.low[0])

    bounds = float(angles[max(i - 1, 0)]), float(angles[min(i + 1, angles.size - 1)])
    found = minimize_scalar(value, bounds=bounds, method="bounded", options={"xatol": 1e-10})
    return min(best, (float(found.fun), float(found.x)))

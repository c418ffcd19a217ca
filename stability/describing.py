"""What describing functions say of limit cycles: the first harmonic of each nonlinearity.

Friction at m1, f = -f_c sign(v), on an oscillation of amplitude A and frequency w: its first harmonic
is that of a damper b_f = 4 f_c / (pi A w). The loop with that damper added to b1 is marginal at some
K: there A is an unstable cycle. Starts below it come to rest, starts above it grow.

A quantiser of step D in the encoder passes the first harmonic of an amplitude A with the gain
N(A) = (4 D / (pi A)) sum_i sqrt(1 - ((2 i - 1) D / (2 A))^2), which is 0 up to D/2 and never above
4/pi. It scales position and velocity alike, so cycles are possible where (N K, N B) is on the linear
boundary for some N <= 4/pi.

A saturation at u_max passes a command of amplitude U with N(U) = (2/pi)(asin r + r sqrt(1 - r^2)),
r = u_max/U, from 1 down to 0. Beyond the boundary (N K, N B) comes back to it for a smaller N:
there the growth ends in a stable cycle.

Gelb & Vander Velde, Multiple-Input Describing Functions, 1968. Limits: the loop must filter the
higher harmonics, which the rigid body does and a mode near three times w does not; friction between
sampled instants is taken as continuous.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from sim.device import Device
from stability.linear import critical_stiffness
from stability.types import LinearPoint

QUANTISER_TOP = 4.0 / math.pi


class PredictedCycle(NamedTuple):
    """A limit cycle by describing function: gain N, amplitude (of what is named), frequency [Hz]."""

    gain: float
    amplitude: float
    frequency_hz: float


def friction_damper(device: Device, extra: float) -> Device:
    """Return the device with a damper added between m1 and ground."""
    dampers = device.chain.ground_dampers.copy()
    dampers[0] += extra
    return device.with_chain(device.chain._replace(ground_dampers=dampers))


def friction_boundary(
    device: Device, level: float, damping: float, amplitude: float
) -> LinearPoint | None:
    """Return the boundary that a start of this amplitude meets with friction `level` at m1.

    None where no K is stable. Raises ValueError for a level < 0 or an amplitude <= 0.
    """
    if not level >= 0.0 or not amplitude > 0.0:
        raise ValueError(
            f"level is {level}, amplitude is {amplitude}; a level >= 0 and an amplitude > 0 are needed"
        )
    share = 4.0 * level / (math.pi * amplitude)

    def excess(extra: float) -> float:
        point = critical_stiffness(friction_damper(device, extra), damping)
        if point.frequency_hz is None:
            return math.nan
        return extra - share / (2.0 * math.pi * point.frequency_hz)

    low, high = excess(0.0), share / (2.0 * math.pi * 0.5)
    if math.isnan(low) or level == 0.0:
        point = critical_stiffness(device, damping)
        return point if point.stable else None
    grid = np.geomspace(1e-6 * high, high, 60)
    values = [excess(x) for x in grid]
    for a, b, fa, fb in zip(grid, grid[1:], values, values[1:], strict=False):
        if fa <= 0.0 <= fb:
            root = float(brentq(excess, a, b, xtol=1e-9 * high))  # pyright: ignore[reportArgumentType]
            return critical_stiffness(friction_damper(device, root), damping)
    return None


def quantiser_gain(amplitude: float, step: float) -> float:
    """Return N(A) of a rounding quantiser."""
    count = math.floor(amplitude / step + 0.5)
    levels = (np.arange(1, count + 1) - 0.5) * step / amplitude
    return float(4.0 * step / (math.pi * amplitude) * np.sqrt(1.0 - levels * levels).sum())


def quantiser_boundary(device: Device, damping: float) -> float | None:
    """Return the K above which an encoder step, of any size, can sustain a cycle; None: no K > 0."""
    gains = np.linspace(0.02, QUANTISER_TOP, 64)
    points = [critical_stiffness(device, float(n) * damping).stiffness for n in gains]
    if any(k is None for k in points):
        return None
    return float(min(k / n for k, n in zip(points, gains, strict=True) if k is not None))


def saturation_gain(amplitude: float, limit: float) -> float:
    """Return N(U) of a saturation."""
    if amplitude <= limit:
        return 1.0
    r = limit / amplitude
    return 2.0 / math.pi * (math.asin(r) + r * math.sqrt(1.0 - r * r))


def saturation_cycle(device: Device, stiffness: float, damping: float) -> PredictedCycle | None:
    """Return the cycle in which growth ends at the device's command limit.

    amplitude: of the command before the limit [N m | N]. None where the wall is stable, or where no
    smaller gain is (the growth has no end).
    """

    def beyond(gain: float) -> float:
        critical = critical_stiffness(device, gain * damping).stiffness
        return -1.0 if critical is None else critical - gain * stiffness

    if beyond(1.0) >= 0.0:
        return None
    grid = np.geomspace(1.0, 1e-4, 120)
    for above, below in zip(grid, grid[1:], strict=False):
        if beyond(float(below)) >= 0.0:
            gain = float(brentq(beyond, float(below), float(above), xtol=1e-10))  # pyright: ignore
            point = critical_stiffness(device, gain * damping)
            limit = device.interface.command_limit
            ratio = float(brentq(lambda r: saturation_gain(r, 1.0) - gain, 1.0, 4.0 / gain))  # pyright: ignore
            return PredictedCycle(gain, ratio * limit, point.frequency_hz or math.nan)
    return None

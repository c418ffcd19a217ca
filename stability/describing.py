"""Limit cycles predicted by describing functions: the first harmonic of each nonlinearity.

For an oscillation of amplitude A and frequency w, friction at m1, f = -f_c sign(v), has the first
harmonic of a damper b_f = 4 f_c / (pi A w). The loop with this damper added to b1 is marginal at
some K: at that K, A is the amplitude of an unstable cycle. Starts below it come to rest, starts
above grow.

A quantiser of step D in the encoder passes the first harmonic of an amplitude A with the gain
N(A) = (4 D / (pi A)) sum_i sqrt(1 - ((2 i - 1) D / (2 A))^2), which is 0 up to D/2 and never above
4/pi. It scales position and velocity alike, so cycles are possible where (N K, N B) is on the
linear boundary for some N <= 4/pi.

A saturation at u_max passes a command of amplitude U with N(U) = (2/pi)(asin r + r sqrt(1 - r^2)),
r = u_max/U, from 1 down to 0. If (K, B) is beyond the boundary, (N K, N B) returns to it for a
smaller N: there the growth ends in a stable cycle.

Gelb & Vander Velde, Multiple-Input Describing Functions, 1968. Limits: the loop must filter out the
higher harmonics, which the rigid body does and a mode near three times w does not; friction is
treated as continuous between sampled instants. A virtual damper on a quantised position commands
pulses, far from harmonic: with B > 0, cycles of half a step exist far below the predicted line.
"""

import cmath
import itertools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from zwidth.sim.device import Device
from zwidth.stability.linear import boundary, critical_stiffness
from zwidth.stability.types import LinearPoint

Floats = NDArray[np.float64]
QUANTISER_TOP = 4.0 / math.pi
SLOWEST_HZ = 0.1  # lowest frequency at which a cycle with friction is sought
NEAR = 1e-4  # relative tolerance of the damper equivalent to friction
FEW, MANY = 9, 97  # dampings of a grid: for one boundary, and for a line of boundaries


class PredictedCycle(NamedTuple):
    """A predicted limit cycle: gain N, amplitudes of command and of m1, frequency [Hz]."""

    gain: float
    command: float
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
    """Return the boundary for a start of this amplitude with Coulomb friction `level` at m1.

    None if no K is stable. Raises ValueError for a level < 0 or an amplitude <= 0.
    """
    if not level >= 0.0 or not amplitude > 0.0:
        raise ValueError(
            f"level is {level}, amplitude is {amplitude};"
            " a level >= 0 and an amplitude > 0 are needed"
        )
    share = 4.0 * level / (math.pi * amplitude)
    if share == 0.0:
        point = critical_stiffness(device, damping)
        return point if point.stable else None

    def excess(log_extra: float) -> float:
        extra = math.exp(log_extra)
        frequency = critical_stiffness(friction_damper(device, extra), damping).frequency_hz
        return -1.0 if frequency is None else math.log(2.0 * math.pi * frequency * extra / share)

    slowest, fastest = SLOWEST_HZ, 0.5 / device.interface.period
    low, high = (math.log(share / (2.0 * math.pi * f)) for f in (fastest, slowest))
    if excess(high) < 0.0:
        return None
    root = _root(excess, low, high, NEAR)
    point = critical_stiffness(friction_damper(device, math.exp(root + NEAR)), damping)
    return point if point.stable else None


def quantiser_boundaries(device: Device, dampings: Floats) -> Floats:
    """Return, for each B, the K above which an encoder step of any size can sustain a cycle.

    dampings (n,); NaN where no K > 0 is free of cycles. This K is the least K_CR(N B) / N over all
    gains N, with K_CR interpolated linearly on a grid of B.
    """
    top = QUANTISER_TOP * float(dampings.max())
    count = 2 if top == 0.0 else FEW if dampings.size == 1 else MANY
    grid = np.linspace(0.0, top, count)
    found = [point.stiffness for point in boundary(device, grid)]
    critical = np.array([math.nan if k is None else k for k in found])
    gains = np.linspace(0.1, QUANTISER_TOP, 4 * FEW)
    spread = np.interp(np.outer(dampings, gains).ravel(), grid, critical).reshape(-1, gains.size)
    return (spread / gains).min(axis=1)


def saturation_gain(amplitude: float, limit: float) -> float:
    """Return N(U) of a saturation."""
    if amplitude <= limit:
        return 1.0
    r = limit / amplitude
    return 2.0 / math.pi * (math.asin(r) + r * math.sqrt(1.0 - r * r))


def saturation_cycle(device: Device, stiffness: float, damping: float) -> PredictedCycle | None:
    """Return the cycle in which growth ends at the device's command limit.

    command: before the limit [N m | N]. None if the wall is stable, or unstable at every smaller
    gain too (the growth has no end).
    """

    def beyond(gain: float) -> float:
        critical = critical_stiffness(device, gain * damping).stiffness
        return -1.0 if critical is None else critical - gain * stiffness

    if beyond(1.0) >= 0.0:
        return None
    grid = np.geomspace(1.0, 1e-4, 4 * FEW).tolist()
    ends = next(((a, b) for a, b in itertools.pairwise(grid) if beyond(b) >= 0.0), None)
    if ends is None:
        return None
    gain = _root(beyond, ends[1], ends[0], 1e-10)
    ratio = _root(lambda r: saturation_gain(r, 1.0) - gain, 1.0, 4.0 / gain, 1e-10)
    frequency = critical_stiffness(device, gain * damping).frequency_hz
    if frequency is None:
        return None
    command = ratio * device.interface.command_limit
    back = cmath.exp(-2j * math.pi * frequency * device.interface.period)
    law = stiffness + damping * (1.0 - back) / device.interface.period
    return PredictedCycle(gain, command, command / abs(law), frequency)


def _root(function: Callable[[float], float], low: float, high: float, within: float) -> float:
    return float(brentq(function, low, high, xtol=within))  # pyright: ignore[reportArgumentType]

"""What a device stands on, where it was recorded to move: its acceleration over each tick.

Positions are counted from the base, as the encoders of a device on it count them. In them every
mass feels - m a besides all other forces, a the acceleration of the base, exactly. The kernel holds
a over a tick, at its mean there,

    acceleration    (a_k + a_(k+1)) / 2, to second order in the tick
    velocity        (v_(k+1) - v_k) / T, exactly
    position        the same of the slopes of the cubic spline through it: what noise it has
                    comes out 1 / T^2 as large, and is smoothed by the device's own inertia alone
"""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
BASE = ("base_acceleration", "base_velocity", "base_position")


def base_of(trace: Trace, period: float, name: str) -> tuple[Floats | None, tuple[str, ...]]:
    """Return the acceleration (ticks,) of the base, None where none was recorded, and a note."""
    channel = next((c for c in BASE if c in trace.channels), None)
    if channel is None:
        return None, ()
    moved = held(trace[channel], channel.removeprefix("base_"), period)
    said = (
        f"the base of {name} moves, {float(np.std(moved)):.3g} {trace.units[channel].split('/')[0]}"
        f"/s2 rms from its recorded {channel.removeprefix('base_')}: positions are taken as counted"
        " from it"
    )
    return moved, (said,)


def held(values: Floats, quantity: str, period: float) -> Floats:
    """Return the mean acceleration over each tick (ticks,), the last as the one before."""
    if quantity == "acceleration":
        means = 0.5 * (values[1:] + values[:-1])
    else:
        speeds = values
        if quantity == "position":
            t = period * np.arange(values.size)
            speeds = np.asarray(CubicSpline(t, values).derivative()(t), dtype=np.float64)
        means = np.diff(speeds) / period
    return np.append(means, means[-1])

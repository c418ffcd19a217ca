"""Recorded inputs other than the command: motion of the base, and measured forces.

Positions are relative to the base, as encoders of a device on it measure them. In these coordinates
exactly - m a acts on every mass besides all other forces, where a is the acceleration of the base.
The kernel holds a over a tick, at its mean,

    acceleration    (a_k + a_(k+1)) / 2, to second order in the tick
    velocity        (v_(k+1) - v_k) / T, exactly
    position        the same for the slopes of the cubic spline through it: its noise
                    grows by 1 / T^2, and only the device's own inertia smooths it

and likewise a force that was measured where it acts, such as that of a hand on a handle. Such a
force is not predicted; the error of its sensor is a disturbance.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from zwidth.logs.recording_file import KNOWN_FORCE
from zwidth.sim.place import MASSES
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
BASE = ("base_acceleration", "base_velocity", "base_position")
KNOWN_FORCES = tuple(f"{KNOWN_FORCE}{mass}" for mass in MASSES)
OUTSIDE = (*BASE, *KNOWN_FORCES)


def base_of(trace: Trace, period: float, name: str) -> tuple[Floats | None, tuple[str, ...]]:
    """Return the acceleration (ticks,) of the base, None if not recorded, and a note."""
    channel = next((c for c in BASE if c in trace.channels), None)
    if channel is None:
        return None, ()
    quantity = channel.removeprefix("base_")
    moved = held(trace[channel], quantity, period)
    unit = trace.units[channel].split("/")[0]
    said = (
        f"the base of {name} moves, by {float(np.std(moved)):.3g} {unit}/s2 rms of its recorded"
        f" {quantity}: positions are taken as counted from it"
    )
    return moved, (said,)


def pushes_of(trace: Trace, masses: int, name: str) -> tuple[Floats | None, tuple[str, ...]]:
    """Return known forces (ticks, masses), None if there are none, and a note.

    They act on the masses beside the command, without its gain, limit and delay.
    """
    there = [c for c in KNOWN_FORCES if c in trace.channels]
    if not there:
        return None, ()
    found = np.zeros((len(trace), masses))
    for channel in there:
        found[:, KNOWN_FORCES.index(channel)] = held(trace[channel], "force", 1.0)
    sizes = [
        f"{float(np.std(trace[c])):.3g} {trace.units[c]} at {c.removeprefix(KNOWN_FORCE)}"
        for c in there
    ]
    said = f"{name} has a force besides its command, which acts in all runs"
    return found, (f"{said} (rms about its mean: {', '.join(sizes)})",)


def held(values: Floats, quantity: str, period: float) -> Floats:
    """Return the mean acceleration, or force, over each tick (ticks,), the last one repeated."""
    if quantity in ("acceleration", "force"):
        means = 0.5 * (values[1:] + values[:-1])
    else:
        speeds = values
        if quantity == "position":
            t = period * np.arange(values.size)
            speeds = np.asarray(CubicSpline(t, values).derivative()(t), dtype=np.float64)
        means = np.diff(speeds) / period
    return np.append(means, means[-1])

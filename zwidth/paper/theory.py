"""Linear theory for several sections: the device, its delays, boundaries as arrays."""

import numpy as np
from numpy.typing import NDArray

from zwidth.figures.style import DARK
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.stability.linear import boundary, corner, last_stable_damping

Floats = NDArray[np.float64]
DELAYS = (0.002, 0.004, 0.008)
COLOUR = dict(zip(DELAYS, DARK, strict=True))
SHAPE = {0.002: "o", 0.004: "s", 0.008: "^"}
POINTS = 240


def phantom(delay: float) -> Device:
    """Return the paper's device at a delay [s]."""
    return load_device("phantom_1_0").with_interface(delay=delay)


def lines(device: Device, count: int = POINTS) -> tuple[Floats, Floats, Floats]:
    """Return (B, K_CR, f) over all stable dampings, closed at K = 0, each (n,)."""
    last, top = last_stable_damping(device) or 0.0, corner(device)
    dampings = np.linspace(0.0, last * (1.0 - 1e-6), count)
    if top is not None:
        dampings = np.union1d(dampings, top.damping)
    points = boundary(device, dampings)
    stiffness = [np.nan if p.stiffness is None else p.stiffness for p in points]
    frequency = [np.nan if p.frequency_hz is None else p.frequency_hz for p in points]
    return (
        np.append(dampings, last),
        np.append(stiffness, 0.0),
        np.append(frequency, frequency[-1]),
    )


def ms(delay: float) -> str:
    """Return a delay in words."""
    return f"{1e3 * delay:g} ms"

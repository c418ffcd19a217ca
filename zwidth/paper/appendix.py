"""The paper's own program (Appendix I), corrected: it gives the curves in Fig. 6.

    G0 = 856 / (s^2 + 5 s), G1 = 2296 (s^2 + 80 s + 174400) / (1744 (s^2 + 83 s + 229600)),
    G2 = 13440 (s^2 + 90 s + 298800) / (2988 (s^2 + 352 s + 1344000))

Rounded coefficients, B in steps of 0.001, K_CR the gain margin of eq. (4). Its `margin` line lacks
parentheses: read literally, the damper is outside the loop and K(0.03) is 2.43. A gain margin is
the least K > 0 at which any eigenvalue meets the unit circle, whether or not the loop below it is
stable, so it also prints numbers beyond the last stable B. It is computed from the closed form on
the unit circle (`stability/decomposition.py`), independently of zwidth's eigenvalues.
"""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.modal import ModalModel, Mode
from zwidth.stability.decomposition import curve

Floats = NDArray[np.float64]
STEP = 0.001
ROUNDED = ModalModel(
    1.0 / 856.0,
    5.0 / 856.0,
    (
        Mode(math.sqrt(229600.0), 83.0, math.sqrt(174400.0), 80.0),
        Mode(math.sqrt(1344000.0), 352.0, math.sqrt(298800.0), 90.0),
    ),
)


@dataclass(frozen=True)
class Printed:
    """The curves of the paper's program: damping, gain margin and its frequency [Hz], each (n,)."""

    damping: Floats
    stiffness: Floats
    frequency_hz: Floats


@cache
def appendix(delay: float, last: float) -> Printed:
    """Run the paper's program at a delay [s], for B from 0 in its steps while B <= last."""
    device = load_device("phantom_1_0").with_interface(delay=delay).with_modal(ROUNDED)
    dampings = STEP * np.arange(math.floor(last / STEP + 1e-9) + 1, dtype=np.float64)
    grid = np.linspace(0.05, 499.9, 6000)
    known = curve(device, grid).damping
    margins = [gain_margin(device, float(b), grid, known) for b in dampings]
    return Printed(dampings, np.array([k for k, _ in margins]), np.array([f for _, f in margins]))


def gain_margin(device: Device, damping: float, grid: Floats, known: Floats) -> tuple[float, float]:
    """Return the least K > 0 with an oscillation, and its frequency [Hz]; NaN without one.

    known (n,): the damping of the closed form at frequencies grid (n,), which brackets the roots.
    """
    found = known - damping
    best = (math.nan, math.nan)
    for i in np.flatnonzero(np.sign(found[1:]) != np.sign(found[:-1])):
        root = float(
            brentq(  # pyright: ignore[reportArgumentType]
                lambda f: float(curve(device, f).damping) - damping, grid[i], grid[i + 1]
            )
        )
        at = curve(device, root)
        k = float(at.stiffness)
        if k > 1e-6 and abs(float(at.damping) - damping) < 1e-6:  # a root, not a pole
            best = min(best, (k, root)) if best[0] == best[0] else (k, root)
    return best

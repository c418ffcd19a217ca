"""What a quantiser does by itself, and what is growth: the one place that says so.

A step of the encoder or of the command is an error e of at most half a step, |e| <= D/2, added to
what is read. On a loop that is stable without it, such an error can keep an oscillation up but not
let it grow: that is dither. How large it may be, in first harmonics (describing function):

    y = -T_c e,  T_c = L / (1 + L),   |e|_1 <= (4/pi) D/2,   so   A <= (2/pi) D max_w |T_c(w)|

the last because no signal within +-D/2 has a larger first harmonic than the square wave, whatever
its phase. The usual gain N(A) of a quantiser (`stability/describing.py`) comes to 1 faster, as
(D/A)^1.5; but it takes samples at all phases of the cycle, and a cycle of a whole number of ticks
meets the same few again and again. So the bound is of the worst case, |N - 1| <= (2/pi) D/A. With
S = 1 / (1 + L) = det(z - open) / det(z - closed) it is 1 - S at the angles of the poles.

Beside it `FEW` steps are dither on any wall: there |N - 1| <= 0.02, the quantiser is a gain of one
within 2 % and a delay within 0.02 rad, and an oscillation beyond has another cause. This covers
well damped walls, whose higher harmonics the first one leaves out, and walls that friction
holds beyond the linear boundary.

Limits: half the range of m1's position is compared, also where the encoder sits on another mass;
the linear loop has no friction, play or other physics in it; of a loop of several rates, or with an
estimator of velocity that is not linear, `FEW` alone counts. Gelb & Vander Velde, Multiple-Input
Describing Functions, 1968, has the gains.
"""

import math

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.device import Device
from zwidth.sim.growth import DECAYS, GROWS, LIMIT_CYCLE, UNDECIDED, Growth
from zwidth.stability.loop import MOST_TICKS, open_loop

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
WITHIN = 0.02  # of one: the quantiser's gain from FEW steps on
FEW = 2.0 / (math.pi * WITHIN)  # steps, 32
LARGEST = 1e6  # steps: no bound is asked for beyond
DRIFTS = 5.0  # steps up to which a trend is none
AT_THE_LIMIT = 0.999  # of the command's limit


def dither_steps(device: Device, stiffness: Floats, damping: Floats) -> Floats:
    """Return the amplitude, in steps, up to which an oscillation is the quantiser's own.

    stiffness [N m/rad | N/m], damping [N m s/rad | N s/m] of walls, each (n,); the result (n,). 0
    for a device without steps, `FEW` where the loop is not stable without them.
    """
    face = device.interface
    if face.encoder_step == 0.0 and face.command_step == 0.0:
        return np.zeros(stiffness.size)
    found = np.full(stiffness.size, FEW)
    if face.multirate or face.delay_ticks[0] > MOST_TICKS or face.estimator.linear is None:
        return found
    loop = open_loop(device)
    zeros = np.linalg.eigvals(loop.transition).astype(np.complex128)
    closed = np.array(
        [loop.closed(k, b) for k, b in zip(stiffness.tolist(), damping.tolist(), strict=True)]
    )
    for i, poles in enumerate(np.linalg.eigvals(closed).astype(np.complex128)):
        if np.abs(poles).max() < 1.0:
            found[i] = max(FEW, min(2.0 / math.pi * _peak(zeros, poles), LARGEST))
    return found


def _peak(zeros: NDArray[np.complex128], poles: NDArray[np.complex128]) -> float:
    """Largest |T_c| on the unit circle, taken at the angles of the poles."""
    on_circle = np.exp(1j * np.angle(poles))[:, None]
    with np.errstate(all="ignore"):
        sensitivity = np.prod((on_circle - zeros) / (on_circle - poles), axis=1)
    return float(np.nanmax(np.abs(1.0 - sensitivity)))


def held_growth(growth: Growth, reach: Floats | float, limit_s: float) -> Flags:
    """Whether the command swings to its limit (reach) at the end: growth that the limit holds.

    Such a cycle may seem to fall a little while it settles.
    """
    with np.errstate(invalid="ignore"):
        falling = (growth.verdict == DECAYS) & (growth.rate * limit_s < -1.0)
        return (growth.force >= AT_THE_LIMIT * reach) & ~falling


def drifts(growth: Growth, start: Floats | float, step: Floats | float) -> Flags:
    """Whether what seems to grow is below the start and a few steps: irregular, without a trend."""
    low = growth.amplitude < np.maximum(np.abs(start), DRIFTS * np.asarray(step))
    return (growth.verdict == GROWS) & low & np.isfinite(growth.rate)


def is_dither(growth: Growth, device: Device, steps: Floats, start: Floats | float) -> Flags:
    """Whether each run ends in an oscillation that the quantiser alone may keep up.

    steps (n,): of `dither_steps`. Regular or not: an irregular one never has a clear trend.
    """
    face = device.interface
    lasting = (growth.verdict == LIMIT_CYCLE) | (growth.verdict == UNDECIDED)
    lasting |= drifts(growth, start, face.encoder_step)
    small = growth.amplitude <= steps * face.encoder_step
    if face.command_step > 0.0:
        small |= growth.force <= steps * face.command_step
    return lasting & small

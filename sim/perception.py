"""When a hand feels an oscillation: above a threshold of force, or of motion.

Force. H. H. King, R. Donlin and B. Hannaford (Perceptual thresholds for single vs. multi-finger
haptic interaction, Haptics Symposium 2010) found that fingertips notice a device's force from
thresholds of 29 to 44 mN on. `FORCE` is a third of that, 0.01 N.

Motion. The threshold of vibration on the skin is flat up to 40 Hz, falls by 12 dB an octave from
there, and is lowest, some tenths of a micrometre, at about 250 Hz (R. T. Verrillo, J. Acoustical
Society of America 35, 1962, 1963; L. A. Jones and S. J. Lederman, Human Hand Function, 2006). Here,
as half the range in micrometres,

    a(f) = 8 min(1, (40 Hz / f)^2),   0.2 from 250 Hz on

Beyond 250 Hz the threshold rises again, which is neglected, to be safe.

Limits: thresholds differ tenfold with person, grip and contact area: some feel 0.01 um on a grasped
cylinder (A. J. Brisben, S. S. Hsiao and K. O. Johnson, J. Neurophysiology 81, 1999). The motion is
that of m1 without a hand; for a rotary device this threshold needs a lever.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.shown import Valued
from zwidth.sim.growth import Growth

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
FORCE = 0.01  # N, or N m for a rotary device
SLOW_M, SLOW_HZ, BEST_HZ = 8e-6, 40.0, 250.0


@dataclass(frozen=True)
class Perception(Valued):
    """Thresholds from which a lasting oscillation is felt; reaching one of the two is enough.

    force [N m | N]: half the range of the command. position [rad | m]: half the range of m1, None
    for the threshold of vibration. lever [m]: of a rotary device, from its axis to the hand; None
    if the threshold of vibration is not used.

    Raises ValueError (field, value, what is allowed).
    """

    force: float = FORCE
    position: float | None = None
    lever: float | None = None

    def __post_init__(self) -> None:
        if not 0.0 <= self.force < math.inf:
            raise ValueError(f"perceptible force is {self.force}; it must be finite and >= 0")
        if self.position is not None and not 0.0 < self.position < math.inf:
            raise ValueError(
                f"perceptible position is {self.position}; it must be above 0 and finite"
            )
        if self.lever is not None and not 0.0 < self.lever < math.inf:
            raise ValueError(f"lever is {self.lever}; it must be above 0 and finite")

    def feels(self, growth: Growth, rotary: bool) -> Flags:
        """Whether each run's oscillation at the end is felt, shape (runs,)."""
        with np.errstate(invalid="ignore"):
            by_force = growth.force >= self.force
            return by_force | (growth.amplitude >= self.least(growth.frequency, rotary))

    def least(self, frequency: Floats, rotary: bool) -> Floats:
        """Return, for each frequency, the smallest amplitude of m1 [rad | m] that a hand feels."""
        if self.position is not None:
            return np.full(frequency.shape, self.position)
        if rotary and self.lever is None:
            return np.full(frequency.shape, math.inf)
        return vibration_threshold(frequency) / (self.lever or 1.0)


def vibration_threshold(frequency: Floats) -> Floats:
    """Return the least amplitude [m] of vibration that skin feels at each frequency [Hz].

    For an unknown frequency it is that of slow vibration.
    """
    known = np.where(np.isfinite(frequency), frequency, 0.0)
    return SLOW_M * (SLOW_HZ / np.clip(known, SLOW_HZ, BEST_HZ)) ** 2

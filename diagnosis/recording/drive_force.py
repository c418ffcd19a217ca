"""Converts the force of a drive that prescribes a motion into the position of m1.

On a bench that moves one end of a device and measures the force there, a motion is the command and
a force the output. The drive is a spring of known stiffness K to the moved end (the load cell and
its mount: `[drive] kind = "position"`), so its force gives the position of the device's end,

    F = K (u - q)    gives    q = u - F / K,

where u is the motion and q the position of m1. A model's error in q, times K, is its error in the
force. If K is too high, the remaining compliance is attributed to the device's first spring; if it
is too low, nothing can compensate it.

Such a motion is smooth between its samples (`sim/smooth_command.py`), since no mass could follow
steps.

Limits: the drive has no damping and reaches no limit.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.shown import Valued
from zwidth.sim.changes import Changes
from zwidth.sim.device import Device

Floats = NDArray[np.float64]
FORCE = "force_m1"


@dataclass(frozen=True)
class Pushed(Valued):
    """A drive that is a spring: its force at q = 0 (ticks,), as recorded, and its stiffness."""

    at_zero: Floats
    stiffness: float

    def position(self, force: Floats) -> Floats:
        """Return the position of m1 (ticks,) at which the drive has that force."""
        return (self.at_zero - force) / self.stiffness

    def force(self, position: Floats) -> Floats:
        """Return the force (ticks,) of the drive for positions (ticks,) of m1."""
        return self.at_zero - self.stiffness * position

    def part(self, cut: slice) -> "Pushed":
        """Return the drive for some of the samples."""
        return Pushed(self.at_zero[cut], self.stiffness)


def drive_stiffness(device: Device, changes: Changes | None) -> float:
    """Return K [N/m | N m/rad] of a run's drive; 0 without a spring or with damping."""
    there = device if changes is None else changes.of(device)
    loops = [p.values for p in there.physics if p.effect.name == "position_servo"]
    if not loops or loops[0]["damping"] + loops[0]["back_emf"] > 0.0:
        return 0.0
    return loops[0]["stiffness"]

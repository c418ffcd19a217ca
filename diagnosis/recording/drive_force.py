"""The force of a drive that prescribes a motion, as the position where its spring ends.

A bench that moves one end of a device and measures the force there has a motion for a command and
a force for an output. Its drive is a spring of known stiffness K to the end that is moved (the load
cell and what holds it: `[drive] kind = "position"`), so that what it pushes with says where the
device's own end is,

    F = K (u - q)    gives    q = u - F / K,

u the motion and q the position of m1. That is a measurement like any other, and what a model gets
wrong of it is, times K, what it gets wrong of the force. A K that is too high leaves its share of
the compliance to the device's first spring; one too low cannot be made up for.

Such a motion is smooth between its samples (`sim/smooth_command.py`): no mass could follow steps.

Limits: no damping in the drive, and no limit that it reaches.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.changes import Changes
from zwidth.sim.device import Device

Floats = NDArray[np.float64]
FORCE = "force_m1"


@dataclass(frozen=True)
class Pushed:
    """A drive that is a spring: its force at q = 0 (ticks,), as recorded, and its stiffness."""

    at_zero: Floats
    stiffness: float

    def position(self, force: Floats) -> Floats:
        """Return the position of m1 (ticks,) at which the drive has that force."""
        return (self.at_zero - force) / self.stiffness

    def force(self, position: Floats) -> Floats:
        """Return the force (ticks,) of the drive where m1 is there."""
        return self.at_zero - self.stiffness * position

    def part(self, cut: slice) -> "Pushed":
        """Return it for some of the samples."""
        return Pushed(self.at_zero[cut], self.stiffness)


def drive_stiffness(device: Device, changes: Changes | None) -> float:
    """Return K [N/m | N m/rad] of the drive of a run; 0 where there is none that tells a position.

    A drive with damping does not: its force is not that of a spring alone.
    """
    there = device if changes is None else changes.of(device)
    loops = [p.values for p in there.physics if p.effect.name == "position_servo"]
    if not loops or loops[0]["damping"] + loops[0]["back_emf"] > 0.0:
        return 0.0
    return loops[0]["stiffness"]

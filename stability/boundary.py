"""A boundary over virtual damping: by linear theory and, independently, in the time domain."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from zwidth.shown import Shown, Valued
from zwidth.sim.device import Device
from zwidth.sim.loop import sampled_system
from zwidth.stability.bisection import Bracket, Search, find_brackets
from zwidth.stability.judging import Trial
from zwidth.stability.linear import corner, known_boundary, last_stable_damping, stand_in
from zwidth.stability.types import LinearPoint

if TYPE_CHECKING:
    from control import StateSpace

Floats = NDArray[np.float64]
GRID = 41
MARGIN = 1.2
NEAR_END = 0.999  # of the last B with a stable K, where the boundary falls to zero


@dataclass(frozen=True)
class BoundaryPoint(Valued):
    """The boundary at one damping B by linear theory and by simulation, computed independently."""

    linear: LinearPoint
    simulated: Bracket

    @property
    def damping(self) -> float:
        """Virtual damping B [N m s/rad | N s/m]."""
        return self.linear.damping


@dataclass(frozen=True, repr=False)
class Boundary(Shown):
    """The stability boundary of a device over virtual damping."""

    device: Device
    points: tuple[BoundaryPoint, ...]

    @property
    def top(self) -> BoundaryPoint | None:
        """The point of highest stiffness in the time domain, None if no K was stable."""
        stable = [p for p in self.points if p.simulated.stable is not None]
        return max(stable, key=lambda p: p.simulated.stable or 0.0, default=None)

    def to_control(self) -> "StateSpace":
        """Return the device without its wall as a `control.StateSpace` of python-control.

        The system is sampled at the interface's period, exactly, with hold and delay: from the
        input "force" [N m | N] to the outputs "position" [rad | m] and "velocity" [rad/s | m/s],
        the latter as the interface estimates it. `control.feedback(system, [[K, B]])` closes the
        loop with a wall of stiffness K and damping B; on the linear boundary its largest pole is on
        the unit circle.

        Raises ImportError, with what to install, if python-control is missing, and ValueError for
        an interface of several rates.
        """
        return sampled_system(self.device)


def default_dampings(device: Device) -> Floats:
    """Return 41 values of B from 0 to 1.2 times the last B with a stable K, and the top's B.

    For most devices the top is a corner, and a grid that misses it shows a truncated boundary. A
    device whose velocity estimator has no linear theory gets the grid for the backward difference.

    Raises ValueError for a device that has no stable wall at all.
    """
    known = stand_in(device)
    last = last_stable_damping(known)
    if last is None or last <= 0.0:
        raise ValueError(
            f"{device.name} with a delay of {1e3 * device.interface.delay:g} ms has no stable wall"
            " at any damping; give --damping values to look at, or a shorter delay"
        )
    grid = np.linspace(0.0, MARGIN * last, GRID)
    top = corner(known)
    return grid if top is None else np.union1d(grid, [top.damping, NEAR_END * last])


def find_boundaries(
    devices: Sequence[Device],
    dampings: Sequence[Floats],
    trial: Trial = Trial(),
    search: Search = Search(),
    progress: Callable[[float], None] | None = None,
) -> list[Boundary]:
    """Return the boundary of each device over its dampings.

    progress: called with the share of time-domain brackets closed. Raises ValueError as
    `stability.linear` and `stability.bisection` do.
    """
    theory = [known_boundary(device, grid) for device, grid in zip(devices, dampings, strict=True)]
    brackets = find_brackets(devices, dampings, trial, search, progress)
    return [
        Boundary(device, tuple(map(BoundaryPoint, linear, simulated)))
        for device, linear, simulated in zip(devices, theory, brackets, strict=True)
    ]

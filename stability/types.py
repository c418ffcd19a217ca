"""Results of the linear theory."""

from dataclasses import dataclass

from zwidth.shown import Valued


@dataclass(frozen=True)
class LinearPoint(Valued):
    """The end of the stable stiffness that begins at K = 0, by linear theory, for one damping B.

    damping: B [N m s/rad | N s/m]. stiffness [N m/rad | N/m]: walls of every K below it are stable;
    None if even the softest wall is unstable. frequency_hz: frequency of the oscillation that grows
    just above it. departure: how fast the growth rate [1/s] of this oscillation rises with K there.
    Both are None without a stable wall.
    """

    damping: float
    stiffness: float | None
    frequency_hz: float | None
    departure: float | None

    @property
    def stable(self) -> bool:
        """Whether some K > 0 is stable."""
        return self.stiffness is not None


@dataclass(frozen=True)
class Corner(Valued):
    """The highest point of a boundary: B_t, K_max, and the frequency on either side of B_t.

    If the two frequencies differ, two branches of eigenvalues meet there; if the boundary is
    smooth, they are equal.
    """

    damping: float
    stiffness: float
    frequency_below_hz: float
    frequency_above_hz: float


@dataclass(frozen=True)
class PassivePoint(Valued):
    """The largest passive stiffness at a virtual damping B, None if no K > 0 is passive.

    frequency_hz: frequency that limits the passive stiffness; 0 for the limit of low frequency.
    """

    damping: float
    stiffness: float | None
    frequency_hz: float | None

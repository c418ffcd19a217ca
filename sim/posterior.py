"""The joint uncertainty of a device's numbers: standard deviations and correlations."""

import math
from dataclasses import dataclass

import numpy as np

from zwidth.shown import Valued

ROUNDED = 1e-5  # a correlation written with six digits may have an eigenvalue below zero


@dataclass(frozen=True)
class Posterior(Valued):
    """The joint posterior of numbers of a device, about the values that the device has.

    names (p,): of the numbers (`sim.named`); sd (p,): standard deviations, in the unit of each;
    correlation: p rows of p, of the logarithms of masses, springs, gain and limit, and of the other
    numbers themselves.

    Raises ValueError with a sentence that names the field, the value and what is allowed.
    """

    names: tuple[str, ...]
    sd: tuple[float, ...]
    correlation: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        p = len(self.names)
        if not p or len(set(self.names)) < p:
            raise ValueError("posterior.names is empty or has a name twice; give each number once")
        if (
            len(self.sd) != p
            or {len(row) for row in self.correlation} != {p}
            or (len(self.correlation) != p)
        ):
            raise ValueError(
                f"posterior has {p} names, {len(self.sd)} sd and {len(self.correlation)} rows of"
                " correlation; give equally many of each, and as many numbers in each row"
            )
        for name, value in zip(self.names, self.sd, strict=True):
            if not 0.0 < value < math.inf:
                raise ValueError(
                    f"posterior.sd of {name} is {value}; it must be a finite number above 0"
                )
        told = np.array(self.correlation)
        if (
            not np.all(np.isfinite(told)) or np.any(np.diag(told) != 1.0)
            or np.any(told != told.T) or float(np.linalg.eigvalsh(told)[0]) < -ROUNDED * p
        ):  # fmt: skip
            raise ValueError(
                "posterior.correlation is not a correlation matrix; it must be symmetric, with ones"
                " on its diagonal and no negative eigenvalue"
            )

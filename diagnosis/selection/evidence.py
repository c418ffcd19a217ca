"""The quantities that decide between hypotheses.

A hypothesis H is a structure S (which effects, where), its parameters theta and a model of the
noise. Its cost is

    cost(H) = -2 ln p(y | theta, noise) - 2 ln p(theta)              how well it explains
            + ln det A - k ln 2 pi + 2 sum_k ln range_k              price of its freedom
            - 2 ln P(S)                                              how rare such physics is
            + 2 ln (alternatives searched)                           how much was searched

at its best theta: Laplace's approximation of -2 ln of the evidence p(y, S). A is half the curvature
of the first line over all parameters (J'J + 1 for each prior); k effect parameters are uniform over
a range each, from zero to the largest plausible value. With one parameter of standard error sigma
the second line is 2 ln (range / sigma) - ln 2 pi. Linear parameters are in all hypotheses, so their
constant terms are left out.

H' is believed over H if its cost is lower by more than 2 ln (1 / ALPHA): the only threshold.

If no hypothesis is true (real machines), a likelihood ratio is overconfident: the gain of one over
the other comes from few stretches, and has different signs in different places. The gain is summed
over blocks, and the scatter of the blocks gives the uncertainty of the sum,

    phi = variance of the sum / (4 |gain|), at least 1,    sigma = sqrt(|gain| / phi).

If one of two hypotheses is true, phi is 1: with e white of variance 1 and d the difference of
predictions, the gain of a sample is d^2 + 2 d e, of mean d^2 and variance 4 d^2. The gain of an
effect that acts in some stretches only (drag at speed, play at reversals) differs between blocks,
like d^2, without scatter. So the variance is computed about the gains that d^2 predicts for the
blocks (a fitted straight line), not about their mean. (Vuong, Econometrica 57, 1989, uses the mean;
neighbouring blocks by Newey & West, Econometrica 55, 1987; Laplace: Kass & Raftery, J. Am. Stat.
Assoc. 90, 1995.) The relative weight of each hypothesis is exp(-cost / 2 phi).

Limits: Laplace assumes that the cost is a parabola in theta. With creases this holds only beyond
their width, so A must be computed over at least this width. Fewer than ten blocks give a poor
estimate of their scatter.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.settings import EVIDENCE

Floats = NDArray[np.float64]
ALPHA = EVIDENCE.alpha


@dataclass(frozen=True)
class Cost:
    """The four lines of the cost of a hypothesis in the equation above, each in -2 ln."""

    misfit: float
    freedom: float = 0.0
    rarity: float = 0.0
    searched: float = 0.0

    @property
    def total(self) -> float:
        """The sum of all four."""
        return self.misfit + self.freedom + self.rarity + self.searched


def freedom(information: Floats, ranges: Sequence[float]) -> float:
    """Return the penalty of free parameters.

    information (p, p): A; ranges: of the uniform parameters, in the units of A. Infinite if A does
    not determine a parameter. Raises ValueError unless ranges are finite and above 0.
    """
    if any(not 0.0 < r < math.inf for r in ranges):
        raise ValueError(f"ranges are {list(ranges)}; each must be finite and more than 0")
    sign, log_det = np.linalg.slogdet(information)
    bits = float(log_det) if sign > 0.0 else math.inf
    return bits + 2.0 * sum(math.log(r) for r in ranges) - len(ranges) * math.log(2.0 * math.pi)


def rarity(odds: Sequence[float]) -> float:
    """Return the penalty of effects with these prior probabilities, above 0 and below 1."""
    if any(not 0.0 < p < 1.0 for p in odds):
        raise ValueError(f"odds are {list(odds)}; each must be more than 0 and less than 1")
    return -2.0 * sum(math.log(p / (1.0 - p)) for p in odds)


def believed(new: Cost, old: Cost, phi: float = 1.0) -> bool:
    """Whether a hypothesis is believed over another; phi: of the two, from `compared`."""
    return old.total - new.total > 2.0 * phi * math.log(1.0 / ALPHA)


@dataclass(frozen=True)
class Compared:
    """The gain of one hypothesis over another: summed -2 ln likelihood, and its overdispersion."""

    gain: float
    phi: float

    @property
    def sigma(self) -> float:
        """How many standard errors apart, with the sign of the gain."""
        return math.copysign(math.sqrt(abs(self.gain) / self.phi), self.gain)


def compared(gains: Floats, foretold: Floats | None = None, lags: int = 2) -> Compared:
    """Compare two hypotheses by the gain of one over the other in each block (blocks,).

    foretold: squared differences of their predictions in each block; None if equal. lags: number of
    neighbouring blocks that count as correlated, with falling weight. Fewer than 3 blocks (5 with
    `foretold`) give no scatter, and phi is 1.
    """
    total, count = float(gains.sum()), gains.size
    line = np.ones((count, 1))
    if foretold is not None and np.all(np.isfinite(foretold)) and np.ptp(foretold) > 0.0:
        line = np.column_stack([line, foretold / foretold.max()])
    free = line.shape[1]
    if count < 2 * free + 1 or total == 0.0 or not math.isfinite(total):
        return Compared(total, 1.0)
    off = gains - line @ np.linalg.lstsq(line, gains)[0]
    spread = float(off @ off)
    for lag in range(1, min(lags, count - 2) + 1):
        spread += 2.0 * (1.0 - lag / (lags + 1.0)) * float(off[lag:] @ off[:-lag])
    spread = max(spread, 0.0) * count / (count - free)
    return Compared(total, max(1.0, spread / (4.0 * abs(total))))


def probabilities(costs: Sequence[float], phi: float = 1.0) -> Floats:
    """Return the relative weight of each hypothesis, (hypotheses,), summing to 1."""
    least = np.asarray(costs, dtype=np.float64)
    shares = np.exp(-0.5 * (least - least.min()) / phi)
    return shares / shares.sum()

"""The step of which all values of a signal are multiples: an encoder's, a converter's, a printer's.

With distinct values u_0 < u_1 < ... all gaps u_{i+1} - u_i are multiples of the step. The smallest
gap is a first estimate; taking the gaps in rising order and dividing their sum by the multiples
counted so far makes the estimate sharper before larger gaps, with larger multiples, need it.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LEAST_LEVELS = 8
ROUNDS = 8
LARGEST_RESIDUAL = 0.1  # of a step; where there is no step, residuals spread evenly to 0.5
LARGEST_MULTIPLE = 1e12  # beyond it the rounding of a double hides the step


def step_seen(values: Floats) -> float | None:
    """Return the step of values, shape (samples,), or None where they show none.

    Values that are not finite are passed over. A signal of fewer than eight levels shows none.
    """
    levels = np.unique(values[np.isfinite(values)])
    if levels.size < LEAST_LEVELS:
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        return _step(levels)


def _step(levels: Floats) -> float | None:
    gaps = np.diff(levels)
    rounding = 4.0 * np.spacing(np.abs(levels).max())
    gaps = np.sort(gaps[gaps > rounding])
    span = levels[-1] - levels[0]
    if gaps.size < LEAST_LEVELS - 1 or not np.isfinite(span) or span / gaps[0] > LARGEST_MULTIPLE:
        return None
    step = _refined(gaps)
    residual = (levels - levels[0]) / step
    residual = np.abs(residual - np.rint(residual))
    return _shortest(step) if residual.max() < LARGEST_RESIDUAL else None


def _refined(gaps: Floats) -> float:
    """Return the step of gaps that rise."""
    step, sums = float(gaps[0]), np.cumsum(gaps)
    for _ in range(ROUNDS):
        multiples = np.rint(gaps / step)
        # Rounding is safe while the error of the step, a fraction 1/(2 n), is under half a step.
        counted = np.cumsum(multiples)
        safe = int(np.searchsorted(multiples, max(1.0, 0.25 * counted[_ones(multiples)]), "right"))
        better = float(sums[safe - 1] / counted[safe - 1])
        if better == step:
            break
        step = better
    return step


def _ones(multiples: Floats) -> int:
    """Return the index of the last gap of a single step."""
    return max(int(np.searchsorted(multiples, 1.0, "right")) - 1, 0)


def _shortest(step: float) -> float:
    """Return the step without the digits that rounding left: 4.9999999999e-08 -> 5e-08."""
    for digits in (2, 4, 6, 9):
        short = float(f"{step:.{digits}g}")
        if abs(short - step) <= 1e-9 * step:
            return short
    return step

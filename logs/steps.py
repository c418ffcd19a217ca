"""The step of which all values of a signal are multiples, from encoder, converter or rounding.

With distinct values u_0 < u_1 < ... all gaps u_{i+1} - u_i are multiples of the step. The smallest
gap is a first estimate or, if levels are skipped (16 and 17 steps apart), the smallest difference
of gaps. The gaps are taken in rising order, and their sum is divided by the multiples counted so
far, so the estimate is accurate enough before larger gaps, with larger multiples, need it.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LEAST_LEVELS = 8
ROUNDS = 8
LARGEST_RESIDUAL = 0.003  # of a step; without a step, residuals are uniform up to 0.5
LARGEST_MULTIPLE = 1e12  # above it the rounding of doubles hides the step


def step_seen(values: Floats) -> float | None:
    """Return the step of values (samples,), or None if they show none.

    Values that are not finite are ignored. A signal with fewer than eight levels shows no step.
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
    span = float(levels[-1] - levels[0])
    if gaps.size < LEAST_LEVELS - 1 or not np.isfinite(span):
        return None
    differences = np.diff(gaps)
    differences = differences[(differences > 2.0 * rounding) & (differences < gaps[0])]
    for first in (gaps[0], *([differences.min()] if differences.size else [])):
        if span / first < LARGEST_MULTIPLE:
            step = _refined(gaps, float(first))
            residual = (levels - levels[0]) / step
            if np.abs(residual - np.rint(residual)).max() < LARGEST_RESIDUAL:
                return _shortest(step)
    return None


def _refined(gaps: Floats, step: float) -> float:
    """Return the step of gaps that rise, from a first estimate."""
    sums = np.cumsum(gaps)
    for _ in range(ROUNDS):
        multiples = np.maximum(np.rint(gaps / step), 1.0)
        # The smallest gaps, n steps in total, give the step to within a share of 1/(2 n), so gaps
        # of up to n/4 steps are counted correctly.
        counted, least = np.cumsum(multiples), multiples[0]
        sure = counted[np.searchsorted(multiples, least, "right") - 1]
        safe = int(np.searchsorted(multiples, max(least, 0.25 * sure), "right"))
        better = float(sums[safe - 1] / counted[safe - 1])
        if better == step:
            break
        step = better
    return step


def _shortest(step: float) -> float:
    """Return the step without the digits that rounding left: 4.9999999999e-08 -> 5e-08."""
    for digits in (2, 4, 6, 9):
        short = float(f"{step:.{digits}g}")
        if abs(short - step) <= 1e-9 * step:
            return short
    return step

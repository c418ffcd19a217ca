"""Refine a map of fates only where the fate changes.

A lattice of (coarse - 1) 2^levels + 1 points per side. First every 2^levels-th point is run. Then,
level by level, each cell with two fates among the points run in it or on its sides is divided. This
adds points on the sides of neighbouring cells; a neighbour in which such a point has a second fate
is divided too, until no cell of the level has two fates. In each remaining cell all the points that
were run have one fate, and its other points take this fate from the corners.

The order of the points depends only on the fates, never on time or threads, so a resumed map runs
the same points and ends bit for bit the same.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Fate = NDArray[np.int8]
Flags = NDArray[np.bool_]
MOST_POINTS = 2049  # per side


def side(coarse: int, levels: int) -> int:
    """Return the lattice's points per side; raises ValueError for too few or too many."""
    if coarse < 3:
        raise ValueError(f"coarse is {coarse}; a map needs at least 3 points per side to refine")
    if not 0 <= levels <= 8:
        raise ValueError(f"levels is {levels}; it must be from 0 to 8")
    points = (coarse - 1) * 2**levels + 1
    if points > MOST_POINTS:
        raise ValueError(
            f"coarse {coarse} and levels {levels} make {points} points per side; at most"
            f" {MOST_POINTS} are possible: lower one of them"
        )
    return points


def rounds(fate: Fate, levels: int) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Yield (level, flat indices of the points to run next); a level may take several rounds.

    fate (side, side): -1 where not run; the caller fills it before requesting the next round.
    """
    stride = 2**levels
    first = np.zeros(fate.shape, dtype=bool)
    first[::stride, ::stride] = True
    yield 0, np.flatnonzero(first & (fate < 0))
    for level in range(1, levels + 1):
        while (wanted := _wanted(fate, stride)).size:
            yield level, wanted
        stride //= 2


def _wanted(fate: Fate, stride: int) -> NDArray[np.int64]:
    """Flat indices of the points still to run in the cells of this stride that must be divided."""
    half = stride // 2
    points = np.zeros(fate.shape, dtype=bool)
    for i, j in zip(*np.nonzero(_mixed(fate, stride)), strict=True):
        rows = slice(i * stride, (i + 1) * stride + 1, half)
        points[rows, j * stride : (j + 1) * stride + 1 : half] = True
    return np.flatnonzero(points & (fate < 0))


def _mixed(fate: Fate, stride: int) -> Flags:
    """Cells of this stride, corners run, with two fates among their 3 x 3 points."""
    half = stride // 2
    seen = fate[::half, ::half]
    count = (fate.shape[0] - 1) // stride
    nine = np.stack(
        [seen[a : a + 2 * count : 2, b : b + 2 * count : 2] for a in range(3) for b in range(3)]
    )
    corners = nine[[0, 2, 6, 8]]
    known = (corners >= 0).all(axis=0)
    least = np.where(nine < 0, np.iinfo(np.int8).max, nine).min(axis=0)
    return known & (nine.max(axis=0) != least)


def filled(values: NDArray[np.float64], run: Flags, levels: int) -> NDArray[np.float64]:
    """Return values with every point that was not run taken from a corner of its cell.

    values, run (side, side). Level by level a point between those of the coarser lattice takes the
    value of its neighbour below or to the left.
    """
    result = values.copy()
    known = run.copy()
    for level in range(levels):
        stride = 2 ** (levels - level)
        half = stride // 2
        for down, right in ((half, 0), (0, half), (half, half)):
            to = (slice(down, None, stride), slice(right, None, stride))
            source = result[::stride, ::stride][: result[to].shape[0], : result[to].shape[1]]
            result[to] = np.where(known[to], result[to], source)
    return result

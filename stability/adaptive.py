"""Refine a map where the fate changes, and only there.

A lattice of (coarse - 1) 2^levels + 1 points a side. First every 2^levels-th point is run. Then, level
by level, the cells whose corners differ in fate, and their neighbours, are cut in four. What is left
lies inside cells of one fate and takes it from their corners.

The order of the points depends on the fates alone, never on time or threads, so a map taken up again
goes the same way and ends bit for bit the same.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Fate = NDArray[np.int8]
Flags = NDArray[np.bool_]


def side(coarse: int, levels: int) -> int:
    """Return the lattice's points a side; raises ValueError for less than a cell."""
    if coarse < 3:
        raise ValueError(f"coarse is {coarse}; a map needs at least 3 points a side to refine")
    if not 0 <= levels <= 8:
        raise ValueError(f"levels is {levels}; allowed is 0 to 8")
    return (coarse - 1) * 2**levels + 1


def rounds(fate: Fate, levels: int) -> Iterator[NDArray[np.int64]]:
    """Yield, level by level, the flat indices of the points to run next.

    fate (side, side): -1 where not run; the caller fills it before the next level is asked for.
    """
    stride = 2**levels
    first = np.zeros(fate.shape, dtype=bool)
    first[::stride, ::stride] = True
    yield np.flatnonzero(first & (fate < 0))
    while stride > 1:
        half = stride // 2
        wanted = np.zeros(fate.shape, dtype=bool)
        for i, j in zip(*np.nonzero(_mixed(fate, stride)), strict=True):
            rows = slice(i * stride, (i + 1) * stride + 1, half)
            wanted[rows, j * stride : (j + 1) * stride + 1 : half] = True
        yield np.flatnonzero(wanted & (fate < 0))
        stride = half


def _mixed(fate: Fate, stride: int) -> Flags:
    """Cells of this stride, all corners run, with a change of fate at or beside them."""
    corners = fate[::stride, ::stride]
    four = np.stack([corners[:-1, :-1], corners[1:, :-1], corners[:-1, 1:], corners[1:, 1:]])
    known = (four >= 0).all(axis=0)
    mixed = known & (four.max(axis=0) != four.min(axis=0))
    near = mixed.copy()
    near[1:] |= mixed[:-1]
    near[:-1] |= mixed[1:]
    near[:, 1:] |= mixed[:, :-1]
    near[:, :-1] |= mixed[:, 1:]
    return near & known


def filled(values: NDArray[np.float64], run: Flags, levels: int) -> NDArray[np.float64]:
    """Return values with every point that was not run taken from its finest enclosing cell.

    values (side, side); each unrun point gets the value of the nearest run point of that lattice.
    """
    result = values.copy()
    known = run.copy()
    for level in range(levels):
        stride = 2 ** (levels - level)
        half = stride // 2
        for down, right in ((half, 0), (0, half), (half, half)):
            to = (slice(down, None, stride), slice(right, None, stride))
            source = result[::stride, ::stride][: result[to].shape[0], : result[to].shape[1]]
            gap = ~known[to]
            result[to] = np.where(gap, source, result[to])
        known[::half, ::half] = True
    return result

"""A plane of fates computed from coarse to fine, for interactive display.

The lattice has 161 points a side. First every 16th point is run; then every 4th along changes of
fate, so that a picture of 41 x 41 points has the right fates; then all other points of that
picture, for quantities that vary within one fate; then the changes of fate again, down to single
points. Between chunks of work the caller may stop, or draw the result so far: points that were not
run take their values from a corner of their cell.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from zwidth.stability.adaptive import filled, rounds, side
from zwidth.stability.fate_map import FateMap
from zwidth.stability.fates import Fates, evaluate
from zwidth.stability.plane import Floats, Plane

COARSE, MIDDLE_LEVELS, FINE_LEVELS = 11, 2, 2
LEVELS = MIDDLE_LEVELS + FINE_LEVELS
MIDDLE_STRIDE = 2**FINE_LEVELS
CHUNK_S = 0.06  # [s] of work between two results
FEWEST, MOST = 64, 2048  # points in a chunk

Points = NDArray[np.int64]


@dataclass(frozen=True)
class Sketch:
    """A plane in progress. x, y: lattice values (n,); fates, flat, -1 where not run.

    middle: whether every point of the 41 x 41 lattice was run; finished: whether no point is left.
    """

    plane: Plane
    x: Floats
    y: Floats
    fates: Fates
    middle: bool
    finished: bool

    @property
    def runs(self) -> int:
        """How many points were simulated so far."""
        return int((self.fates.fate >= 0).sum())

    def filled(self) -> FateMap:
        """Return the map so far."""
        shape = (self.y.size, self.x.size)
        run = self.fates.fate.reshape(shape) >= 0
        grids = [
            filled(getattr(self.fates, f.name).reshape(shape).astype(np.float64), run, LEVELS)
            for f in fields(self.fates)
        ]
        return FateMap(self.plane, self.x, self.y, Fates(grids[0].astype(np.int8), *grids[1:]), run)


def sketch(plane: Plane, workers: int | None = None) -> Iterator[Sketch]:
    """Yield the plane after every chunk of work; the last one is finished.

    All results share one set of fates, filled by the work in between. Which points are run depends
    only on the fates, not on time.
    """
    size = side(COARSE, LEVELS)
    x, y = plane.x.values(size), plane.y.values(size)
    fates = Fates.empty(size * size)
    middle, chunk = False, FEWEST
    for last_of_middle, points in _stages(fates.fate.reshape(size, size)):
        first = 0
        while first < points.size:
            some = points[first : first + chunk]
            began = time.perf_counter()
            with np.errstate(over="ignore"):  # runs may grow without bound
                fates.put(some, evaluate(plane, x[some % size], y[some // size], workers))
            took = time.perf_counter() - began
            chunk = int(np.clip(some.size * CHUNK_S / max(took, 1e-6), FEWEST, MOST))
            first += some.size
            middle = middle or (last_of_middle and first >= points.size)
            yield Sketch(plane, x, y, fates, middle, False)
    yield Sketch(plane, x, y, fates, True, True)


def _stages(fate: NDArray[np.int8]) -> Iterator[tuple[bool, Points]]:
    """Yield (whether they complete the lattice of 41 points per side, flat indices to run)."""
    size = fate.shape[0]
    index = np.arange(fate.size).reshape(fate.shape)
    coarser = (slice(None, None, MIDDLE_STRIDE),) * 2
    for _, points in rounds(fate[coarser], MIDDLE_LEVELS):
        yield False, index[coarser].ravel()[points]
    left = np.zeros((size, size), dtype=bool)
    left[coarser] = True
    yield True, np.flatnonzero(left & (fate < 0))
    for _, points in rounds(fate, FINE_LEVELS):
        yield False, points

"""Refinement finds a boundary with few runs, and leaves nothing out that it has seen."""

import numpy as np
import pytest
from numpy.typing import NDArray

from zwidth.stability.adaptive import filled, rounds, side

Fates = NDArray[np.int8]


def refined(full: Fates, coarse: int, levels: int) -> tuple[Fates, NDArray[np.bool_]]:
    """Return (fates of the whole lattice, what was run) where a run at a point gives `full`."""
    size = side(coarse, levels)
    fate = np.full((size, size), -1, dtype=np.int8)
    for _, points in rounds(fate, levels):
        assert np.all(fate.ravel()[points] == -1), "a point is asked for twice"
        assert points.size == np.unique(points).size
        fate.ravel()[points] = full.ravel()[points]
    run = fate >= 0
    return filled(fate.astype(np.float64), run, levels).astype(np.int8), run


def coordinates(size: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return x and y from 0 to 1 over the lattice."""
    x, y = np.meshgrid(np.linspace(0.0, 1.0, size), np.linspace(0.0, 1.0, size))
    return x, y


@pytest.mark.parametrize(
    ("coarse", "levels", "least"), [(25, 2, 6.0), (25, 3, 14.0), (13, 4, 18.0)]
)
def test_a_smooth_boundary_is_the_full_lattice_at_a_fraction_of_its_runs(
    coarse: int, levels: int, least: float
) -> None:
    """A triangle with a rounded top, as of K over B: not one point differs from the full lattice.

    Mutations: cells judged by their corners alone leave points behind; `_mixed` of neighbours too
    takes more runs than `least` allows.
    """
    x, y = coordinates(side(coarse, levels))
    full = (y > np.minimum(0.1 + 0.9 * x, 6.0 * (1.0 - x))).astype(np.int8)
    found, run = refined(full, coarse, levels)
    np.testing.assert_array_equal(found, full)
    assert run.size / run.sum() > least


def test_a_finger_that_leaves_the_coarse_cells_is_followed() -> None:
    """A thin curve that crosses sides of cells between their corners is found by its neighbours.

    Mutation: only corners looked at in `_mixed` (nine[[0, 2, 6, 8]] for all nine).
    """
    x, y = coordinates(side(17, 3))
    full = (np.abs(y - 0.5 - 0.4 * np.sin(7.0 * x)) < 0.035).astype(np.int8)
    full[:, x[0] < 0.05] = 1  # seen here first
    found, _ = refined(full, 17, 3)
    np.testing.assert_array_equal(found, full)


def test_one_fate_is_run_on_the_coarse_lattice_only() -> None:
    found, run = refined(np.full((33, 33), 2, dtype=np.int8), 9, 2)
    assert run.sum() == 81
    assert np.all(found == 2)


def test_filling_keeps_what_was_run_and_takes_the_rest_from_its_cell() -> None:
    values = np.full((9, 9), np.nan)
    values[::4, ::4] = np.arange(9.0).reshape(3, 3)
    values[2, 2] = 50.0
    run = np.isfinite(values)
    found = filled(values, run, 2)
    np.testing.assert_array_equal(found[run], values[run])
    assert np.all(np.isin(found[0:4, 0:4], [0.0, 50.0]))
    assert np.all(found[4:8, 4:8] == 4.0)


@pytest.mark.parametrize(
    ("coarse", "levels", "says"),
    [
        (2, 1, "at least 3 points"),
        (9, 9, "0 to 8"),
        (9, -1, "0 to 8"),
        (513, 8, "at most 2049"),
    ],
)
def test_lattices_that_cannot_be(coarse: int, levels: int, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        side(coarse, levels)

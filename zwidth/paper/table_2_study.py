"""Which physics explains Table II? Candidates fitted to its rows, judged by rows left out."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.paper.table_2_fit import fit
from zwidth.paper.table_2_theories import CANDIDATES, theory
from zwidth.scenarios.misprints import JUMPED_HZ
from zwidth.scenarios.table_2 import MeasuredPoint, table_2

Floats = NDArray[np.float64]


class Errors(NamedTuple):
    """Mean absolute errors of a candidate over rows of Table II.

    part_1, part_2: of K in parts I and II [N m/rad]. frequency_hz: of f in part I. without: number
    of rows for which the candidate has no stable wall.
    """

    part_1: float
    part_2: float
    frequency_hz: float
    without: int


@dataclass(frozen=True)
class Judged:
    """A candidate effect, fitted to all good rows.

    fitted: the errors of this fit. left_out: the error of each row by a fit to all other rows.
    """

    name: str
    values: dict[str, float]
    fitted: Errors
    left_out: Errors


def good_rows() -> list[MeasuredPoint]:
    """Return the rows of Table II that are not misprints."""
    return [row for row in table_2() if row.damping_meant is None]


def study(names: Sequence[str] = tuple(CANDIDATES), leave_out: bool = True) -> list[Judged]:
    """Fit and judge candidates; if leave_out is false, `left_out` is the same as `fitted`."""
    rows = good_rows()
    found: list[Judged] = []
    for name in names:
        free = CANDIDATES[name]
        x = fit(free, rows)
        points = [read(free, x, row) for row in rows]
        others = points
        if leave_out and free:
            others = [read(free, fit(free, _without(rows, row), x), row) for row in rows]
        values = dict(zip(free, x.tolist(), strict=True))
        found.append(Judged(name, values, errors(rows, points), errors(rows, others)))
    return found


def errors(rows: Sequence[MeasuredPoint], points: Sequence[tuple[float, float]]) -> Errors:
    """Return the errors of predicted (K, f) at rows; no stable wall counts as K = 0."""
    stiffness = np.array([abs(k - row.stiffness) for row, (k, _) in zip(rows, points, strict=True)])
    frequency = np.array([abs(f - row.frequency) for row, (_, f) in zip(rows, points, strict=True)])
    slow = np.array([row.frequency < JUMPED_HZ for row in rows])
    same = slow & np.array([f < JUMPED_HZ for _, f in points])
    without = sum(k == 0.0 for k, _ in points)
    return Errors(
        float(np.mean(stiffness[slow])),
        float(np.mean(stiffness[~slow])),
        float(np.mean(frequency[same])),
        without,
    )


def read(free: Sequence[str], x: Floats, row: MeasuredPoint) -> tuple[float, float]:
    """Return (K_CR, f [Hz]) that a candidate reads at the row's delay and B."""
    return theory(free, x).reading(row.delay, row.damping)


def _without(rows: Sequence[MeasuredPoint], one: MeasuredPoint) -> list[MeasuredPoint]:
    return [row for row in rows if row != one]

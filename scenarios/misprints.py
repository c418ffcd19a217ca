"""Rows of critical oscillations that no smooth plant explains, and the B that they imply.

A row gives c = ln(measured plant / model) (`scenarios/inversion.py`). For a smooth plant c is
smooth in f: before the jump of f it is estimated by a line through the other rows of the same
delay, after it by a constant over the other rows within a tenth of its frequency (too few for a
line), both by Theil and Sen's medians, which up to three misprints in ten do not affect. With this
c, the row's wall should be W, and of all K + B' w the nearest to it has

    B' = Re[(W - K) conj(w)] / |w|^2,    departure t = (B' - B) |w| / |W|,

where t is the necessary change of B as a share of the whole wall. The deviation of a row from its
neighbours in size and phase, e = (K + B w) / W - 1, has two components; the spread s of each is
estimated from all rows before the jump, or all after it, by the median of |e| (1.1774 s for a
normal distribution). A row with |t| > 3.5 s (Iglewicz and Hoaglin's limit for scores by a median),
whose remainder with B' is below that, is a misprint of B: a wrong K or f would leave a remainder.

Limits: needs four rows of a delay before the jump; after it, the six rows scatter so widely that
only a B wrong by about half would show.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.scenarios.inversion import Row, inverted
from zwidth.sim.modal import ModalModel

Floats = NDArray[np.float64]
JUMPED_HZ = 100.0  # a row above it lies after the jump of f
NEARBY = 0.1  # of a row's frequency: range of its neighbours after the jump
OUTLYING = 3.5
MEDIAN_SIZE = 1.1774  # sqrt(2 ln 2): median length of a normal vector in a plane, over its spread
STEP = 0.01  # the grid on which the paper chose its dampings below B_t


class Judged(NamedTuple):
    """A row among its neighbours.

    damping: B' that they imply, with its spread; score: t over the spread s of all; rest: the
    remainder with B', over s too.
    """

    damping: float
    spread: float
    score: float
    rest: float

    @property
    def misprint(self) -> bool:
        """Whether a change of B alone would make the row agree with its neighbours."""
        return abs(self.score) > OUTLYING and self.rest < OUTLYING

    @property
    def meant(self) -> float | None:
        """The damping on the paper's grid nearest to the implied one, None for no misprint."""
        return round(round(self.damping / STEP) * STEP, 6) if self.misprint else None


def judged(rows: Sequence[Row], model: ModalModel, period: float) -> tuple[Judged, ...]:
    """Judge each row by the others; see above.

    Raises ValueError for a row with fewer neighbours than a trend needs.
    """
    points = [inverted(row, model, period) for row in rows]
    c = np.array([
        np.log(p.ratio(row.stiffness, row.damping)) for row, p in zip(rows, points, strict=True)
    ])  # fmt: skip
    walls = np.array([p.model for p in points]) / np.exp(_trends(rows, c))
    w = np.array([p.velocity for p in points])
    stiffness, damping = np.array([(row.stiffness, row.damping) for row in rows]).T
    implied = np.real((walls - stiffness) * np.conj(w)) / np.abs(w) ** 2
    scale = np.abs(walls / w)  # damping that would be the whole wall
    departure = (implied - damping) / scale
    rest = np.abs(stiffness + implied * w - walls) / np.abs(walls)
    error = np.abs((stiffness + damping * w) / walls - 1.0)
    jumped = np.array([row.frequency > JUMPED_HZ for row in rows])
    spread = np.ones(jumped.size)
    for part in (p for p in (jumped, ~jumped) if p.any()):
        spread[part] = np.median(error[part]) / MEDIAN_SIZE
    return tuple(
        Judged(*values)
        for values in zip(
            implied.tolist(), (spread * scale).tolist(), (departure / spread).tolist(),
            (rest / spread).tolist(), strict=True,
        )
    )  # fmt: skip


def _trends(rows: Sequence[Row], c: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the c of each row by its neighbours alone."""
    return np.array([_trend(rows, i, c) for i in range(len(rows))])


def _trend(rows: Sequence[Row], i: int, c: NDArray[np.complex128]) -> complex:
    one = rows[i]
    jumped = one.frequency > JUMPED_HZ
    near = [j for j in range(len(rows)) if j != i and _neighbours(one, rows[j])]
    if len(near) < (1 if jumped else 3):
        raise ValueError(
            f"the row at {1e3 * one.delay:g} ms, B = {one.damping:g} has {len(near)} neighbours;"
            " before the jump of f it needs 3 rows with the same delay, after it 1 row whose f is"
            " within a tenth"
        )
    f = np.array([rows[j].frequency for j in near])
    if jumped:
        return complex(np.median(c[near].real), np.median(c[near].imag))
    return complex(_line(f, c[near].real, one.frequency), _line(f, c[near].imag, one.frequency))


def _neighbours(one: Row, other: Row) -> bool:
    if one.frequency > JUMPED_HZ:
        return abs(other.frequency - one.frequency) < NEARBY * one.frequency
    return other.frequency <= JUMPED_HZ and abs(other.delay - one.delay) < 1e-9


def _line(x: Floats, y: Floats, at: float) -> float:
    """Return Theil and Sen's line through points (n,) at an abscissa."""
    first, second = np.triu_indices(x.size, 1)
    apart = x[second] != x[first]
    slopes = (y[second] - y[first])[apart] / (x[second] - x[first])[apart]
    slope = float(np.median(slopes)) if slopes.size else 0.0
    return float(np.median(y - slope * x)) + slope * at

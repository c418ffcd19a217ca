"""The study of Table II: exact on rows that a candidate made itself, and the device it ships."""

import numpy as np
import pytest

from scenarios.table_2 import MeasuredPoint
from sim.device_file import load_device
from stability.linear import critical_stiffness
from zwidth.paper.table_2_study import errors, good_rows, misfit, predict


@pytest.mark.parametrize(
    ("free", "x"),
    [((), []), (("rho",), [0.05]), (("delay", "gain"), [3e-4, 0.1]), (("b", "v_2"), [0.3, 0.05])],
)
def test_rows_made_by_a_candidate_fit_it_exactly(free: tuple[str, ...], x: list[float]) -> None:
    """Prediction by eigenvalues and error on the unit circle agree.

    Mutation: a damper of the wrong sign in `misfit`; the gain dividing the plant.
    """
    values = np.array(x, dtype=np.float64)
    for delay, damping in ((0.002, 0.03), (0.004, 0.15), (0.008, 0.08)):
        asked = MeasuredPoint(delay, damping, 1.0, 1.0)
        stiffness, frequency = predict(free, values, asked)
        row = MeasuredPoint(delay, damping, stiffness, frequency)
        assert np.abs(misfit(free, values, [row])).max() < 1e-4


def test_the_shipped_refit_halves_the_error_in_part_1() -> None:
    """Mutation: Table I's device in its place."""
    rows = good_rows()
    assert len(rows) == 24
    paper = errors(rows, [predict((), np.zeros(0), row) for row in rows])
    assert paper.part_1 == pytest.approx(8.51, abs=0.01)
    assert paper.part_2 == pytest.approx(11.93, abs=0.01)
    device = load_device("phantom_1_0_table2")
    found: list[tuple[float, float]] = []
    for row in rows:
        point = critical_stiffness(device.with_interface(delay=row.delay), row.damping)
        found.append((point.stiffness or 0.0, point.frequency_hz or np.nan))
    ours = errors(rows, found)
    assert ours.part_1 < 0.15 * paper.part_1
    assert ours.frequency_hz < 0.7 * paper.frequency_hz

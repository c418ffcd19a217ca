"""Table II as it is printed, and its two misprints found by computation."""

from collections.abc import Sequence

import numpy as np
import pytest

from zwidth.scenarios.inversion import inverted
from zwidth.scenarios.misprints import OUTLYING, judged
from zwidth.scenarios.table_2 import DEVICE, MeasuredPoint, measured_at, table_2
from zwidth.sim.device_file import load_device
from zwidth.sim.modal import ModalModel
from zwidth.stability.linear import critical_stiffness

DEVICE_OF_TABLE_1 = load_device(DEVICE)
MODEL = DEVICE_OF_TABLE_1.modal or ModalModel(1.0, 1.0)
PERIOD = DEVICE_OF_TABLE_1.interface.period


def as_meant() -> list[MeasuredPoint]:
    return [row._replace(damping=row.place, judged=None) for row in table_2()]


def flagged(rows: Sequence[MeasuredPoint]) -> list[int]:
    return [i for i, verdict in enumerate(judged(rows, MODEL, PERIOD)) if verdict.misprint]


def test_table_is_complete_and_as_printed():
    points = table_2()
    assert len(points) == 26
    assert [len(measured_at(ms / 1e3)) for ms in (2, 4, 8)] == [7, 13, 6]
    assert sum(p.damping for p in points) == pytest.approx(3.688)
    assert sum(p.stiffness for p in points) == pytest.approx(496.8)
    assert sum(p.frequency for p in points) == pytest.approx(1796.92)


def test_exactly_two_rows_are_misprints_and_no_third():
    """The farthest good row is at 2.6 of 3.5 allowed, the nearer misprint at 5.3.

    Mutation: the trend's slope left out flags others; K left out of the implied B moves it; rows
    not left out of their own trend hide 0.05.
    """
    rows = [(p, p.judged) for p in table_2() if p.judged is not None]
    found = [(p.delay, p.damping, v.meant) for p, v in rows if v.misprint]
    assert found == [(0.004, 0.05, 0.08), (0.004, 0.5, 0.1)]
    assert [v.damping for _, v in rows if v.misprint] == pytest.approx([0.0825, 0.0993], abs=5e-4)
    assert max(abs(v.score) for _, v in rows if not v.misprint) < 0.8 * OUTLYING
    assert min(abs(v.score) for _, v in rows if v.misprint) > 1.4 * OUTLYING


def test_as_meant_the_table_has_no_misprint():
    """Mutation: a limit of 3 flags the row at B = 0.25, 3.3 from its neighbours then."""
    assert flagged(as_meant()) == []


@pytest.mark.parametrize("factor", [0.6, 1.5, 10.0])
@pytest.mark.parametrize("place", range(14, 21))
def test_any_other_misprint_there_would_have_been_found(place: int, factor: float):
    """4 ms, B = 0.05 to 0.23. Mutation: means in place of medians, in the line or in the spread."""
    rows = as_meant()
    true = rows[place].damping
    rows[place] = rows[place]._replace(damping=factor * true)
    assert flagged(rows) == [place]
    assert judged(rows, MODEL, PERIOD)[place].damping == pytest.approx(true, abs=0.005)


@pytest.mark.parametrize("place", range(14, 23))
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_misprinted_stiffness_is_no_misprint_of_the_damping(place: int, factor: float):
    """Mutation: the condition on the rest left out."""
    rows = as_meant()
    rows[place] = rows[place]._replace(stiffness=factor * rows[place].stiffness)
    verdict = judged(rows, MODEL, PERIOD)[place]
    assert verdict.rest > OUTLYING
    assert not verdict.misprint


def test_rows_of_another_smooth_plant_imply_their_own_damping():
    """A plant a tenth lighter, with half as much again of damping: the line in f follows it to 1 %.

    Mutation: the line's slope left out.
    """
    other = ModalModel(0.9 * MODEL.inertia, 1.5 * MODEL.damping, MODEL.modes)
    device = DEVICE_OF_TABLE_1.with_modal(other).with_interface(delay=0.004)
    rows: list[MeasuredPoint] = []
    for damping in (0.04, 0.06, 0.08, 0.1, 0.12, 0.14):
        point = critical_stiffness(device, damping)
        rows.append(
            MeasuredPoint(0.004, damping, point.stiffness or 0.0, point.frequency_hz or 0.0)
        )
    implied = [verdict.damping for verdict in judged(rows, MODEL, PERIOD)]
    np.testing.assert_allclose(implied, [row.damping for row in rows], rtol=0.01)


@pytest.mark.parametrize(("delay", "damping"), [(0.002, 0.03), (0.004, 0.23), (0.008, 0.1)])
def test_a_row_on_the_model_s_boundary_is_the_model(delay: float, damping: float):
    """Inverting eq. (2) gives the plant back, to 1e-6. Mutation: z^(d + 1) for z^d."""
    point = critical_stiffness(DEVICE_OF_TABLE_1.with_interface(delay=delay), damping)
    row = MeasuredPoint(delay, damping, point.stiffness or 0.0, point.frequency_hz or 0.0)
    found = inverted(row, MODEL, PERIOD)
    assert found.ratio(row.stiffness, row.damping) == pytest.approx(1.0, abs=1e-6)
    assert found.excess_damping(row.stiffness, row.damping) == pytest.approx(0.0, abs=1e-6)


def test_damping_beyond_the_model_is_seen_in_full():
    """A plant with 0.003 more to ground at 8 ms. Mutation: z^d left out of the excess."""
    more = ModalModel(MODEL.inertia, MODEL.damping + 0.003)
    device = DEVICE_OF_TABLE_1.with_modal(more).with_interface(delay=0.008)
    point = critical_stiffness(device, 0.05)
    row = MeasuredPoint(0.008, 0.05, point.stiffness or 0.0, point.frequency_hz or 0.0)
    found = inverted(row, ModalModel(MODEL.inertia, MODEL.damping), PERIOD)
    assert found.excess_damping(row.stiffness, row.damping) == pytest.approx(0.003, rel=0.02)


def test_too_few_rows_are_refused():
    with pytest.raises(ValueError, match="has 2 neighbours; before the jump of f it needs 3 rows"):
        judged(as_meant()[:3], MODEL, PERIOD)
    with pytest.raises(ValueError, match="after it 1 row whose f is within a tenth"):
        judged([*as_meant()[:5], as_meant()[12]], MODEL, PERIOD)

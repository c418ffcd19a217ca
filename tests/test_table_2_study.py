"""The study of Table II: exact on rows that a candidate made itself, and the device it ships."""

import numpy as np
import pytest

from zwidth.paper.fig_10 import ratio, revised
from zwidth.paper.table_2_fit import Held, fit, misfit
from zwidth.paper.table_2_study import good_rows, read, study
from zwidth.paper.table_2_theories import CANDIDATES, RATIO, theory
from zwidth.scenarios.table_2 import MeasuredPoint
from zwidth.stability.decomposition import from_plant, sampled

WINNER = "inertia and damping, limited amplifier"


def made_by(
    free: tuple[str, ...], x: list[float], places: list[tuple[float, float]]
) -> list[MeasuredPoint]:
    """Rows that a candidate reads at places (delay, B)."""
    values = np.array(x, dtype=np.float64)
    asked = [MeasuredPoint(delay, damping, 1.0, 1.0) for delay, damping in places]
    return [row._replace(stiffness=k, frequency=f)
            for row in asked for k, f in [read(free, values, row)]]  # fmt: skip


@pytest.mark.parametrize(
    ("free", "x"),
    [((), []), (("rho",), [0.05]), (("delay", "gain"), [3e-4, 0.1]), (("b", "v_2"), [0.3, 0.05])],
)
def test_rows_made_by_a_candidate_fit_it_exactly(free: tuple[str, ...], x: list[float]) -> None:
    """Reading by eigenvalues and error on the unit circle agree.

    Mutation: a damper of the wrong sign; the gain dividing the plant.
    """
    rows = made_by(free, x, [(0.002, 0.03), (0.004, 0.15), (0.008, 0.08)])
    assert np.abs(misfit(free, np.array(x), rows)).max() < 1e-4


@pytest.mark.parametrize("limit", [-0.3, 0.4])
def test_rows_beyond_the_corner_fit_the_limited_candidate_that_made_them(limit: float) -> None:
    """Mutation: N left out of the wall."""
    rows = made_by(("limit",), [limit], [(0.002, 0.11), (0.004, 0.27), (0.008, 0.14)])
    assert min(row.frequency for row in rows) > 100.0
    assert np.abs(misfit(("limit",), np.array([limit]), rows)).max() < 1e-3
    assert fit(("limit",), rows)[0] == pytest.approx(limit, abs=0.01)


def test_the_slope_gives_the_error_of_the_reading() -> None:
    """A row beyond the corner with K 1 % too large is read as 1 % too small.

    Mutation: the two components exchanged.
    """
    rows = made_by(("limit",), [0.2], [(0.004, 0.27)])
    wrong = [rows[0]._replace(stiffness=1.01 * rows[0].stiffness)]
    k, f = np.sinh(misfit(("limit",), np.array([0.2]), wrong)[-2:]) * (0.1, 0.02)
    assert k == pytest.approx(-0.01, rel=0.02)
    assert f == pytest.approx(0.0, abs=1e-5)


def test_an_oscillation_that_was_not_there_counts() -> None:
    """A row on the rigid branch beyond B_t, where the fast branch is unstable.

    Mutation: growth not counted.
    """
    (row,) = made_by((), [], [(0.002, 0.08)])
    beyond = row._replace(damping=0.12, stiffness=50.0)
    assert misfit((), np.zeros(0), [row])[2] == 0.0
    assert misfit((), np.zeros(0), [beyond])[2] > 10.0


def test_the_sampled_plant_is_that_of_the_device() -> None:
    """Mutation: the state that is read is not the position."""
    tried = theory(("delay",), np.array([3e-4]))
    z = np.exp(2j * np.pi * np.array([5.0, 40.0, 200.0]) * tried.period)
    device = tried.device(0.002)
    for damper in (0.0, 0.004):
        plant = Held(tried).plant(0.002 + tried.delay, damper).response(z)
        chain = device.chain._replace(
            ground_dampers=device.chain.ground_dampers + np.array([damper, 0.0, 0.0])
        )
        other = device.with_chain(chain)
        expected = sampled(from_plant(other.plant()), tried.period, *other.interface.delay_ticks, z)
        np.testing.assert_allclose(plant, expected, rtol=1e-6)


def test_the_shipped_device_is_the_winner_of_the_study() -> None:
    """Mutation: any digit of the device file."""
    found = theory(CANDIDATES[WINNER], fit(CANDIDATES[WINNER], good_rows()))
    device = revised()
    assert device.modal is not None
    assert device.modal.inertia == pytest.approx(found.model.inertia, rel=1e-4)
    assert device.modal.damping == pytest.approx(found.model.damping, rel=1e-4)
    assert device.modal.modes == found.model.modes
    assert ratio(device) == pytest.approx(found.ratio, rel=1e-4)
    assert found.ratio != RATIO


def test_the_winner_halves_the_error_of_rows_left_out_in_both_parts() -> None:
    """Mutation: no limit in the winner leaves part II at 8.4; the row not left out."""
    (paper,), (ours,) = study(["Table I (the paper's)"]), study([WINNER])
    assert len(good_rows()) == 24
    assert (paper.left_out.part_1, paper.left_out.part_2) == pytest.approx((8.51, 11.93), abs=0.01)
    assert ours.left_out.part_1 < 0.4 * paper.left_out.part_1
    assert ours.left_out.part_2 < 0.4 * paper.left_out.part_2
    assert ours.left_out.part_1 > 1.1 * ours.fitted.part_1
    assert ours.left_out.without == 0

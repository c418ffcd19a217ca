"""The one cost: Laplace against integrals, overdispersion against what is known of it."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.signal import lfilter

from tests.diagnosis_examples import phantom
from zwidth.controllers.excitation import noise as excited
from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis.selection.evidence import (
    ALPHA,
    Compared,
    Cost,
    believed,
    compared,
    freedom,
    probabilities,
    rarity,
)
from zwidth.diagnosis.selection.hypothesis import judged, settled
from zwidth.sim.physics import make_physics
from zwidth.sim.run import simulate

Floats = NDArray[np.float64]


def test_of_one_magnitude_the_cost_is_the_evidence() -> None:
    """-2 ln of the integral of p(y | m) over m uniform in its range. Mutation: no ln 2 pi."""
    random = np.random.default_rng(2)
    shape, reach = random.normal(size=50), 3.0
    y = 0.8 * shape + random.normal(size=50)

    def misfit(m: float) -> float:
        return float(np.sum((y - m * shape) ** 2))

    best = float(shape @ y / (shape @ shape))
    least = misfit(best)
    area, _ = quad(lambda m: math.exp(-0.5 * (misfit(m) - least)) / reach, -0.5, 2.5)
    found = least + freedom(np.array([[shape @ shape]]), [reach])
    assert found == pytest.approx(least - 2.0 * math.log(area), abs=1e-6)


def test_a_linear_parameter_with_a_prior_is_integrated_too() -> None:
    """Gaussian prior of 1 on x, uniform on m; exact, since all is quadratic in both."""
    random = np.random.default_rng(4)
    columns, reach = random.normal(size=(40, 2)), 2.0
    y = columns @ np.array([0.3, 0.9]) + random.normal(size=40)

    def misfit(x: float, m: float) -> float:
        return float(np.sum((y - columns @ np.array([x, m])) ** 2)) + x * x

    information = columns.T @ columns + np.diag([1.0, 0.0])
    best = np.linalg.solve(information, columns.T @ y)
    with_it = misfit(*best) + freedom(information, [reach])
    alone = float(columns[:, 0] @ y / (columns[:, 0] @ columns[:, 0] + 1.0))
    without = misfit(alone, 0.0) + freedom(information[:1, :1], [])
    x, m = (np.linspace(b - 2.0, b + 2.0, 801) for b in best)
    grid = np.array([[misfit(a, b) for b in m] for a in x]) - misfit(*best)
    volume = np.sum(np.exp(-0.5 * grid)) * (x[1] - x[0]) * (m[1] - m[0]) / reach
    line = np.exp(
        -0.5 * np.array([misfit(a, 0.0) - misfit(alone, 0.0) for a in x + alone - best[0]])
    )
    area = np.sum(line) * (x[1] - x[0])
    exact = misfit(*best) - misfit(alone, 0.0) - 2.0 * math.log(volume / area)
    assert with_it - without == pytest.approx(exact, abs=1e-3)


def test_what_is_rare_costs_more() -> None:
    common, rare = rarity([0.3]), rarity([0.01])
    assert rare - common == pytest.approx(2.0 * math.log(0.3 / 0.7 * 0.99 / 0.01))
    assert Cost(1.0, 2.0, rare, 4.0).total == pytest.approx(7.0 + rare)


def test_what_says_nothing_of_a_parameter_is_not_believed() -> None:
    assert freedom(np.diag([1.0, 0.0]), [1.0]) == math.inf
    assert not believed(Cost(0.0, math.inf), Cost(1e9))


def test_a_claim_is_believed_beyond_the_one_threshold() -> None:
    least = 2.0 * math.log(1.0 / ALPHA)
    assert believed(Cost(0.0), Cost(least + 0.01))
    assert not believed(Cost(0.0), Cost(least - 0.01))
    assert not believed(Cost(0.0), Cost(least + 0.01), phi=2.0)


@pytest.mark.parametrize("reach", [0.0, math.inf])
def test_a_range_that_is_none_is_refused(reach: float) -> None:
    with pytest.raises(ValueError, match="ranges"):
        freedom(np.eye(1), [reach])


@pytest.mark.parametrize("odds", [0.0, 1.0])
def test_odds_that_are_none_are_refused(odds: float) -> None:
    with pytest.raises(ValueError, match="odds"):
        rarity([odds])


def gains_of(difference: Floats, error: Floats, blocks: int) -> Floats:
    each = difference**2 + 2.0 * difference * error
    return each.reshape(blocks, -1).sum(axis=1)


def test_of_a_true_hypothesis_the_overdispersion_is_one() -> None:
    """Mean over 200 recordings. Mutation: 2 in place of 4."""
    random = np.random.default_rng(6)
    found: list[float] = []
    gains = np.zeros(0)
    for _ in range(200):
        difference = 0.3 * np.sign(random.normal(size=8000))
        gains = gains_of(difference, random.normal(size=8000), 40)
        found.append(compared(gains, lags=0).phi)
    assert np.mean(found) == pytest.approx(1.09, abs=0.05)  # those below one count as one
    assert compared(gains).sigma == pytest.approx(math.sqrt(gains.sum()), rel=0.25)


def test_slow_errors_count_less() -> None:
    """Errors and difference of 0.99 from one sample to the next: about 100 times fewer of them."""
    random = np.random.default_rng(7)
    slow = lfilter([1.0], [1.0, -0.99], random.normal(size=(2, 40_000)), axis=1)
    error, difference = slow / np.std(slow, axis=1, keepdims=True) * np.array([[1.0], [0.3]])
    found = compared(gains_of(difference, error, 40))
    assert 30.0 < found.phi < 300.0
    assert found.sigma == pytest.approx(math.sqrt(abs(found.gain) / found.phi))


def test_what_acts_in_some_stretches_only_is_no_scatter() -> None:
    """A difference in a tenth of the blocks. Mutation: the scatter about the mean of the blocks."""
    random = np.random.default_rng(8)
    found: list[float] = []
    for _ in range(100):
        difference = np.where(np.arange(8000) % 2000 < 200, 0.5, 0.0)
        gains = gains_of(difference, random.normal(size=8000), 40)
        foretold = (difference**2).reshape(40, -1).sum(axis=1)
        found.append(compared(gains, foretold, lags=0).phi)
        assert compared(gains, lags=0).phi > 5.0
    assert np.mean(found) == pytest.approx(1.1, abs=0.1)


def test_what_the_difference_does_not_foretell_is_scatter() -> None:
    """What one gains where the other predicts the same: one of them knows a stretch by chance."""
    random = np.random.default_rng(9)
    foretold = random.uniform(1.0, 2.0, size=40)
    gains = foretold * np.where(np.arange(40) % 4 < 2, 5.0, -3.0)
    assert compared(gains, foretold).phi > 2.5


def test_few_blocks_have_no_scatter() -> None:
    assert compared(np.array([3.0, 5.0])) == Compared(8.0, 1.0)
    assert compared(np.array([-3.0, -5.0])).sigma == -math.sqrt(8.0)


def test_shares_sum_to_one_and_follow_the_cost() -> None:
    shares = probabilities([10.0, 12.0, 1e4])
    assert shares.sum() == pytest.approx(1.0)
    assert shares[0] / shares[1] == pytest.approx(math.e)
    assert probabilities([10.0, 12.0], phi=1e3)[0] == pytest.approx(0.5, abs=1e-3)


def test_shares_are_right_as_often_as_they_say() -> None:
    """A level that is there in half of 4000 recordings, uniform over its range, judged by cost.

    Mutation: the price of freedom left out.
    """
    random, reach, samples = np.random.default_rng(8), 4.0, 30
    said, true = np.zeros(4000), np.zeros(4000)
    for i in range(4000):
        there = random.random() < 0.5
        y = random.normal(size=samples) + there * random.uniform(-0.5, 0.5) * reach
        best = float(np.clip(y.mean(), -0.5 * reach, 0.5 * reach))
        misfit, known = float(np.sum((y - best) ** 2)), np.array([[float(samples)]])
        with_it = misfit + freedom(known, [reach])
        said[i] = probabilities([with_it, float(np.sum(y**2))])[0]
        true[i] = there
    for low, high in ((0.0, 0.2), (0.2, 0.6), (0.6, 0.95), (0.95, 1.0)):
        some = (said > low) & (said <= high)
        assert np.count_nonzero(some) > 100
        assert true[some].mean() == pytest.approx(said[some].mean(), abs=0.05)


def test_an_origin_that_velocities_do_not_see_costs_nothing_and_hides_nothing() -> None:
    """A device on a spring, of which only the velocity is recorded.

    Mutation: freedom of all linear parameters, infinite then in every hypothesis, so that friction
    at 12 sigma was never believed.
    """
    device = phantom().with_chain(phantom().chain._replace(ground_spring=2.0))
    u = excited(duration=2.0, seed=3)
    rubs = make_physics("coulomb_friction", "m1", level=0.01)
    run = simulate(device.with_physics(rubs), recorded(u), duration=2.0, substeps=20)
    v = run.trace["velocity_m1"]
    v = v + 1e-3 * v.std() * np.random.default_rng(1).standard_normal(v.size)
    taken = [Experiment(0.001, u, v[:, None], (Output("velocity", 0),))]
    model = Model(device)
    plain = settled(judged(taken, model, np.zeros(model.linear_count)))
    more = model.with_effect(rubs, {"level": 0.01})
    found = settled(judged(taken, more, np.append(plain.x, 0.0)))
    assert "origin" in {p.name for p in model.parameters}
    assert math.isfinite(plain.cost.freedom)
    assert believed(found.cost, plain.cost)

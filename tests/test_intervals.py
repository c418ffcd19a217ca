"""Truths of the intervals of a fit whose residual is neither white nor as large at all times."""

import numpy as np
import pytest
from diagnosis_examples import phantom, record
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.descend import ground_of, slopes_at
from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.fitting.reach import reaches
from zwidth.diagnosis.fitting.uncertainty import covariance, spans, standard_errors
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.settle import settle
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.physics import make_physics

Floats = NDArray[np.float64]
SAMPLES, DRAWS = 1000, 200
MODEL = Model(Device("mass", "", False, make_chain([0.5], [0.0])))


def of(slopes: Floats, residual: Floats) -> Fitted:
    """Return a fit of one parameter, without a prior."""
    x = np.zeros(1)
    return Fitted(MODEL, x, float(residual @ residual), residual, slopes[:, None], SAMPLES)


def told_and_scattered(slopes: Floats, residuals: Floats) -> tuple[float, float]:
    """The standard error that is told (rms), and how much the estimates scatter."""
    rows = np.linalg.pinv(slopes[:, None])[0]
    told = [float(covariance(of(slopes, r))[0, 0]) for r in residuals]
    return float(np.sqrt(np.mean(told))), float(np.std(residuals @ rows))


def test_a_parameter_that_shows_where_noise_is_large_is_known_less_well() -> None:
    """A tenth of the samples tells of it, and errs three times as much as all do on the mean.

    Mutation that breaks it: variances from the spectrum alone, a third of the scatter.
    """
    draw = np.random.default_rng(1)
    tells = np.arange(SAMPLES) % 50 < 5
    size = np.where(tells, 3.0, 1.0 / 3.0)
    residuals = size * draw.standard_normal((DRAWS, SAMPLES))
    told, scattered = told_and_scattered(np.where(tells, 1.0, 0.0), residuals)
    assert told == pytest.approx(scattered, rel=0.15)


def test_what_errs_together_at_a_turn_counts_once() -> None:
    """Five samples in a row that err alike tell as much as one of them.

    Mutation that breaks it: no products of neighbours, half of the scatter.
    """
    draw = np.random.default_rng(2)
    tells = np.arange(SAMPLES) % 50 < 5
    alike = np.repeat(draw.standard_normal((DRAWS, SAMPLES // 50)), 50, axis=1)
    residuals = np.where(tells, 3.0 * alike, draw.standard_normal((DRAWS, SAMPLES)) / 3.0)
    told, scattered = told_and_scattered(np.where(tells, 1.0, 0.0), residuals)
    assert told == pytest.approx(scattered, rel=0.25)


def test_a_white_residual_needs_no_more() -> None:
    """Within 5 %: the larger of two estimates is larger, and by little."""
    residuals = np.random.default_rng(3).standard_normal((DRAWS, SAMPLES))
    told, scattered = told_and_scattered(np.ones(SAMPLES), residuals)
    assert told == pytest.approx(1.0 / np.sqrt(SAMPLES), rel=0.05)
    assert told == pytest.approx(scattered, rel=0.15)


# Where the likelihood is no parabola


@pytest.fixture(scope="module")
def bristles() -> tuple[Problem, Fitted, int]:
    """Friction whose bristles' stiffness is known to a fifth, and where that stands in x."""
    level, stiffness = 0.002, 40.0
    bends = make_physics("presliding_friction", "m1", level=level, stiffness=stiffness)
    e = record(phantom().with_physics(bends), 1.5, seed=6)
    model = Model(phantom(), (bends,), ({"level": level, "stiffness": stiffness},))
    problem, final = settle([e], model, np.zeros(len(model.parameters)))
    return problem, final, [p.key for p in model.parameters].index("stiffness")


def refitted(problem: Problem, model: Model, x: Floats, held: int) -> float:
    """The cost with one parameter held at its x and all others fitted anew."""
    ground = ground_of(problem, model)
    cost = np.inf
    for _ in range(6):
        at = slopes_at(ground, x, np.full(x.size, 1e-3), both=True)
        cost = min(cost, ground.cost(at.residual))
        slopes = np.delete(at.slopes, held, axis=1)
        step = -np.linalg.lstsq(slopes, at.residual, rcond=None)[0]
        x = x + np.insert(step, held, 0.0)
    return cost


def test_an_interval_reaches_as_far_as_the_likelihood(
    bristles: tuple[Problem, Fitted, int],
) -> None:
    """The stiffer a bristle, the less its stiffness shows: the interval is longer upwards.

    With all other parameters refitted at its upper end, -2 ln likelihood has risen by 1.96^2.
    Mutation that breaks it: 1.96 standard errors on both sides (2.77 for 3.84).
    """
    problem, final, held = bristles
    errors = standard_errors(final)
    ((below, above),) = reaches(problem, final, spans(final), [held])
    share = errors[held] ** 2 / np.linalg.inv(final.jacobian.T @ final.jacobian)[held, held]
    coarse = Problem(problem.experiments, problem.observer)
    least = refitted(coarse, final.model, final.x, held)
    x = final.x + above * (np.arange(final.x.size) == held)
    risen = (refitted(coarse, final.model, x, held) - least) / share
    assert risen == pytest.approx(1.96**2, rel=0.15)
    assert above > 1.2 * 1.96 * errors[held]
    assert below == pytest.approx(1.96 * errors[held], rel=1e-3)

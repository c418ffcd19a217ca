"""Whether what was found holds where it was not fitted: direction, level, recording, place."""

from dataclasses import replace

import numpy as np
import pytest
from fitting_examples import drive, recording

from zwidth.diagnosis.answer.regimes import foretold_by_rest, held, regimes, step_without
from zwidth.diagnosis.fitting.descend import fit
from zwidth.diagnosis.fitting.fit import Problem
from zwidth.diagnosis.fitting.landscape import Landscape
from zwidth.diagnosis.fitting.straight import along
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.hypothesis import Hypothesis, judged, settled
from zwidth.sim.device import Device
from zwidth.sim.physics import make_physics

TICKS = 4000
FRICTION = make_physics("coulomb_friction", "m1", level=0.03)


def fitted(experiments: list[Experiment], friction: bool) -> Hypothesis:
    model = Model(drive())
    if friction:
        model = model.with_effect(FRICTION, {"level": 0.03})
    return settled(judged(experiments, model, np.zeros(len(model.parameters))))


def of(truth: Device) -> Experiment:
    return recording(truth, TICKS, 3)


def test_friction_that_is_there_holds_everywhere():
    """Mutation that breaks it: the step taken the other way (`dx` negative)."""
    e = [of(drive().with_physics(FRICTION))]
    said = held(fitted(e, True), fitted(e, False))
    assert {"forwards", "backwards"} <= {h.regime for h in said}
    assert not [h for h in said if h.fails]
    assert min(h.sigma for h in said) > 5.0


def test_friction_of_one_of_two_recordings_is_not_that_of_both():
    """Fitted to both it is believed, and of neither does the other say how much.

    Mutation that breaks it: the regime left in the fit (`dx` zero).
    """
    for levels, fails in (((6e-3, 0.0), True), ((3e-3, 3e-3), False)):
        truths = [drive().with_physics(replace(FRICTION, values={"level": v})) for v in levels]
        e = [
            replace(recording(truth, TICKS, 3 + 2 * i), name=f"r{i}")
            for i, truth in enumerate(truths)
        ]
        with_it, without = fitted(e, True), fitted(e, False)
        assert with_it.cost.total < without.cost.total
        # One recording may tell too little of a parameter alone for the other to be asked.
        said = [h for h in held(with_it, without) if h.regime in ("in r0", "in r1")]
        assert said
        assert any(h.fails for h in said) == fails
        assert {h.other for h in said} == {"in the other recordings"}


def test_a_step_of_the_fit_leaves_a_regime_out():
    """The one step against a fit to the rest, made of it alone under the same noise.

    Mutations that break it: the step the other way; the priors, or the regime, not taken off.
    """
    e = [
        replace(of(drive()), name="r0"),
        replace(recording(drive(), TICKS, 4), name="r1"),
    ]
    both = fitted(e, False)
    (second,) = [r for r in regimes(e) if r.name == "in r1"]
    assert second.where.sum() == TICKS - SETTLING
    slopes, samples, problem = both.slopes, both.samples, both.problem
    assert slopes is not None
    rows, prior = both.residual[:samples, None], (both.residual[samples:], slopes[samples:])
    found = step_without(rows, slopes[:samples, None, :], prior, second.where)
    alone = fit(Problem(problem.experiments[:1], problem.observer), both.model, both.x)
    assert found is not None
    (curve,) = along(both.model, both.x, [found[0]], (0.25, 0.5, 1.0))
    rest = Landscape(problem.experiments[:1], problem.observer, both.model, problem.fineness)
    before, stepped, fitted_alone = rest.costs([both.x, curve[-1], alone.x])
    assert stepped < fitted_alone + 0.2
    assert before > fitted_alone + 0.5


@pytest.mark.parametrize("told", [1.0, 0.1])
def test_what_the_rest_predicts_is_a_density(told: float):
    """-2 log of p(regime | rest) is that of all over that of the rest, for any linear model.

    Here the mean of normal numbers with a wide prior, of which the rest has more or fewer than the
    regime. Mutations that break it: u' u in place of u' C^-1 u; without log det C.
    """
    random = np.random.default_rng(4)
    y = random.standard_normal(40) + 0.3
    where = np.arange(40) >= 40 * told / (1.0 + told)
    prior = np.zeros(1), np.full((1, 1), 1e-2)
    best = y.sum() / (40 + 1e-4)
    rows, slopes = (best - y)[:, None], np.ones((40, 1, 1))
    found = foretold_by_rest(rows, slopes, (prior[1][:, 0] * best, prior[1]), where)

    def evidence(part: np.ndarray) -> float:
        information = part.size + 1e-4
        left = float(np.sum(part**2) - part.sum() ** 2 / information)
        return left + float(np.log(information / 1e-4))

    assert found is not None
    assert found.costs.sum() == pytest.approx(evidence(y) - evidence(y[~where]), rel=1e-9)
    mean = y[~where].sum() / ((~where).sum() + 1e-4)
    np.testing.assert_allclose(found.errors[:, 0], mean - y[where], rtol=1e-9)


def test_a_regime_says_nothing_if_all_samples_leave_a_parameter_open():
    """A phase of a ripple of size zero. Mutation: the error of the eigenvalues let through."""
    rows, slopes = np.ones((40, 1)), np.ones((40, 1, 2))  # the sum of both alone is seen
    prior = np.zeros(0), np.zeros((0, 2))
    assert step_without(rows, slopes, prior, np.arange(40) < 20) is None

"""Fits that spare slopes, observers chosen from nearby, and noise that stands for physics."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from tests.diagnosis_examples import ENCODER_NOISE, phantom, record
from zwidth.diagnosis.answer.validate import held_out
from zwidth.diagnosis.fitting.fit import Fitted, Problem, Slopes
from zwidth.diagnosis.forces import unknown
from zwidth.diagnosis.mishaps import silent
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.predictor import choose_observer
from zwidth.diagnosis.noise.settle import cost_at, prepared_for, refit
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.effort import NORMAL
from zwidth.diagnosis.selection.hypothesis import judged, settled
from zwidth.diagnosis.selection.search import Search
from zwidth.diagnosis.selection.searched import Searched
from zwidth.sim.physics import make_physics
from zwidth.sim.uncertainty import Uncertainty

Floats = NDArray[np.float64]


class Counted(Problem):
    """A problem that counts its predictions."""

    predictions = 0

    def weighted(self, model: Model, x: Floats, least: int = 1) -> Floats:
        self.predictions += 1
        return super().weighted(model, x, least)

    def weighted_each(self, model: Model, xs: Sequence[Floats], least: int = 1) -> list[Floats]:
        self.predictions += len(xs)
        return super().weighted_each(model, xs, least)


def test_spared_slopes_lead_to_the_same_minimum_with_fewer_predictions(
    monkeypatch: pytest.MonkeyPatch,
):
    """Against the same fit that computes all slopes anew.

    Mutations that break it: the correction along the step with its sign turned; slopes never
    computed anew (the minimum is missed).
    """
    device = replace(phantom(), uncertainty=Uncertainty(command_scale=0.05))
    truth = device.with_physics(make_physics("quadratic_drag", "m1", coefficient=2e-3))
    e = record(truth, 3.0, seed=3)
    model = Model(device, (make_physics("quadratic_drag", "m1", coefficient=5e-4),))
    model = replace(model, scales=({"coefficient": 1e-3},))
    prepared, _ = refit(device, [e])

    def fitted() -> tuple[Fitted, int]:
        problem = Counted(prepared.experiments, prepared.observer)
        start = np.full(len(model.parameters), 0.7)
        return problem.fit(model, start, rounds=30), problem.predictions

    sparing, few = fitted()
    monkeypatch.setattr(Slopes, "corrected", lambda self, x, found: None)
    thorough, many = fitted()
    assert sparing.chi2 == pytest.approx(thorough.chi2, abs=0.1)
    assert few < 0.6 * many
    fresh = prepared.jacobian(model, sparing.x)
    size = np.linalg.norm(fresh, axis=0)
    live = size > 1e-3 * size.max()
    assert np.linalg.norm(sparing.jacobian - fresh, axis=0)[live] == pytest.approx(
        0.0, abs=0.05 * size.max()
    )


def test_slopes_that_foretold_a_step_are_corrected_along_it():
    """Broyden's: J' d = r - r_0, and J' w = J w for all w across d.

    Mutation that breaks it: the outer product turned round, or over |d| instead of its square.
    """
    random = np.random.default_rng(1)
    bent, steep = random.standard_normal((2, 5, 2))
    asked: list[np.ndarray] = []

    def residual(x: np.ndarray) -> np.ndarray:
        return 10.0 + steep @ x + 0.05 * bent @ x**2

    def slopes(x: np.ndarray, _: np.ndarray) -> np.ndarray:
        asked.append(x)
        return steep + 0.1 * bent * x

    found = Slopes(residual, slopes)
    zero, d = np.zeros(2), np.array([-0.3, 0.2])
    first = found.slope(zero)
    kept = found.slope(d)
    assert len(asked) == 1
    assert kept @ d == pytest.approx(residual(d) - residual(zero))
    across = np.array([0.2, 0.3])
    assert kept @ across == pytest.approx(first @ across)
    assert not np.allclose(kept, first)
    found.slope(np.array([40.0, -40.0]))  # far off, where the slopes foretell badly
    assert len(asked) == 2


def test_an_observer_chosen_from_nearby_is_the_likeliest_of_all():
    """Mutation that breaks it: a walk that stops after one step."""
    e = record(phantom(), 3.0, seed=5)
    best = choose_observer(phantom(), [e]).ratio
    for decades in (-2.0, 0.0, 2.0):
        assert choose_observer(phantom(), [e], best * 10.0**decades).ratio == best


def test_a_hypothesis_stands_under_the_likeliest_model_of_its_noise():
    """Readings of long memory ask for a slower observer, white ones for the one of the refit.

    Whitened, another observer is another model of the noise: it alone makes a recording likelier,
    so hypotheses compare only each under its own likeliest.

    Mutation that breaks it: the observer of white noise kept whatever the noise.
    """
    ratios: list[float] = []
    for long in (False, True):
        e = _of_memory(long)
        problem, fitted = refit(phantom(), [e])
        own, ratio = problem.cost(fitted), problem.observer.ratio
        assert cost_at(ratio, fitted, problem.experiments) == pytest.approx(own, abs=0.5)
        h = settled(judged([e], fitted.model, fitted.x))
        ratios.append(h.ratio)
        assert (h.cost.misfit < own - 10.0) is long
    assert ratios[1] < 0.2 * ratios[0]


def _of_memory(long: bool) -> Experiment:
    """The PHANToM read with white noise, and with a noise of 0.9 from tick to tick."""
    e = record(phantom(), 4.0, seed=12)
    random = np.random.default_rng(112)
    colour = lfilter([3.0 * ENCODER_NOISE], [1.0, -0.9], random.standard_normal(e.ticks))
    return replace(e, measured=e.measured + colour[:, None]) if long else e


def test_a_free_force_must_gain_more_than_another_model_of_the_noise(
    monkeypatch: pytest.MonkeyPatch,
):
    """A force that gains 100, where a slower observer gains 150 without it and 160 with it.

    Mutation that breaks it: a weak force held against the model under its own observer alone.
    """
    problem, fitted = refit(phantom(), [record(phantom(), 2.0, seed=12)])
    own, forced = problem.cost(fitted), [*problem.experiments]
    shape = unknown.Shape("m1", "position", np.eye(3)[0], [], lambda *_: shape)
    ratio = problem.observer.ratio

    def cost(asked: float, _: Fitted, seen: object) -> float:
        return own - (160.0 if seen is forced else 150.0) if asked < 0.5 * ratio else own

    monkeypatch.setattr(unknown, "_gains", lambda *_: [unknown.Gained(shape, np.ones(2), 100.0)])
    with_force = unknown.Forced(own - 100.0, fitted, ratio, forced)
    monkeypatch.setattr(unknown, "_with_force", lambda *_: with_force)
    monkeypatch.setattr(unknown, "alone", lambda *_: own)
    monkeypatch.setattr(unknown, "cost_at", cost)
    found = unknown.unknown(problem.experiments, fitted)
    assert found is not None
    assert found.gained == pytest.approx(10.0, abs=0.5)


def test_held_out_data_begin_where_they_fit():
    """A device in motion at their start, under an observer that takes long to find it.

    Mutation that breaks it: the observer begins at rest.
    """
    e = record(phantom(), 4.0, seed=12)
    _, fitted = refit(phantom(), [e])
    slow = prepared_for([e], fitted.model, fitted.x, 1e-8, white=True)
    there = slow.fit(fitted.model, fitted.x)
    plain = judged([e], fitted.model, fitted.x)
    tried = Search(plain, plain, NORMAL, silent)
    found = Searched(slow, there, there, tried, slow.observer)
    one, _ = held_out(phantom(), found, [e.part(2000, 4000)])
    assert one.after < 2.0 * one.noise_floor

"""Fits that spare slopes, observers chosen from nearby, and noise that stands for physics."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from tests.diagnosis_examples import ENCODER_NOISE, phantom, record
from zwidth.diagnosis.answer.held_out import held_out
from zwidth.diagnosis.fitting.descend import fit
from zwidth.diagnosis.forces import unknown
from zwidth.diagnosis.mishaps import silent
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import NEXT_SAMPLE, likeliest
from zwidth.diagnosis.noise.settle import cost_at, prepared_for, refit
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.effort import NORMAL
from zwidth.diagnosis.selection.hypothesis import judged, settled
from zwidth.diagnosis.selection.search import Search
from zwidth.diagnosis.selection.searched import Searched

Floats = NDArray[np.float64]


def test_an_observer_chosen_from_nearby_is_the_likeliest_of_all():
    """Mutation that breaks it: a neighbourhood of less than two decades."""
    e, model = record(phantom(), 3.0, seed=5), Model(phantom())
    x = np.zeros(model.linear_count)
    best = likeliest([e], model, x).observer.ratio
    for decades in (-2.0, 0.0, 2.0):
        near = NEXT_SAMPLE.near(best * 10.0**decades)
        assert likeliest([e], model, x, near).observer.ratio == best


def test_a_hypothesis_stands_under_the_likeliest_model_of_its_noise():
    """Readings of long memory ask for a slower observer than white ones do, and each for its own.

    Whitened, another observer is another model of the noise: it alone makes a recording likelier,
    so hypotheses compare only each under its own likeliest. A refit has the noise of a hypothesis.

    Mutation that breaks it: the observer of white noise kept whatever the noise.
    """
    ratios: list[float] = []
    for long in (False, True):
        e = _of_memory(long)
        problem, fitted = refit(phantom(), [e])
        own, ratio = problem.cost(fitted), problem.observer.ratio
        assert cost_at(ratio, fitted.model, fitted.x, problem.experiments) == pytest.approx(
            own, abs=0.5
        )
        h = settled(judged([e], fitted.model, fitted.x))
        assert h.cost.misfit == pytest.approx(own, abs=0.5)
        ratios.append(h.ratio)
    assert ratios[1] < 0.2 * ratios[0]
    assert cost_at(ratios[0], fitted.model, fitted.x, problem.experiments) > own + 10.0


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

    def cost(asked: float, _: Model, __: Floats, seen: object) -> float:
        return own - (160.0 if seen is forced else 150.0) if asked < 0.5 * ratio else own

    monkeypatch.setattr(unknown, "_gains", lambda *_: [unknown.Gained(shape, np.ones(2), 100.0)])
    with_force = unknown.Forced(own - 100.0, fitted.x, ratio, forced)
    monkeypatch.setattr(unknown, "_with_force", lambda *_: with_force)
    monkeypatch.setattr(unknown, "alone", lambda *_: own)
    monkeypatch.setattr(unknown, "cost_at", cost)
    found = unknown.unknown(problem.experiments, fitted)
    assert found is not None
    assert found.gained == pytest.approx(10.0, abs=0.5)


def test_a_free_force_acts_beside_an_event_on_fewer_masses():
    """A hit on the first link of three masses, which the recording knows of."""
    e = record(phantom(), 2.0, seed=12)
    hit = np.zeros((e.ticks, 2))
    hit[900:910] = [[0.05, -0.05]]
    knowing = e.pushed_by(hit)
    assert knowing.pushed_by(np.ones((e.ticks, 3))).external(3)[905].tolist() == [1.05, 0.95, 1.0]
    _, fitted = refit(phantom(), [knowing])
    assert unknown.unknown([knowing], fitted) is not None


def test_held_out_data_begin_where_they_fit():
    """A device in motion at their start, under an observer that takes long to find it.

    Mutation that breaks it: the observer begins at rest.
    """
    e = record(phantom(), 4.0, seed=12)
    _, fitted = refit(phantom(), [e])
    slow = prepared_for([e], fitted.model, fitted.x, NEXT_SAMPLE.of(1e-8))
    there = fit(slow, fitted.model, fitted.x)
    plain = judged([e], fitted.model, fitted.x)
    tried = Search(plain, plain, NORMAL, silent)
    found = Searched(slow, there, there, tried, slow.observer)
    one, _ = held_out(phantom(), found, [e.part(2000, 4000)])
    assert one.after < 2.0 * one.noise_floor

"""Fits that spare slopes, observers chosen from nearby, and trials that are not worth settling."""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from tests.diagnosis_examples import ENCODER_NOISE, phantom, record
from zwidth.diagnosis import removal, trials, unknown, views
from zwidth.diagnosis.creases import SMOOTH, across_creases, along_gaps, over_creases
from zwidth.diagnosis.experiment import Experiment
from zwidth.diagnosis.fit import Fitted, Problem, Slopes
from zwidth.diagnosis.held_out import held_out
from zwidth.diagnosis.parameters import Model, effect_labels
from zwidth.diagnosis.predictor import FINAL, choose_observer
from zwidth.diagnosis.search import Searched
from zwidth.diagnosis.settle import (
    NotWorth,
    cost_at,
    prepared_for,
    refit,
    settle,
    under_likeliest_noise,
)
from zwidth.diagnosis.uncertainty import Z95, covariance
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics

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
    truth = phantom().with_physics(make_physics("quadratic_drag", "m1", coefficient=2e-3))
    e = record(truth, 3.0, seed=3)
    model = Model(phantom(), (make_physics("quadratic_drag", "m1", coefficient=5e-4),))
    model = replace(model, scales=({"coefficient": 1e-3},))
    prepared, _ = refit(phantom(), [e])

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


def test_a_trial_that_explains_too_little_is_not_settled():
    """Mutation that breaks it: `worth` not looked at."""
    e = record(phantom(), 3.0, seed=6)
    problem, fitted = refit(phantom(), [e])
    own = problem.cost(fitted)
    with pytest.raises(NotWorth, match="linear explains too little"):
        settle([e], fitted.model, fitted.x, own - 10.0)
    assert settle([e], fitted.model, fitted.x, own + 1.0)[1].chi2 == pytest.approx(
        fitted.chi2, rel=1e-3
    )


def test_an_effect_beyond_doubt_is_kept_without_a_fit(monkeypatch: pytest.MonkeyPatch):
    """And one that explains nothing is removed, by a fit.

    Mutation that breaks it: the comparison turned round.
    """
    asked: list[int] = []
    real = removal.fit_without

    def counted(problem: Problem, fitted: Fitted, index: int) -> Fitted:
        asked.append(index)
        return real(problem, fitted, index)

    monkeypatch.setattr(removal, "fit_without", counted)
    sure = make_physics("cubic_stiffness", "ground", coefficient=0.5)
    e = record(phantom().with_physics(sure), 3.0, seed=7)
    problem, _ = refit(phantom(), [e], (sure,))
    idle = make_physics("quadratic_drag", "m1", coefficient=1e-9)
    for effects, scales, kept, fits in (
        ((sure,), ({"coefficient": 0.5},), ["cubic_stiffness@ground"], 0),
        (
            (sure, idle),
            ({"coefficient": 0.5}, {"coefficient": 1e-6}),
            ["cubic_stiffness@ground"],
            1,
        ),
    ):
        fitted = problem.fit(Model(phantom(), effects, scales))
        asked.clear()
        pruned = removal.prune(problem, fitted)
        assert effect_labels(pruned.model.effects) == kept
        assert len(asked) == fits


def test_a_claim_must_beat_the_model_without_it_from_the_same_place():
    """A refit that stopped short of its minimum gains by anything that is fitted on from there.

    Mutation that breaks it: `settled_without` returns None always.
    """
    e = record(phantom(), 3.0, seed=8)
    problem, best = refit(phantom(), [e])
    short = best.x.copy()
    short[0] += 0.5  # a mass of 1.1 times its best
    there = prepared_for(problem.experiments, best.model, short)
    stopped = there.at(best.model, short)
    claim = best.model.with_effect(make_physics("quadratic_drag", "m1", coefficient=1e-9), {})
    trial = trials.Trial("quadratic_drag@m1", best, 100.0, 1)
    settled = replace(best, model=claim)
    answer = views.Answer(
        trials.Step((trial,), trial, 1.0),
        trial,
        problem,
        False,
        problem,
        settled,
        problem.cost(best),
    )
    asked = views.Asked(there, stopped, answer.step, [answer], [])
    again = views.settled_without(asked)
    assert again is not None
    assert again[0].cost(again[1]) == pytest.approx(problem.cost(best), abs=1.0)
    content = views.Asked(problem, best, answer.step, [answer], [])
    assert views.settled_without(content) is None


def test_a_claim_must_not_live_on_another_observer(monkeypatch: pytest.MonkeyPatch):
    """Readings of long memory: ten times slower, an observer is likelier with nothing missing.

    Mutation that breaks it: a claim held against the model under its own observer alone.
    """
    problem, fitted = refit(phantom(), [_of_memory(True)])
    own, ratio = problem.cost(fitted), problem.observer.ratio
    assert cost_at(ratio, fitted, problem.experiments) == pytest.approx(own, abs=0.5)
    slow = prepared_for(problem.experiments, fitted.model, fitted.x, 0.1 * ratio, white=True)
    there = slow.fit(fitted.model, fitted.x)
    likelier = own - slow.cost(there)
    assert likelier > 10.0
    trial = trials.Trial("quadratic_drag@m1", there, 20.0, 0)
    step = trials.Step((trial,), trial, 1.0)
    answer = views.Answer(step, trial, problem, False, slow, there, slow.cost(there))
    monkeypatch.setattr(views, "HOPE", 0.5 * likelier)
    monkeypatch.setattr(views, "THRESHOLD", 0.5 * likelier)
    monkeypatch.setattr(views, "at_bound", lambda _: "")
    monkeypatch.setattr(views, "settled_on", lambda *_: (slow, there))
    assert not views._settled([answer], own, fitted, problem.experiments, trials.silent)
    monkeypatch.setattr(views, "cost_at", lambda *_: own)
    assert views._settled([answer], own, fitted, problem.experiments, trials.silent)


def test_a_weak_claim_must_gain_more_than_another_model_of_the_noise(
    monkeypatch: pytest.MonkeyPatch,
):
    """A claim of 60, of white and of long memory, where a slower observer gains more without it.

    under_any: what the claim gains under any observer, as physics that is there does.

    Mutations that break it: the model in hand under its own observer; a claim as it is paid alone;
    no claim too weak to be asked.
    """
    monkeypatch.setattr(views, "at_bound", lambda _: "")
    for long, under_any, by_noise in ((False, 0.0, False), (True, 0.0, True), (True, 60.0, False)):
        e = _of_memory(long)
        problem, fitted = refit(phantom(), [e])
        paid = problem.cost(fitted) - 60.0
        trial = trials.Trial("quadratic_drag@m1", fitted, 60.0, 1, price=-under_any)
        step = trials.Step((trial,), trial, 1.0)
        answer = views.Answer(step, trial, problem, False, problem, fitted, paid)
        cheaper = copy(problem)
        monkeypatch.setattr(cheaper, "cost", lambda _, c=paid + under_any: c)
        monkeypatch.setattr(views, "settled_on", lambda *_, p=cheaper, f=fitted: (p, f))
        own = problem.cost(fitted)
        believed = views._settled([answer], own, fitted, problem.experiments, trials.silent)
        assert (believed == []) is by_noise


def test_a_fit_ends_under_the_likeliest_model_of_the_noise():
    """Readings of long memory ask for a slower observer, white ones for the one that was chosen.

    Mutation that breaks it: the calmer observer kept though it is no likelier.
    """
    problem, fitted = refit(phantom(), [_of_memory(False)])
    assert under_likeliest_noise(problem, fitted) is problem
    problem, fitted = refit(phantom(), [_of_memory(True)])
    calm = under_likeliest_noise(problem, fitted)
    assert calm.observer.ratio < problem.observer.ratio
    assert calm.cost(calm.fit(fitted.model, fitted.x)) < problem.cost(fitted) - 10.0


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


def test_an_effect_of_no_size_goes_whatever_it_gains(monkeypatch: pytest.MonkeyPatch):
    """Play of no gap has the kernel step more finely, and that alone may gain thousands.

    Mutation that breaks it: what gains more than a thousand always kept.
    """
    play = make_physics("backlash", "link12", gap=1e-3)
    model = Model(phantom(), (play,), ({"gap": 1e-3},))
    x = np.zeros(len(model.parameters))
    white = np.random.default_rng(1).standard_normal(400)
    residual = np.concatenate([white, np.zeros(sum(p.prior for p in model.parameters))])
    full = Fitted(model, x, 400.0, residual, np.ones((residual.size, x.size)), 400)
    without = Fitted(Model(phantom()), x[:-1], 4000.0, residual, full.jacobian[:, 1:], 400)
    problem = Creased(x, 0.0)
    monkeypatch.setattr(removal, "fit_without", lambda *_: without)
    for size, kept in ((1e-2, without), (25.0, full)):
        monkeypatch.setattr(removal, "wald", lambda *_, size=size: (size, 1))
        assert removal.prune(problem, full) is kept


def test_held_out_data_begin_where_they_fit():
    """A device in motion at their start, under an observer that takes long to find it.

    Mutation that breaks it: the observer begins at rest.
    """
    e = record(phantom(), 4.0, seed=12)
    _, fitted = refit(phantom(), [e])
    slow = prepared_for([e], fitted.model, fitted.x, 1e-8, white=True)
    there = slow.fit(fitted.model, fitted.x)
    one, _ = held_out(phantom(), Searched(slow, there, there, ()), [e.part(2000, 4000)])
    assert one.after < 2.0 * one.noise_floor


class Creased(Problem):
    """A residual that is linear in x, with creases far finer than the errors."""

    def __init__(self, best: Floats, deep: float) -> None:
        random = np.random.default_rng(4)
        self.best, self.deep = best, deep
        self.slopes = random.standard_normal((400, best.size))
        self.fine = 1e4 * random.standard_normal((400, best.size))
        self.white = random.standard_normal(400)
        self.white -= self.slopes @ np.linalg.lstsq(self.slopes, self.white)[0]

    def residual(self, model: Model, x: Floats, least: int = 1) -> Floats:
        creases = self.deep * np.sin(self.fine @ x)
        return self.white + self.slopes @ (x - self.best) + creases


def test_a_fit_of_play_ends_in_the_middle_of_its_creases():
    """Against the minimum of the residual without creases, from four of its errors beside it.

    Mutations that break it: no step; the last turn instead of their mean; no variance added.
    """
    play = make_physics("backlash", "link12", gap=1e-3)
    model = Model(phantom(), (play,), ({"gap": 1e-3},))
    best = np.linspace(-0.1, 0.1, len(model.parameters))
    for deep in (0.0, 0.15):
        problem = Creased(best, deep)
        x = best + 4.0 / np.sqrt(400 * best.size)
        residual = problem.residual(model, x)
        chi2 = float(residual @ residual)
        stopped = Fitted(model, x, chi2, residual, problem.slopes, residual.size)
        middle = across_creases(problem, stopped)
        off = problem.slopes @ (middle.x - best)
        assert float(off @ off) / best.size < 0.1
        assert (middle.rough > SMOOTH) is (deep > 0.0)
        assert middle.chi2 == pytest.approx(float(np.sum(problem.residual(model, middle.x) ** 2)))
        plain = covariance(replace(middle, rough=0.0))
        np.testing.assert_allclose(covariance(middle), (1.0 + middle.rough) * plain)
    friction = Model(phantom(), (make_physics("coulomb_friction", "m1", level=1e-3),))
    friction = replace(friction, scales=({"level": 1e-3},))
    there = replace(stopped, model=friction)
    assert across_creases(problem, there) is there


def test_a_fit_that_stops_at_a_crease_is_brought_on():
    """Mutation that breaks it: no step taken by the slopes over the errors."""
    gap = 1e-3
    truth = phantom().with_physics(make_physics("backlash", "link12", gap=gap))
    e = record(truth, 3.0, seed=3)
    twice = make_physics("backlash", "link12", gap=2.0 * gap)
    model = Model(phantom(), (twice,), ({"gap": 2.0 * gap},))
    problem, there = settle([e], model, np.zeros(len(model.parameters)))
    problem = Problem(problem.experiments, problem.observer, FINAL)
    stopped = problem.fit(there.model, there.x)
    on = over_creases(problem, stopped)
    assert on.chi2 < stopped.chi2
    assert on.chi2 == pytest.approx(float(np.sum(problem.residual(model, on.x) ** 2)))
    half = Z95 * 2.0 * gap * float(np.sqrt(covariance(on)[-1, -1]))
    assert 2.0 * gap * (1.0 + on.x[-1]) == pytest.approx(gap, abs=max(half, 0.01 * gap))


def test_a_gap_is_walked_to_its_deepest_valley():
    """Play between two masses, from the linear parameters of a refit without it.

    Mutations that break it: no step taken; only wider gaps tried.
    """
    device = Device(
        "two", "", True, make_chain([2e-4, 1e-4], [1e-3, 1e-3], 0.0, [40.0], [2e-3]),
        Interface(period=0.001),
    )  # fmt: skip
    gap = 1.5e-3
    e = record(device.with_physics(make_physics("backlash", "link12", gap=gap)), 4.0, seed=12)
    for factor in (0.6, 1.5):
        play = make_physics("backlash", "link12", gap=factor * gap)
        model = Model(device, (play,), ({"gap": gap},))
        linear = refit(device, [e])[1]
        problem, stopped = settle([e], model, np.append(linear.x, 0.0))
        walked = along_gaps(problem, stopped)
        assert walked.chi2 <= stopped.chi2
        found = walked.model.build(walked.x).physics[-1].values["gap"]
        assert found == pytest.approx(gap, rel=0.02)


@pytest.mark.parametrize(("beyond", "walked"), [(11.0, False), (13.0, True)])
def test_gaps_are_walked_where_play_gains_more_than_chance(
    monkeypatch: pytest.MonkeyPatch, beyond: float, walked: bool
):
    """Beside friction chance gains 11 by a play, and walking its gaps took 25 s.

    Mutation that breaks it: gaps walked whatever they gain.
    """
    problem, fitted = refit(phantom(), [record(phantom(), 2.0, seed=12)])
    walks: list[Fitted] = []
    monkeypatch.setattr(views, "settle", lambda *_: (problem, fitted))
    monkeypatch.setattr(views, "_deepest_valley", lambda p, f: walks.append(f) or (p, f))
    trial = trials.Trial("backlash@link12", fitted, 30.0, 1)
    views.settled_on(trial, problem.experiments, problem.cost(fitted) + beyond)
    assert bool(walks) is walked


def test_friction_that_sticks_less_than_it_slides_is_none_beside_a_drag():
    """It grows with speed as a drag does, and would stand for one.

    Mutation that breaks it: the last effect looked at alone.
    """
    values = {"level": 1e-3, "static_level": 2e-3, "velocity": 0.1}
    sticking = make_physics("stribeck_friction", "m1", **values)
    drag = make_physics("quadratic_drag", "m1", coefficient=1e-4)
    model = Model(phantom(), (sticking, drag), ({"level": 1e-3}, {"coefficient": 1e-4}))
    x = np.zeros(len(model.parameters))
    for moved, fault in ((0.9, ""), (1.1, "static_level")):
        x[-2] = moved
        fitted = Fitted(model, x.copy(), 0.0, np.zeros(1), np.zeros((1, x.size)), 1)
        assert trials.at_bound(fitted) == fault


def test_the_sharpest_hysteresis_is_no_fault():
    """On the bound of its shape it stays a candidate; on that of its level it does not.

    Mutation that breaks it: shape judged like every other bound.
    """
    values = {"stiffness": 1.0, "level": 1e-3, "shape": 1.5}
    bent = make_physics("hysteresis", "link12", **values)
    model = Model(phantom(), (bent,), ({k: 0.5 * v for k, v in values.items()},))
    x = np.zeros(len(model.parameters))
    fitted = Fitted(model, x, 0.0, np.zeros(1), np.zeros((1, x.size)), 1)
    for key, fault in (("shape", ""), ("level", "level")):
        at = next(i for i, p in enumerate(model.parameters) if p.key == key)
        there = x.copy()
        there[at] = model.parameters[at].upper
        assert trials.at_bound(replace(fitted, x=there)) == fault


@pytest.mark.parametrize(("gap_gains", "kept"), [(10.0, False), (100.0, True)])
def test_play_must_explain_more_than_play_of_no_gap(
    monkeypatch: pytest.MonkeyPatch, gap_gains: float, kept: bool
):
    """Without any, chi-square is 3600 higher: the kernel steps otherwise.

    Mutation that breaks it: play held against its absence alone.
    """
    play = make_physics("backlash", "link12", gap=1e-3)
    model = Model(phantom(), (play,), ({"gap": 1e-3},))
    x = np.zeros(len(model.parameters))
    white = np.random.default_rng(1).standard_normal(400)
    residual = np.concatenate([white, np.zeros(sum(p.prior for p in model.parameters))])
    chi2 = float(residual @ residual)
    full = Fitted(model, x, chi2, residual, np.ones((residual.size, x.size)), 400)
    without = Fitted(Model(phantom()), x[:-1], 4000.0, residual, full.jacobian[:, 1:], 400)

    def at(_: Model, there: Floats) -> Floats:
        assert 1e-3 * (1.0 + there[-1]) == pytest.approx(1e-15, abs=1e-18)
        return residual * np.sqrt(1.0 + gap_gains / chi2)

    problem = Creased(x, 0.0)
    monkeypatch.setattr(problem, "residual", at)
    monkeypatch.setattr(removal, "fit_without", lambda *_: without)
    monkeypatch.setattr(removal, "wald", lambda *_: (25.0, 1))
    assert (removal.prune(problem, full) is full) is kept

"""Adequacy: an answer beside what it foretells of itself, and beside doing without it."""

from dataclasses import replace

import numpy as np
import pytest
from fitting_examples import drive, recording
from numpy.typing import NDArray
from scipy.signal import lfilter

from zwidth.diagnosis.answer import adequacy as judging
from zwidth.diagnosis.answer import knowing_events as knowing
from zwidth.diagnosis.answer import stands
from zwidth.diagnosis.answer.adequacy import Adequacy, Believed, adequacy
from zwidth.diagnosis.answer.knowing_events import knowing_events
from zwidth.diagnosis.answer.stands import standing, what_stands
from zwidth.diagnosis.answer.verdict import Left
from zwidth.diagnosis.forces import unknown
from zwidth.diagnosis.forces.unknown import Gained, Shape
from zwidth.diagnosis.intake.take_in import Taken, take_in
from zwidth.diagnosis.learning.event_force import Happened
from zwidth.diagnosis.learning.events import Peak, Source
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import NEXT_SAMPLE, as_far_as
from zwidth.diagnosis.noise.predictor import (
    Observer,
    driven,
    free_run_errors,
    free_runs,
    innovations,
    observer_for,
    whitened,
)
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.seeking.screen import Complement
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.diagnosis.selection.hypothesis import (
    against,
    independent,
    judged,
    settled,
)
from zwidth.diagnosis.selection.search import Search
from zwidth.diagnosis.selection.searched import (
    Searched,
    as_found,
    searched,
    unnamed,
)
from zwidth.diagnosis.selection.slower import FAR_S
from zwidth.sim.device import Device
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics

Floats = NDArray[np.float64]
FRICTION = make_physics("coulomb_friction", "m1", level=0.03)


@pytest.fixture(scope="module")
def rubbed() -> Taken:
    return take_in(drive(), [recording(drive().with_physics(FRICTION), 4000, 3)], None)


@pytest.fixture(scope="module")
def found(rubbed: Taken) -> Searched:
    effort = replace(QUICK, effects=1, near=1, far=1, rivals=0, ended=1)
    return searched(drive(), rubbed.fit_on, lambda _: None, effort)


def of(found: Searched, judge_by: tuple[Experiment, ...]) -> Adequacy:
    said = adequacy(Model(drive()), found.refit, found.final, found.judge, judge_by)
    assert said is not None
    return said


def test_the_right_answer_errs_as_far_as_it_foretells(rubbed: Taken, found: Searched) -> None:
    said = of(found, rubbed.judge_by)
    assert said.adequate
    assert said.explained > 0.9
    assert said.better > 5.0


def test_no_error_below_a_step_of_the_encoder_refuses(found: Searched, rubbed: Taken) -> None:
    """Mutation: held against what the noise foretells alone, which is less over 0.05 s."""
    said = of(found, rubbed.judge_by)
    step = judging._step(rubbed.judge_by)  # pyright: ignore[reportPrivateUsage]
    assert step == pytest.approx(3.8e-4)
    assert all(a.most >= step for a in said.ahead)
    assert said.ahead[0].error < 0.7 * step


def test_an_answer_that_is_not_all_errs_farther(found: Searched) -> None:
    """Judged by a machine that has a ripple besides. Mutation: whatever comes is foretold."""
    ripple = make_physics("force_ripple", "m1", amplitude=0.02, period=0.5, phase=0.0)
    other = recording(drive().with_physics(FRICTION, ripple), 2000, 4)
    said = of(found, (other,))
    assert said.useful
    assert not said.sound
    assert not said.adequate


def test_a_short_recording_beside_a_long_one_takes_no_judge_away(
    rubbed: Taken, found: Searched
) -> None:
    """Mutation that breaks it: every recording must hold three runs of a length."""
    short = recording(drive().with_physics(FRICTION), 250, 6)
    alone, beside = of(found, rubbed.judge_by), of(found, (*rubbed.judge_by, short))
    assert [a.horizon for a in beside.ahead] == [a.horizon for a in alone.ahead]
    assert beside.adequate


def test_free_runs_that_run_away_are_not_adequate(
    rubbed: Taken, found: Searched, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Mutation that breaks it: what is not finite is left out."""
    told = iter([(np.full(3, np.inf), np.zeros(3))])
    honest = judging._judged
    monkeypatch.setattr(judging, "_judged", lambda *a: next(told, None) or honest(*a))
    said = of(found, rubbed.judge_by)
    assert said.ahead
    assert not said.sound


def test_a_name_that_held_out_data_do_not_bear_out_is_not_given(
    rubbed: Taken, found: Searched
) -> None:
    """Judged by a machine without friction. Mutation: names stand however they predict."""
    clean = replace(rubbed, judge_by=(recording(drive(), 2000, 5),))
    said: list[str] = []
    assert standing(drive(), rubbed, found, said.append)[0] is found
    assert not said
    left, _ = standing(drive(), clean, found, said.append)
    assert left.final.model.effects == ()
    assert left.tried is not None
    assert left.tried.best is left.tried.plain
    assert "does not improve the prediction of held-out data" in said[0]
    assert of(left, clean.judge_by).useful  # nothing is named


def test_held_out_data_choose_between_the_answers_of_two_judges(
    rubbed: Taken, found: Searched
) -> None:
    """Mutation: the answer of the other judge is forgotten once another was chosen."""
    bare = replace(unnamed(found), far=True)

    def stood(first: Searched, beside: Searched) -> Searched:
        asked = replace(first, far=True, beside=beside)
        return what_stands(drive(), rubbed, asked, lambda _: None).by

    right, wrong = found.final.model.label, bare.final.model.label
    assert right != wrong
    assert stood(bare, found).final.model.label == right
    assert stood(found, bare).final.model.label == right
    assert stood(bare, bare).final.model.label == wrong


def test_of_no_effect_it_is_asked_too_what_the_next_sample_shows(
    rubbed: Taken, found: Searched, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a hum, errors over a longer horizon showed nothing on one recording of the exam.

    Mutation that breaks it: what is left is asked under the noise of that horizon alone.
    """
    asked: list[Searched] = []

    def left(of: Searched, _: Taken) -> tuple[Left, None]:
        asked.append(of)
        return Left(100.0, "a hum"), None

    monkeypatch.setattr(stands, "runs_freer", lambda *_: True)
    monkeypatch.setattr(stands, "_what_is_left", left)
    near, plain = unnamed(found), found.tried.plain
    horizon = as_far_as(FAR_S, plain.experiments)
    far = settled(independent(judged(plain.experiments, plain.model, plain.x, horizon), FAR_S))
    second = as_found(drive(), replace(found.tried, plain=far, best=far))
    first = replace(near, far=True, beside=second)
    stood = what_stands(drive(), rubbed, first, lambda _: None)
    assert stood.by is second
    assert asked[-1].final.model.effects == ()
    assert asked[-1].problem.observer.whitening is not None


def test_what_goes_on_into_held_out_data_may_be_an_effect_that_only_these_show(
    rubbed: Taken, found: Searched, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A limit that was reached about the end of the fitted part was called a hand.

    Mutations that break it: effects asked only for what begins after the cut; all that was
    recorded searched only where the answer over the fitted part leaves something; the mark lost
    where the fit is made again after a part was set apart.
    """
    cut = rubbed.fit_on[0].ticks
    asked: list[int] = []
    monkeypatch.setattr(knowing, "_with_a_name", lambda *a: asked.append(a[2][0].ticks) or a[0])
    monkeypatch.setattr(knowing, "_anew", lambda found, *_: replace(found, later=False))
    monkeypatch.setattr(knowing, "all_said", lambda *_: ())
    for first, last, shown in ((-50, -10, False), (-50, 50, True), (50, 90, True)):
        peak = Peak(0, Source("m1"), cut + first, last - first, 300.0)
        once = Happened(0, peak.source, peak.first, peak.last, np.zeros(last - first), np.eye(1),
                        300.0, (0.0, 0.0))  # fmt: skip
        monkeypatch.setattr(knowing, "_peak", lambda *_, peak=peak: peak)
        monkeypatch.setattr(knowing, "_happened", lambda *_, once=once: (once,))
        asked.clear()
        _, answer, _ = knowing_events(rubbed, found, lambda _: None)
        assert answer.later is shown
        assert asked == ([rubbed.whole[0].ticks] if shown else [])
        if shown:
            apart = replace(found, tried=replace(found.tried, apart=1))
            assert knowing_events(rubbed, apart, lambda _: None)[1].later
    looked: list[int] = []
    monkeypatch.setattr(
        stands, "second_look", lambda *a: (looked.append(a[2][0].ticks), (a[0], a[1], None))[1]
    )
    for later in (False, True):
        what_stands(drive(), rubbed, replace(found, later=later), lambda _: None)
        assert looked == [rubbed.whole[0].ticks] * later


def test_a_force_whose_answer_overflows_explains_nothing(found: Searched) -> None:
    """On two carts a filter that was fitted without its force oscillated, and all that was left
    had an SVD of infinities. Mutation: it is solved for all the same."""
    problem, fitted = found.problem, found.refit
    (e,) = problem.experiments
    columns = [np.full((e.ticks, 1), np.inf)]
    beyond = Shape("m1", "velocity", np.ones(1), columns, lambda *_: beyond)
    with np.errstate(all="ignore"):
        strength, gained = unknown._solved(problem, fitted, Complement(fitted.jacobian), beyond)
        asked = Gained(replace(beyond, columns=[np.ones((e.ticks, 1))]), np.full(1, 1e-3), 1.0)
        with pytest.raises(NoObserver, match="overflows"):
            unknown._with_force(problem, fitted, asked, np.inf, NEXT_SAMPLE)
    assert (strength.tolist(), gained) == ([0.0], 0.0)


def test_a_search_without_effects_stands(rubbed: Taken) -> None:
    model = Model(drive())
    plain = settled(judged(list(rubbed.fit_on), model, np.zeros(len(model.parameters))))
    search = Search(plain, plain, QUICK, lambda _: None)
    bare = Searched(plain.problem, plain.fitted, plain.fitted, search, plain.noise.observer)
    assert standing(drive(), rubbed, bare, lambda _: None)[0] is bare


def coloured(physics: tuple[Physics, ...], colour: float, seed: int) -> Experiment:
    """24 s of a drive that a force of 0.004 N m pushes besides, which forgets slowly."""
    random = np.random.default_rng([seed, 1])
    white = 0.004 * np.sqrt(1.0 - colour**2) * random.standard_normal(12500)
    push: Floats = lfilter([1.0], [1.0, -colour], white)[500:]
    return recording(drive().with_physics(*physics), 12000, seed, push=push)


def linear_answer(made: Experiment) -> Adequacy:
    """What the refit of a linear device, fitted to 70 %, says of itself by the rest."""
    first, rest = made.split()
    model = Model(drive())
    h = settled(judged([first], model, np.zeros(len(model.parameters))))
    said = adequacy(model, h.fitted, h.fitted, h.noise.observer, [rest])
    assert said is not None
    return said


@pytest.mark.parametrize("colour", [0.0, 0.9])
def test_noise_of_any_colour_is_foretold(colour: float) -> None:
    """Mutation: rehearsed with white innovations, free runs err twice as far as foretold."""
    said = linear_answer(coloured((), colour, 3))
    assert said.sound
    assert said.ahead[1].error < 1.7 * said.ahead[1].expected


def test_what_lacks_is_refused_though_its_colour_is_foretold() -> None:
    """Friction of 0.01 N m under coloured noise. Mutation: the size of errors alone is judged."""
    said = linear_answer(coloured((make_physics("coulomb_friction", "m1", level=0.01),), 0.9, 3))
    assert not said.sound
    assert all(a.error <= a.most for a in said.ahead)
    assert said.ahead[0].led > said.ahead[0].most_led


def test_innovations_drawn_are_white_once_filtered() -> None:
    """Two outputs. Mutations: what one output says of the other left out; the root transposed."""
    random = np.random.default_rng(1)
    white = random.standard_normal((50000, 2)) @ np.array([[1.0, 0.0], [0.8, 0.3]])
    seen = np.column_stack([lfilter([1.0], [1.0, -0.9], white[:, 0]), white[:, 1]])
    seen[5:, 1] += 0.5 * seen[:-5, 0]
    observer = whitened(Observer(np.zeros((4, 2)), np.ones(2), 1.0), [seen])
    root = np.array([[2.0, 0.0], [1.0, 0.5]])
    drawn = observer.weigh(Believed(observer, root, [np.ones(50000)]).drawn(0, random))[100:]
    assert drawn.T @ drawn / drawn.shape[0] == pytest.approx(root @ root.T, rel=0.05)
    for lag in (1, 5, 24):
        assert np.abs(drawn[lag:].T @ drawn[:-lag] / drawn.shape[0]).max() < 0.1


def test_a_device_driven_by_its_innovations_has_these() -> None:
    """Friction, two outputs. Mutation: readings after the correction, or of another output."""
    device = drive().with_physics(FRICTION)
    made = recording(device, 1500, 4, (0, 1))
    gain = observer_for(drive(), made, 1.0)
    errors = 1e-4 * np.random.default_rng(2).standard_normal(made.measured.shape)
    y = driven(device, made, Observer(gain, np.ones(2), 1.0), errors)
    again = innovations(device, replace(made, measured=y), gain)
    assert again[500:] == pytest.approx(errors[500:], abs=1e-9)  # where it began is forgotten


def test_free_runs_are_those_of_one_length_after_the_other() -> None:
    """Mutations: the observer not led on between runs; a run that moves it."""
    device = drive().with_physics(FRICTION)
    made = recording(device, 900, 4)
    gain = observer_for(drive(), made, 1.0)
    for length, runs in zip((25, 200), free_runs(device, made, gain, (25, 200), 1000), strict=True):
        errors, _ = free_run_errors(device, made, gain, length)
        assert np.array_equal(runs.errors.reshape(-1, 1), errors)
    few = free_runs(device, made, gain, (25,), 5)[0].errors
    assert few.shape[0] == 5
    assert few[-1] == pytest.approx(errors_of_last(device, made, gain))


def errors_of_last(device: Device, made: Experiment, gain: Floats) -> Floats:
    return free_run_errors(device, made, gain, 25)[0].reshape(-1, 25, 1)[-1]


def test_errors_far_ahead_count_as_often_as_they_are_independent() -> None:
    """Of a motor that chance pushes, with nothing missing, no law explains more than chance.

    Mutation: every sample counts once, and dry friction explains the chance.
    """
    pushed = 0.01 * np.random.default_rng(5).standard_normal(4000)
    made = [recording(drive(), 4000, 4, push=pushed)]
    ahead = as_far_as(FAR_S, made)
    bare = Model(drive())
    plain = independent(settled(judged(made, bare, np.zeros(len(bare.parameters)), ahead)), FAR_S)
    assert 1.0 / 40.0 < plain.family.counts < 1.0 / 5.0  # 25 samples are 0.05 s
    law = make_physics("coulomb_friction", "m2", level=2e-4)
    more = bare.with_effect(law, {"level": 1e-3})
    every, few = (
        against(settled(judged(made, more, np.zeros(len(more.parameters)), p.family)), settled(p))
        for p in (replace(plain, family=ahead).anew(plain.x), plain)
    )
    assert few.gain < 12.0 < every.gain


def test_what_is_not_believed_leaves_no_noise_behind(rubbed: Taken) -> None:
    """Errors over a long horizon are coloured, in which something would always be left.

    Mutation: the refit under the noise of the search whose names were not believed.
    """
    experiments, model = list(rubbed.fit_on), Model(drive())
    ahead = as_far_as(FAR_S, experiments)
    plain = settled(judged(experiments, model, np.zeros(len(model.parameters)), ahead))
    far = as_found(drive(), Search(plain, plain, QUICK, lambda _: None))
    assert far.problem.observer.whitening is None
    assert unnamed(far).problem.observer.whitening is not None

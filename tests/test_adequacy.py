"""Adequacy: an answer beside what it foretells of itself, and beside doing without it."""

from dataclasses import replace

import numpy as np
import pytest
from test_fitting import drive, recording

from zwidth.diagnosis.answer.adequacy import Adequacy, adequacy
from zwidth.diagnosis.answer.answered import _standing
from zwidth.diagnosis.experiment import Experiment
from zwidth.diagnosis.intake import Taken, take_in
from zwidth.diagnosis.noise.family import as_far_as
from zwidth.diagnosis.parameters import Model
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.diagnosis.selection.hypothesis import judged, settled
from zwidth.diagnosis.selection.search import Search
from zwidth.diagnosis.selection.searched import FAR_S, Searched, as_found, searched, unnamed
from zwidth.sim.physics import make_physics

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


def test_an_answer_that_is_not_all_errs_farther(found: Searched) -> None:
    """Judged by a machine that has a ripple besides. Mutation: whatever comes is foretold."""
    ripple = make_physics("force_ripple", "m1", amplitude=0.02, period=0.5, phase=0.0)
    other = recording(drive().with_physics(FRICTION, ripple), 2000, 4)
    said = of(found, (other,))
    assert said.useful
    assert not said.sound
    assert not said.adequate


def test_a_name_that_held_out_data_do_not_bear_out_is_not_given(
    rubbed: Taken, found: Searched
) -> None:
    """Judged by a machine without friction. Mutation: names stand however they predict."""
    clean = replace(rubbed, judge_by=(recording(drive(), 2000, 5),))
    said: list[str] = []
    assert _standing(drive(), rubbed, found, said.append)[0] is found
    assert not said
    left, _ = _standing(drive(), clean, found, said.append)
    assert left.final.model.effects == ()
    assert left.tried.best is left.tried.plain
    assert "predicts held-out data no better" in said[0]
    assert of(left, clean.judge_by).useful  # nothing is named


def test_a_search_without_effects_stands(rubbed: Taken) -> None:
    model = Model(drive())
    plain = settled(judged(list(rubbed.fit_on), model, np.zeros(len(model.parameters))))
    search = Search(plain, plain, QUICK, lambda _: None)
    bare = as_found(drive(), search)
    assert _standing(drive(), rubbed, bare, lambda _: None)[0] is bare


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

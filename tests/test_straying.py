"""How far free runs stray, and what no model could avoid of it."""

import math
from dataclasses import replace

import numpy as np
from fitting_examples import drive, recording

from zwidth.diagnosis.answer.straying import strayed, unavoidable, wander
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.beginning import begun_as
from zwidth.diagnosis.noise.family import Family
from zwidth.diagnosis.noise.predictor import deviation
from zwidth.diagnosis.selection.hypothesis import Hypothesis, judged
from zwidth.sim.physics import make_physics


def followed(push: float, ratio: float) -> Hypothesis:
    """A pendulum, as an observer of a ratio follows it; push: a force that is missing."""
    truth = drive().with_physics(make_physics("gravity_pendulum", "m1", level=0.1, angle=0.0))
    model = Model(truth)
    e = recording(truth, 3000, 3, (0,), push, 0.1)
    return judged([e], model, np.zeros(len(model.parameters)), Family((ratio,)))


def told(h: Hypothesis) -> tuple[float, float, float, float]:
    """Error, motion, noise and the unavoidable error of its free runs."""
    device, seen, observer = h.model.acting(h.x), h.problem.experiments, h.noise.observer
    noise = deviation(device, seen, observer.gain)
    error, motion = strayed(device, seen, observer.gain)
    return error, motion, float(noise[0]), unavoidable(device, seen, observer, noise, error)


def test_what_the_noise_of_readings_does_to_a_beginning_is_unavoidable() -> None:
    """An observer that follows its readings hands their noise on to the speed of each free run.

    Mutation: noise alone as the floor.
    """
    error, _, noise, floor = told(followed(0.0, 1e3))
    assert error > 20.0 * noise
    assert floor > 0.9 * error
    assert floor <= math.hypot(error, noise)


def test_missing_physics_is_not() -> None:
    """A constant force that the model lacks. Mutation: draws as large as the innovations."""
    error, motion, noise, floor = told(followed(0.01, 1e-3))
    assert noise < floor < 0.03 * error
    assert wander(error / motion, floor / motion)


def test_a_run_that_runs_away_avoids_nothing() -> None:
    """Mutation: an infinite floor."""
    h = followed(0.0, 1e-3)
    noise, far = np.array([1e-4]), math.inf
    for error in (far, math.nan, 1.2e-4):
        assert unavoidable(h.model.acting(0 * h.x), [], h.noise.observer, noise, error) == 1e-4


def test_another_version_of_the_rest_of_a_recording_keeps_its_motions() -> None:
    """Mutation: the motions of the part before alone; else its noise is simulated with a gain.

    Errors of free runs, which such a simulation foretells, were half of what they are.
    """
    h = followed(0.0, 1e-3)
    whole = h.problem.experiments[0]
    whole = replace(whole, motions=np.zeros((whole.ticks, 4, 4)))
    head, tail = whole.part(0, 2000), whole.part(2000, whole.ticks)
    mine = replace(tail, before=head)
    assert mine.motions is not None
    again = begun_as(replace(mine, motions=None, before=replace(head, start=None)), mine)
    assert again.motions is mine.motions
    assert again.before is not None
    assert again.before.start is head.start

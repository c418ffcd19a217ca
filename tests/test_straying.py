"""How far free runs stray."""

import math
from dataclasses import replace

import numpy as np
from fitting_examples import drive, recording

from zwidth.diagnosis.answer.straying import strayed, wander, wandering
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import Family
from zwidth.diagnosis.noise.predictor import as_followed, deviation, window
from zwidth.diagnosis.selection.hypothesis import Hypothesis, judged, priced
from zwidth.sim.physics import make_physics


def followed(push: float) -> Hypothesis:
    """A pendulum, as an observer follows it; push: a force that is missing."""
    truth = drive().with_physics(make_physics("gravity_pendulum", "m1", level=0.1, angle=0.0))
    model = Model(truth)
    e = recording(truth, 3000, 3, (0,), push, 0.1)
    return judged([e], model, np.zeros(len(model.parameters)), Family((1e-3,)))


def test_missing_physics_moves_the_typical_run_aside() -> None:
    """A constant force that the model lacks, and none. Mutation: the least error of all runs."""
    for push, away in ((0.0, False), (0.02, True)):
        h = priced(followed(push))
        assert wandering(h.fitted, h.noise.observer, h.problem.experiments) is away


def test_a_few_runs_that_part_are_not_typical() -> None:
    """Two of eleven runs are given another motion; with six, most have one, and it counts.

    Mutations: the mean in place of the typical; runs counted without their motion.
    """
    h = followed(0.0)
    device, observer = h.model.acting(h.x), h.noise.observer
    (e,) = h.problem.experiments
    noise = float(deviation(device, [e], observer.gain)[0])
    ticks = window(e)
    for parted, away in ((2, False), (7, True)):
        measured = e.measured.copy()
        late = 100 + ticks * np.arange(1, 1 + parted)[:, None] + np.arange(ticks // 2, ticks)
        measured[late.ravel()] += 1.0
        error, typical, motion = strayed(device, [replace(e, measured=measured)], observer.gain)
        assert error > 0.2 * motion
        assert wander(typical / motion, noise / motion) is away


def test_runs_that_run_away_stray() -> None:
    """Mutation: an overflow that counts as nothing."""
    h = followed(0.0)
    (e,) = h.problem.experiments
    gain = np.full(h.model.acting(h.x).plant().size * 1, 1e9)[:, None]
    assert strayed(h.model.acting(h.x), [e], gain).typical > 1e3 * float(np.std(e.measured))
    assert math.isnan(strayed(h.model.acting(h.x), [e.part(0, 90)], gain).typical)


def test_another_version_of_the_rest_of_a_recording_keeps_its_motions() -> None:
    """Mutation: the motions of the part before alone; else its noise is simulated with a gain.

    Errors of free runs, which such a simulation foretells, were half of what they are.
    """
    h = followed(0.0)
    whole = replace(h.problem.experiments[0], motions=np.zeros((3000, 4, 4)))
    head, tail = whole.part(0, 2000), whole.part(2000, whole.ticks)
    mine = replace(tail, before=head)
    assert mine.motions is not None
    again = as_followed(replace(mine, motions=None, before=replace(head, motions=None)), mine)
    assert again.motions is mine.motions
    assert again.before is not None
    assert again.before.motions is head.motions

"""A learned law is refused where one free run over all held-out data runs away with it."""

from dataclasses import replace

import numpy as np
from learning_examples import DEVICE, recording, without_names

from zwidth.diagnosis.answer.learned import Asked
from zwidth.diagnosis.answer.whole_run import free_run, whole_runs
from zwidth.diagnosis.mishaps import silent
from zwidth.diagnosis.noise.gaps import steadily
from zwidth.diagnosis.selection.searched import as_found


def cube(_: float, v: float) -> float:
    return -0.5 * v**3


def test_a_law_that_runs_away_is_none() -> None:
    """Short runs may err less with what drives a long one off. Mutation: finite is enough."""
    found = as_found(DEVICE, without_names(cube))
    asked = Asked(DEVICE, found, [recording(cube).split()[1]], silent)
    assert not asked.runs_away(found)
    for damper in (-2.0, -60.0):  # several times the motion, and beyond any number
        x = found.final.x.copy()
        x[[p.name for p in found.final.model.parameters].index("b1")] = damper
        assert asked.runs_away(replace(found, final=replace(found.final, x=x)))


def test_a_run_begins_where_no_observer_follows() -> None:
    """From its first samples. Mutation: the state that the observer left."""
    found = as_found(DEVICE, without_names(cube))
    held = recording(cube).split()[1]
    gain = steadily(found.judge.gain)
    wild = replace(found.judge, gain=1e4 * gain)
    off = free_run(found.final.model, found.final.x, held, wild) - held.measured
    assert np.sqrt(np.mean(off**2)) < 0.3 * held.measured.std()


def test_a_law_begins_by_its_own_noise() -> None:
    """The observer of the names may not follow a recording with it.

    Mutation: `whole_runs` begins the law by the judge of the names.
    """
    found = as_found(DEVICE, without_names(cube))
    held = [recording(cube).split()[1]]
    gain = steadily(found.judge.gain)
    slow = replace(found.judge, gain=0.5 * gain)
    (run,) = whole_runs(DEVICE, replace(found, judge=slow), held, [], found)
    assert run.errors["law"] != run.errors["after"]
    (own,) = whole_runs(DEVICE, found, held, [], found)
    assert run.errors["law"] == own.errors["after"]

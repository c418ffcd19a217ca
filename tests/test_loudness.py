"""Noise that is louder where the command changes."""

import numpy as np
import pytest
from fitting_examples import drive

from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.answer.adequacy import Believed
from zwidth.diagnosis.learning.events import highest
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.loudness import loudness
from zwidth.diagnosis.noise.predictor import Observer
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis.selection.hypothesis import judged, settled
from zwidth.sim.run import simulate

TICKS = 6000
LIVELY = slice(3000, 4500)


def command(random: np.random.Generator) -> np.ndarray:
    """A quiet command of white torque, five times as large for a quarter of the time."""
    u = 0.05 * random.standard_normal(TICKS)
    u[LIVELY] *= 5.0
    return u


def test_noise_that_follows_the_command_is_told_from_noise_that_does_not() -> None:
    """Mutations: the command itself in place of its changes; no test whether it is clear."""
    random = np.random.default_rng(1)
    u = command(random)
    changed = np.diff(u, prepend=u[0])
    still = random.standard_normal((TICKS, 1))
    (same,) = loudness([still], [u])
    assert np.all(same == 1.0)
    jitter = changed[:, None] / changed.std() * random.standard_normal((TICKS, 1))
    noisy = 0.5 * still + np.roll(jitter, 2, axis=0)  # a delay of two ticks
    (loud,) = loudness([noisy], [u])
    ratio = np.sqrt(np.mean(noisy[LIVELY] ** 2) / np.mean(noisy[: LIVELY.start] ** 2))
    assert np.sqrt(np.mean(loud[LIVELY] ** 2) / np.mean(loud[: LIVELY.start] ** 2)) == (
        pytest.approx(ratio, rel=0.1)
    )
    assert np.mean(loud**2) == pytest.approx(1.0, rel=0.02)
    constant = np.full(TICKS, 0.3)
    assert np.all(loudness([still], [constant])[0] == 1.0)
    assert np.all(loudness([np.full((TICKS, 1), np.inf)], [u])[0] == 1.0)


def test_noise_is_drawn_as_loud_as_it_was() -> None:
    """Mutation: the same size everywhere."""
    loud = np.ones(TICKS)
    loud[LIVELY] = 3.0
    observer = Observer(np.zeros((4, 1)), np.ones(1), 1.0)
    drawn = Believed(observer, np.eye(1), [loud]).drawn(0, np.random.default_rng(2))
    assert np.std(drawn[LIVELY]) == pytest.approx(3.0, rel=0.1)
    assert np.std(drawn[: LIVELY.start]) == pytest.approx(1.0, rel=0.1)


def test_a_clock_that_jitters_is_no_event() -> None:
    """A tenth of a tick, on a machine that lacks nothing. Mutation: events sought in plain noise.

    The exam of 20281221 called two such machines `unknown_physics` after such events.
    """
    random = np.random.default_rng(3)
    u = command(random)
    push = 0.1 * np.diff(u, prepend=u[0]) * random.standard_normal(TICKS)
    run = simulate(
        drive(), recorded(u), duration=TICKS * 2e-3, disturbance=np.stack([push, 0 * push], 1)
    )
    y = run.trace["position_m1"] + 1e-6 * random.standard_normal(TICKS)
    seen = [Experiment(2e-3, u, y[:, None], (Output("position", 0),), "made", float(y.std()))]
    model = Model(drive())
    h = settled(judged(seen, model, np.zeros(len(model.parameters))))
    assert highest(seen, h) is None

"""An answer predicts a new command: the state from its first samples, then a free run."""

from functools import cache

import numpy as np
import pytest

import zwidth
from zwidth.diagnosis.answer.prediction import predicts
from zwidth.diagnosis.intake.gate import Fault

WINDOW = 20


@cache
def cart() -> zwidth.Device:
    chain = zwidth.make_chain([0.5], [0.8])
    face = zwidth.Interface(period=0.002, delay=0.0, encoder_step=1e-5)
    return zwidth.Device("cart", "a test", False, chain, face)


@cache
def rubbing() -> zwidth.Device:
    return cart().with_physics(zwidth.make_physics("coulomb_friction", "m1", level=0.3))


def moved(bench: zwidth.Device, seed: int) -> zwidth.Run:
    command = zwidth.excitation(cart(), seconds=4.0, level=4.0, travel=0.05, seed=seed)
    return zwidth.simulate(bench, zwidth.recorded(command))


@cache
def answer() -> zwidth.Diagnosis:
    return zwidth.diagnose(moved(rubbing(), 0), cart(), effort="quick")


@cache
def other() -> tuple[np.ndarray, np.ndarray]:
    """A command that no diagnosis has seen, from the middle of its motion on, and the motion."""
    trace = moved(rubbing(), 7).trace
    return trace["command"][500:], trace["encoder"][500:]


def rms(off: np.ndarray) -> float:
    return float(np.sqrt(np.mean(off[WINDOW:] ** 2)))


def test_a_new_command_is_predicted_from_its_first_samples():
    """Mutation that breaks it: the window's state forgotten, or corrections after it."""
    u, y = other()
    found = answer().predict(u, y[:WINDOW])
    assert found.shape == u.shape
    assert np.array_equal(found[:WINDOW], y[:WINDOW])
    assert rms(found - y) < 0.02 * rms(y - y.mean())


def test_nothing_after_the_window_is_read():
    """What is measured later is not asked for: the same arrays give the same prediction."""
    u, y = other()
    once = answer().predict(u, y[:WINDOW])
    again = answer().predict(u.tolist(), y[:WINDOW, None])
    assert again.shape == (u.size, 1)
    assert np.array_equal(again[:, 0], once)


def test_the_state_of_the_window_counts():
    """Another beginning is another motion, by as much as it is elsewhere."""
    u, y = other()
    found = answer().predict(u, y[:WINDOW] + 0.01)
    assert found[-1] - y[-1] == pytest.approx(0.01, abs=2e-3)


@pytest.mark.parametrize(
    ("u", "first", "sentence"),
    [
        (np.zeros((50, 1)), np.zeros(20), r"u_test has the shape \(50, 1\)"),
        (np.zeros(50), np.zeros((20, 2)), r"y_first has the shape \(20, 2\).*position_m1"),
        (np.zeros(50), np.zeros(9), "9 samples.*10 or more"),
        (np.zeros(50), np.zeros(50), "fewer than u_test"),
        (np.full(50, np.nan), np.zeros(20), "u_test holds values that are not finite"),
        (np.zeros(50), np.full(20, np.inf), "y_first holds values that are not finite"),
    ],
)
def test_arrays_that_are_no_use_are_refused(u: np.ndarray, first: np.ndarray, sentence: str):
    with pytest.raises(ValueError, match=sentence):
        answer().predict(u, first)


def test_recordings_that_were_corrected_are_refused():
    """A wrong unit was mended in the recording, and a new reading would have it still."""
    from dataclasses import replace

    wrong = Fault("output_scale", "position_m1 counts 1000 times", True, 1e-3, "", ("position_m1",))
    doubtful = replace(answer(), faults=(wrong,))
    with pytest.raises(ValueError, match=r"counts 1000 times.*correct the file"):
        doubtful.predict(np.zeros(50), np.zeros(20))


def test_what_predicts_is_no_worse_on_what_was_held_out():
    """Numbers of long free runs stand only where they err less there."""
    found = answer()
    with_it = predicts(found.searched, found.learned, found.experiments)
    level = next(p for p in with_it.final.model.effects_at(with_it.final.x)).values["level"]
    assert level == pytest.approx(0.3, rel=0.02)

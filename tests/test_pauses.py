"""What of a recording is a pause, and where it is cut into what is fitted and what judges."""

import numpy as np

from zwidth.diagnosis.recording.experiment import Experiment, Output

PERIOD, TICKS = 0.005, 3000
T = PERIOD * np.arange(TICKS)


def taken(command: np.ndarray, motion: np.ndarray) -> Experiment:
    return Experiment(PERIOD, command, motion[:, None], (Output("position", 0),))


def test_a_bench_that_rests_before_and_after_is_cut_within_its_motion() -> None:
    random = np.random.default_rng(0)
    driven = (T > 5.0) & (T < 10.0)
    noise = 0.1 * random.standard_normal(TICKS)  # of a current that is measured
    e = taken(driven * np.sin(9.0 * T) + noise, driven * np.cos(9.0 * T))
    paused = e.pauses()
    assert paused[T < 4.6].all()
    assert paused[T > 10.4].all()
    assert not paused[driven].any()
    first, rest = e.split()
    assert 8.3 < T[first.ticks] < 8.9
    assert rest.before is first
    assert first.ticks + rest.ticks == TICKS


def test_without_a_pause_seventy_percent_are_fitted() -> None:
    e = taken(np.sin(9.0 * T), np.cos(9.0 * T))
    assert not e.pauses().any()
    assert e.split()[0].ticks == round(0.7 * TICKS)


def test_what_sticks_under_a_force_that_grows_is_no_pause() -> None:
    ramp = np.minimum(T, 8.0)
    moves = np.where(T > 8.0, np.sin(3.0 * T), 0.0)
    assert not taken(ramp, moves).pauses()[T < 7.0].any()


def test_a_hold_is_a_pause_though_the_force_that_holds_it_is_not_zero() -> None:
    held = T > 9.0
    e = taken(np.where(held, 0.7, np.sin(3.0 * T)), np.where(held, 0.2, np.cos(3.0 * T)))
    assert e.pauses()[T > 9.4].all()

"""Velocities that were worked out from a position, and those that were measured."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, lfilter, savgol_filter

from zwidth.diagnosis.intake.derived import measured_alone
from zwidth.diagnosis.recording.experiment import Experiment, Output

Floats = NDArray[np.float64]
PERIOD, TICKS, STEP = 1e-3, 4000, 2e-4
POSITION, VELOCITY = Output("position", 0), Output("velocity", 0)


def motion(seed: int = 1, low: float = 0.02) -> tuple[Floats, Floats]:
    """A position and its velocity: smooth noise below 10 Hz."""
    white = np.random.default_rng(seed).standard_normal(TICKS)
    b, a = butter(2, low)
    v = np.asarray(lfilter(b, a, white))
    return np.cumsum(v) * PERIOD, v


def recorded(
    p: Floats, v: Floats, outputs: tuple[Output, ...] = (POSITION, VELOCITY)
) -> Experiment:
    columns = {POSITION: p, VELOCITY: v}
    measured = np.column_stack([columns[o] for o in outputs])
    return Experiment(PERIOD, np.sin(np.arange(TICKS) / 50.0), measured, outputs, "bench")


def counted(values: Floats, step: float) -> Floats:
    return step * np.round(values / step)


def differenced(p: Floats) -> Floats:
    return np.diff(p, prepend=p[0]) / PERIOD


WAYS: dict[str, Callable[[Floats], Floats]] = {
    "differences": differenced,
    "central differences": lambda p: np.gradient(p, PERIOD),
    "a first-order filter": lambda p: np.asarray(lfilter([0.1], [1.0, -0.9], differenced(p))),
    "a second-order filter": lambda p: np.asarray(lfilter(*butter(2, 0.2), differenced(p))),
    "a mean of ten": lambda p: np.asarray(lfilter(np.ones(10) / 10.0, [1.0], differenced(p))),
    "a smoothing": lambda p: savgol_filter(p, 11, 3, deriv=1, delta=PERIOD),
}


@pytest.mark.parametrize("way", WAYS)
def test_a_velocity_that_was_worked_out_is_left_out(way: str) -> None:
    """Of an encoder's counts, written in six digits. Mutation: LAG = 4."""
    p = counted(motion()[0], STEP)
    v = WAYS[way](p)
    (found,) = measured_alone([recorded(p, counted(v, 1e-6 * float(np.abs(v).max())))])
    assert found.outputs == (POSITION,)
    assert np.array_equal(found.measured[:, 0], p)
    assert any("velocity_m1 of bench is position_m1 differenced" in note for note in found.notes)


@pytest.mark.parametrize("noise", [1e-1, 1e-3])
def test_a_velocity_with_noise_of_its_own_is_kept(noise: float) -> None:
    p, v = motion()
    own = v + noise * np.std(v) * np.random.default_rng(3).standard_normal(TICKS)
    e = recorded(counted(p, STEP), own)
    assert measured_alone([e])[0] is e


def test_a_clean_velocity_beside_a_coarse_position_is_kept() -> None:
    """One oscillation, which its own last two samples foretell. Mutation: no filter run alone."""
    v = np.sin(2.0 * np.pi * 3.0 * PERIOD * np.arange(TICKS))
    e = recorded(counted(np.cumsum(v) * PERIOD, 1e-3), v)
    assert measured_alone([e])[0] is e


def test_steps_of_an_encoder_differenced_inside_the_drive_are_kept() -> None:
    """The drive counts finer than it reports: its velocity says more than the position."""
    p, _ = motion()
    e = recorded(counted(p, STEP), differenced(counted(p, STEP / 16.0)))
    assert measured_alone([e])[0] is e


def test_what_one_recording_measured_is_kept_in_all() -> None:
    p, v = motion()
    coarse = counted(p, STEP)
    worked_out, measured = recorded(coarse, differenced(coarse)), recorded(coarse, v + 1e-3)
    assert [len(e.outputs) for e in measured_alone([worked_out, measured])] == [2, 2]


def test_a_position_that_stands_second_becomes_the_first() -> None:
    p = counted(motion()[0], STEP)
    (found,) = measured_alone([recorded(p, differenced(p), (VELOCITY, POSITION))])
    assert found.outputs == (POSITION,)
    assert found.swing == pytest.approx(float(np.std(p)))

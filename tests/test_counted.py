"""Velocities that are counts of an encoder, and those that are not."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, lfilter

from tests.diagnosis_examples import phantom
from zwidth.diagnosis.intake.counted import Counted, _turning, as_counted
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.sim.device import Device

Floats = NDArray[np.float64]
PERIOD, TICKS, STEP = 1e-3, 4000, 3.07e-4
VELOCITY, POSITION = Output("velocity", 0), Output("position", 0)


def moved(speed: float, seed: int = 1) -> Floats:
    """A position of so many counts per sample at most, smooth below 10 Hz."""
    white = np.random.default_rng(seed).standard_normal(TICKS)
    v = np.asarray(lfilter(*butter(2, 0.02), white))
    return np.cumsum(v / np.abs(v).max()) * speed * STEP


def counted(p: Floats) -> Floats:
    return STEP * np.round(p / STEP)


def rate(p: Floats, cutoff_hz: float) -> Floats:
    change = np.diff(p, prepend=p[0]) / PERIOD
    if np.isinf(cutoff_hz):
        return change
    weight = 1.0 - np.exp(-2.0 * np.pi * cutoff_hz * PERIOD)
    return np.asarray(lfilter([weight], [1.0, weight - 1.0], change))


def written(values: Floats, digits: int) -> Floats:
    return np.array([float(f"{value:.{digits}g}") for value in values])


def recorded(v: Floats) -> Experiment:
    return Experiment(PERIOD, np.sin(np.arange(TICKS) / 50.0), v[:, None], (VELOCITY,), "bench")


def knowing(step: float) -> Device:
    return replace(phantom(), interface=replace(phantom().interface, encoder_step=step))


@pytest.mark.parametrize("cutoff_hz", [np.inf, 200.0, 25.0])
@pytest.mark.parametrize("speed", [0.7, 40.0])
def test_counts_are_found_to_the_last_one(cutoff_hz: float, speed: float) -> None:
    """Slow and fast, with a step of the device file, six digits. Mutation: a off by 1e-4."""
    p = counted(moved(speed))
    (found,) = as_counted(knowing(STEP), [recorded(written(rate(p, cutoff_hz), 7))])
    assert found.outputs == (POSITION,)
    assert found.measured[:, 0] == pytest.approx(p - p[0], abs=1e-6 * STEP)
    (note,) = found.notes
    assert "is what an encoder of 0.000307 counts" in note
    assert ("low-passed" in note) == np.isfinite(cutoff_hz)


@pytest.mark.parametrize("cutoff_hz", [np.inf, 25.0])
def test_without_a_device_file_the_values_tell_the_step(cutoff_hz: float) -> None:
    p = counted(moved(0.7))
    (found,) = as_counted(knowing(0.0), [recorded(written(rate(p, cutoff_hz), 7))])
    assert found.outputs == (POSITION,)
    assert found.measured[:, 0] == pytest.approx(p - p[0], rel=1e-5, abs=1e-6 * STEP)


def test_rounding_in_another_unit_hides_no_step() -> None:
    """Counts times a step in mm/s, taken to m/s: equal ones differ in their last bit."""
    v = np.round(rate(counted(moved(3.0)), np.inf) / (STEP / PERIOD)) * (1e3 * STEP / PERIOD) * 1e-3
    v[::2] *= 1.0 + 3e-16
    (found,) = as_counted(knowing(0.0), [recorded(v)])
    assert found.outputs == (POSITION,)


@pytest.mark.parametrize("step", [0.0, STEP])
def test_what_a_tachometer_rounds_is_no_difference(step: float) -> None:
    """Steps of another size than the encoder's, motion that no error turns with."""
    v = rate(moved(8.0), np.inf)
    rounded = 0.013 * np.round(v / 0.013)
    e = recorded(rounded)
    assert as_counted(knowing(step), [e])[0] is e


@pytest.mark.parametrize("step", [0.0, STEP])
def test_a_velocity_with_noise_stays_one(step: float) -> None:
    """A third of a count."""
    v = rate(counted(moved(3.0)), np.inf)
    e = recorded(v + 0.1 * np.random.default_rng(2).standard_normal(TICKS))
    assert as_counted(knowing(step), [e])[0] is e


def test_one_that_was_not_counted_leaves_all_as_they_are() -> None:
    p = counted(moved(3.0))
    both = [recorded(rate(p, np.inf)), recorded(rate(moved(3.0), np.inf))]
    assert [e.outputs for e in as_counted(knowing(STEP), both)] == [(VELOCITY,), (VELOCITY,)]


@pytest.mark.parametrize("step", [0.0, STEP])
@pytest.mark.parametrize("noise", [1.0, 3.0])
def test_a_tachometer_that_is_rounded_finer_than_its_noise_stays_one(
    step: float, noise: float
) -> None:
    """White noise of whole steps, which the sum would make a drift. Mutation: TURNS = -0.25."""
    unit = STEP / PERIOD
    white = noise * np.random.default_rng(3).standard_normal(TICKS)
    v = unit * np.round(np.gradient(moved(20.0), PERIOD) / unit + white)
    assert as_counted(knowing(step), [recorded(v)])[0].outputs == (VELOCITY,)


def test_a_tachometer_in_steps_of_several_counts_stays_one() -> None:
    """A speed written to a whole number of the encoder's own counts per sample. Mutation: any."""
    unit = 10.0 * STEP / PERIOD
    v = unit * np.round(np.gradient(moved(2000.0), PERIOD) / unit)
    assert as_counted(knowing(STEP), [recorded(v)])[0].outputs == (VELOCITY,)


@pytest.mark.parametrize("spike", [25.0, 10.5])
def test_one_wrong_sample_makes_no_step_of_position(spike: float) -> None:
    v = rate(counted(moved(3.0)), np.inf)
    v[2000] += spike * STEP / PERIOD
    assert as_counted(knowing(STEP), [recorded(v)])[0].outputs == (VELOCITY,)


def test_several_recordings_of_what_depends_on_position_keep_their_velocities() -> None:
    """Each would have an origin of its own, and the model has one."""
    chain = phantom().chain._replace(ground_spring=0.5)
    e = recorded(rate(counted(moved(3.0)), np.inf))
    sprung = knowing(STEP).with_chain(chain)
    assert [one.outputs for one in as_counted(sprung, [e, e])] == [(VELOCITY,)] * 2
    assert as_counted(sprung, [e])[0].outputs == (POSITION,)
    assert [one.outputs for one in as_counted(knowing(STEP), [e, e])] == [(POSITION,)] * 2


def test_errors_of_all_recordings_together_tell_what_one_alone_hides() -> None:
    """Two carts whose velocities a drive differenced: quick motion left -0.35 in one of four."""
    one, other = (
        Counted(np.zeros(1), STEP, 0.0, False, turned, 100.0) for turned in (-34.0, -49.0)
    )
    assert not _turning([one])
    assert _turning([one, other])
    assert _turning([replace(one, known=True)])

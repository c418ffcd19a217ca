"""Half a second at 1 kHz, 50 Hz, 200 samples with a pause: free runs are told of each."""

import numpy as np
import pytest
from numpy.typing import NDArray

from zwidth.diagnosis.noise.predictor import free_run_errors, window
from zwidth.diagnosis.noise.steady import steady
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.plant import hold

Floats = NDArray[np.float64]


def device(period: float) -> Device:
    return Device("one", "", False, make_chain([2.0], [3.0]), Interface(period))


def moved(period: float, command: Floats) -> Experiment:
    """The motion of the device under a command that is held."""
    a, b = hold(device(period).plant(), period)
    x, rows = np.zeros(2), list[float]()
    for u in command.tolist():
        rows.append(float(x[0]))
        x = a @ x + b[:, 0] * u
    noise = 1e-7 * np.random.default_rng(1).standard_normal(command.size)
    return Experiment(period, command, (np.array(rows) + noise)[:, None], (Output("position", 0),))


@pytest.mark.parametrize(
    ("period", "ticks", "still", "longest"),
    [(1e-3, 500, 0, 0.05), (2.0 / 3e3, 810, 0, 0.06), (0.02, 500, 0, 1.0), (0.02, 200, 0, 1.0),
     (0.01, 200, 100, 0.3)],
)  # fmt: skip
def test_some_free_run_fits(period: float, ticks: int, still: int, longest: float) -> None:
    """Windows of what is held out, that are not longer than it. Mutation: `window` at least 50."""
    command = np.repeat(np.random.default_rng(2).standard_normal(ticks // 10), 10)
    command[:still] = 0.0
    e = moved(period, command)
    _, judge_by = e.split()
    one = device(period)
    gain = steady(one, judge_by, 1.0).gain
    length = window(judge_by)
    errors, signal = free_run_errors(one, judge_by, gain, length)
    assert length * period <= longest
    assert errors.shape[0] >= length
    assert np.sqrt(np.mean(errors**2)) < 0.05 * np.sqrt(np.mean(signal**2))

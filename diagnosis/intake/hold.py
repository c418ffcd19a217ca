"""Detects whether a command was held between its samples or smooth (`sim/smooth_command.py`)."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.intake.answering import FOLLOWING
from zwidth.diagnosis.noise.predictor import SETTLING, innovations, observer_near
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.settings import INTAKE
from zwidth.sim.device import Device
from zwidth.sim.smooth_command import held_for

Floats = NDArray[np.float64]
UPPER_BAND = 0.4  # of the sampling frequency; a smooth signal has hardly any power above
SHARE_ABOVE = 1e-3


def smooth(experiment: Experiment) -> Experiment:
    """Return the recording with a command that, when held, acts like the smooth signal."""
    return replace(experiment, command=held_for(experiment.command))


def was_smooth(device: Device, experiment: Experiment) -> float | None:
    """Return the factor by which a smooth command explains the motion better, None if it does not.

    None if the command has power at high frequency, or no observer is possible.
    """
    power = np.abs(np.fft.rfft(experiment.command - experiment.command.mean())) ** 2
    above = np.fft.rfftfreq(experiment.ticks) > UPPER_BAND
    if float(power[above].sum()) > SHARE_ABOVE * float(power.sum()):
        return None
    try:
        gain = observer_near(device, experiment, FOLLOWING)
    except NoObserver:  # then nothing can be compared
        return None
    with np.errstate(all="ignore"):
        held = float(np.std(innovations(device, experiment, gain)[SETTLING:-SETTLING, 0]))
        moved = float(np.std(innovations(device, smooth(experiment), gain)[SETTLING:-SETTLING, 0]))
    factor = held / moved if moved > 0.0 else 1.0
    return factor if np.isfinite(factor) and factor > INTAKE.smooth else None

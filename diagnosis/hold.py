"""A command that was not held from sample to sample, but smooth between them.

A controller holds its command. A command recorded by other equipment is often a sample of a smooth,
band-limited signal u(t): a hold of the samples is then late by half a tick and loses sinc(f T) of
its amplitude. What must be held to act like u(t) in the band is

    c = F^-1[ U(f) exp(+i pi f T) / sinc(f T) ].
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.experiment import Experiment
from zwidth.diagnosis.predictor import SETTLING, innovations, observer_near
from zwidth.diagnosis.steady import NoObserver
from zwidth.sim.device import Device

Floats = NDArray[np.float64]
BETTER = 1.3  # by which the rms of the prediction error must fall
RATIO = 1e2
UPPER_BAND = 0.4  # of the sampling frequency; a smooth signal has next to nothing above
SHARE_ABOVE = 1e-3


def smooth(experiment: Experiment) -> Experiment:
    """Return the recording with the command whose hold acts like the smooth signal."""
    u = experiment.command
    line = np.linspace(u[0], u[-1], u.size)
    slope = (u[-1] - u[0]) / (u.size - 1)
    frequency = np.fft.rfftfreq(u.size)
    turned = np.fft.rfft(u - line) * np.exp(1j * np.pi * frequency) / np.sinc(frequency)
    command = np.fft.irfft(turned, u.size) + line + 0.5 * slope
    return replace(experiment, command=command)


def was_smooth(device: Device, experiment: Experiment) -> float | None:
    """Return the factor by which a smooth command explains the motion better, None if it does not.

    Judged by the device's own prediction, so it needs a command with power at high frequency.
    """
    power = np.abs(np.fft.rfft(experiment.command - experiment.command.mean())) ** 2
    above = np.fft.rfftfreq(experiment.ticks) > UPPER_BAND
    if float(power[above].sum()) > SHARE_ABOVE * float(power.sum()):
        return None
    try:
        gain = observer_near(device, experiment, RATIO)
    except NoObserver:  # then nothing can be compared
        return None
    with np.errstate(all="ignore"):
        held = float(np.std(innovations(device, experiment, gain)[SETTLING:-SETTLING, 0]))
        moved = float(np.std(innovations(device, smooth(experiment), gain)[SETTLING:-SETTLING, 0]))
    factor = held / moved if moved > 0.0 else 1.0
    return factor if np.isfinite(factor) and factor > BETTER else None

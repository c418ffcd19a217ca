"""A sensor that reports the absolute value: fold its readings out again.

A motion through zero comes back from it with its velocity turned at once, which no force can do. So
each sample takes the sign that continues the motion, z_k = s_k y_k nearest to the extrapolation of
the last samples, and the whole the sign under which the nominal device predicts it better. Believed
where that is better by a factor than the readings as they are. Limit: where a motion touches zero
more slowly than its noise, either continuation is as good.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from diagnosis.experiment import Experiment
from diagnosis.predictor import SETTLING, innovations, observer_near
from sim.device import Device

Floats = NDArray[np.float64]
BETTER = 1.5
RATIO = 1e2
BELOW = 0.02  # of the span, that noise may reach below zero
BACK = 4  # samples by which the motion is continued


@dataclass(frozen=True)
class Unfolded:
    """The recording folded out, and by which factor it is predicted better."""

    experiment: Experiment
    factor: float


def unfolded(device: Device, experiment: Experiment) -> Unfolded | None:
    """Return the recording folded out, None where it does not look like absolute values."""
    y = experiment.measured[:, 0]
    if experiment.outputs[0].quantity != "position" or y.min() < -BELOW * float(np.ptp(y)):
        return None
    if y.min() > BELOW * float(np.ptp(y)):  # it never comes near zero
        return None
    z = folded_out(y)
    gain = observer_near(device.without_physics() if device.physics else device, experiment, RATIO)

    def error(first: Floats) -> float:
        tried = replace(experiment, measured=np.column_stack([first, experiment.measured[:, 1:]]))
        with np.errstate(all="ignore"):
            return float(np.std(innovations(device, tried, gain)[SETTLING:, 0]))

    before = error(y)
    after, best = min(((error(s * z), s) for s in (1.0, -1.0)), key=lambda pair: pair[0])
    if not (np.isfinite(after) and before > BETTER * after):
        return None
    measured = np.column_stack([best * z, experiment.measured[:, 1:]])
    return Unfolded(replace(experiment, measured=measured), before / after)


def folded_out(y: Floats) -> Floats:
    """Return y with the signs that continue its motion."""
    z = y.copy()
    for k in range(BACK + 1, y.size):
        ahead = z[k - 1] + (z[k - 1] - z[k - 1 - BACK]) / BACK
        if abs(-y[k] - ahead) < abs(y[k] - ahead):
            z[k] = -y[k]
    return z

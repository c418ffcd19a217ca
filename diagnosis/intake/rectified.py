"""A sensor that reports the absolute value: fold its readings out again.

A motion through zero comes back from it with its velocity turned at once, which no force can do. So
each sample takes the sign that continues the motion, z_k = s_k y_k nearest to the extrapolation of
the last samples, and the whole the sign under which the nominal device predicts it better, by the
observer that predicts it best. Believed where that is better by a factor than the readings as they
are; or by less but surely, where the motion stays on either side for long (noise about zero changes
sides with every sample, and choosing its signs makes it smaller). Limit: where a motion touches
zero more slowly than its noise, either continuation is as good.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.noise.predictor import SETTLING, innovations, observer_near
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.sim.device import Device

Floats = NDArray[np.float64]
BETTER = 1.5
SURE = 200.0  # -2 log likelihood
STAYS = 20  # ticks on a side, in the mean
RATIOS = (1e2, 1e4, 1e6)  # of observers that follow the motion whatever the device's errors
BELOW = 0.02  # of the span, that noise may reach below zero
BOTH = 0.05  # of the span, that the motion folded out goes to either side of zero at least
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
    # A motion to one side alone was not folded: turned as a whole, it is a sign, which others tell.
    if min(float(z.max()), -float(z.min())) < BOTH * float(np.ptp(y)):
        return None
    plain = device.without_physics() if device.physics else device
    try:
        gains = [observer_near(plain, experiment, ratio) for ratio in RATIOS]
    except NoObserver:  # then nothing can be compared
        return None

    def error(first: Floats) -> float:
        tried = replace(experiment, measured=np.column_stack([first, experiment.measured[:, 1:]]))
        with np.errstate(all="ignore"):
            left = [innovations(device, tried, gain)[SETTLING:, 0] for gain in gains]
            return float(np.nanmin([np.std(e) for e in left]))

    before = error(y)
    after, best = min(((error(s * z), s) for s in (1.0, -1.0)), key=lambda pair: pair[0])
    if not (np.isfinite(after) and before > after):
        return None
    stays = y.size > STAYS * (1 + np.count_nonzero(np.diff(np.signbit(z))))
    surely = stays and 2.0 * y.size * np.log(before / after) > SURE
    if not (surely or before > BETTER * after):
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

"""A sensor that reports absolute values: restores the sign of its readings.

A rectified position returns from zero with its velocity reversed at once, which no force can cause
(a rectified velocity with its acceleration reversed). So each sample gets the sign that continues
the motion: z_k = s_k y_k is nearest to the extrapolation of the last samples. Then signs and a
linear system between command and z are fitted in turn, and the whole gets the sign with which the
nominal device predicts it better, with the best observer. The result is used if it is better than
the readings as they are by a factor; or by less but clearly, if the motion stays on either side for
long (noise about zero changes sides with every sample, and choosing its signs makes it smaller); or
if the device file states such a sensor. Limit: if a motion touches zero more slowly than its noise,
both continuations are equally good.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.noise.predictor import SETTLING, innovations, observer_near
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.evidence import ALPHA
from zwidth.diagnosis.settings import INTAKE
from zwidth.sim.device import Device
from zwidth.sim.physics.rectified_sensor import rectified_sensor
from zwidth.sim.signs import likeliest_signs

Floats = NDArray[np.float64]
STAYS = 10  # mean number of ticks on a side
RATIOS = (1e2, 1e4, 1e6)  # ratios of observers that track the motion despite errors of the device
BELOW = 0.02  # of the span: how far noise may reach below zero
BOTH = 0.05  # of the span: least motion to either side of zero after unfolding
BACK = (1, 2, 4)  # samples by which the motion is continued
ORDER = 6  # samples that the linear system remembers: three masses
TURNS = 30  # most alternations of signs and system


@dataclass(frozen=True)
class Unfolded:
    """The recording with its signs restored, and the factor by which its prediction is better."""

    experiment: Experiment
    factor: float


def unfolded(device: Device, experiment: Experiment) -> Unfolded | None:
    """Return the recording with its signs restored, None if it does not look rectified."""
    y = experiment.measured[:, 0]
    span = float(np.ptp(y))
    if y.min() < -BELOW * span or y.min() > BELOW * span:  # negative, or never near zero
        return None
    z = folded_out(y, experiment.command)
    # A motion on one side was not folded: its sign as a whole is tested elsewhere.
    if min(float(z.max()), -float(z.min())) < BOTH * span:
        return None
    try:
        before, *turned = _errors(device, experiment, (y, z, -z))
    except NoObserver:
        return None
    after = min(turned)
    if not (np.isfinite(after) and before > after):
        return None
    crossings = int(np.count_nonzero(np.diff(np.signbit(z))))
    price = 2.0 * math.log(2.0) * crossings - 2.0 * math.log(ALPHA * rectified_sensor.prior)
    gained = 2.0 * (y.size - SETTLING) * math.log(before / after)
    surely = y.size > STAYS * (1 + crossings) and gained > price
    if not (surely or before > INTAKE.better * after):
        return None
    best = z if turned[0] == after else -z
    return Unfolded(replace(_with_first(experiment, best), folded=True), before / after)


def as_known(device: Device, experiment: Experiment) -> Experiment:
    """Return the recording with its signs restored, for a device whose file has such a sensor."""
    z = folded_out(np.abs(experiment.measured[:, 0]), experiment.command)
    there, turned = np.inf, np.inf
    with suppress(NoObserver):  # then the better sign is unknown
        there, turned = _errors(device, experiment, (z, -z))
    return replace(_with_first(experiment, -z if turned < there else z), folded=True)


def _errors(device: Device, experiment: Experiment, readings: Sequence[Floats]) -> list[float]:
    """Rms innovation for each version of the first output; may raise NoObserver."""
    plain = device.bare()
    gains = [observer_near(plain, experiment, ratio) for ratio in RATIOS]
    found: list[float] = []
    for first in readings:
        tried = _with_first(experiment, first)
        with np.errstate(all="ignore"):
            left = [innovations(plain, tried, gain)[SETTLING:, 0] for gain in gains]
            found.append(float(np.nanmin([np.std(e) for e in left])))
    return found


def _with_first(experiment: Experiment, first: Floats) -> Experiment:
    return replace(experiment, measured=np.column_stack([first, experiment.measured[:, 1:]]))


def folded_out(y: Floats, command: Floats) -> Floats:
    """Return y with the signs with which it moves most like a linear system under a command.

    The signs that continue the motion over one, two and four samples are tried, and those of least
    error kept. The sign of the whole may still be wrong.
    """
    starts = [np.where(continued(y, back) < 0.0, -1.0, 1.0) for back in BACK]
    found = [_consistent(y, command, s) for s in starts] if y.size > 4 * ORDER else []
    if not found:
        return starts[-1] * y
    signs, _ = min(found, key=lambda pair: pair[1])
    return signs * y


def continued(y: Floats, back: int) -> Floats:
    """Return y with the signs that continue its motion over `back` samples."""
    z = y.copy()
    for k in range(back + 1, y.size):
        ahead = z[k - 1] + (z[k - 1] - z[k - 1 - back]) / back
        if abs(-y[k] - ahead) < abs(y[k] - ahead):
            z[k] = -y[k]
    return z


def _consistent(y: Floats, command: Floats, signs: Floats) -> tuple[Floats, float]:
    """Return signs that a linear system fitted to them predicts best, and its square error.

    Alternates between the system, by least squares, and its most likely signs (`sim.signs`).
    """
    error = np.inf
    for _ in range(TURNS):
        z = signs * y
        past = [z[ORDER - i - 1 : z.size - i - 1] for i in range(ORDER)]
        past += [command[ORDER - j : command.size - j] for j in range(ORDER + 1)]
        solved, *_ = np.linalg.lstsq(np.column_stack(past), z[ORDER:], rcond=None)
        fitted = np.asarray(solved, dtype=np.float64)
        found, less = likeliest_signs(y, command, fitted[:ORDER], fitted[ORDER:], signs[:ORDER])
        if not less < error:
            break
        signs, error = found, less
    return signs, error

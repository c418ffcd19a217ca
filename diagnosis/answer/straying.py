"""How far free runs stray from recordings.

After a contact through play, or where friction nearly slips, a tiny difference becomes a large one,
however right the model is: with all of the true physics of a rig, six runs of half a second erred
by 1 to 2 % of the motion, and two by 27 and 74 %. Missing physics that moves a machine moves most
runs aside. So the typical run tells whether an answer strays, and the mean error is reported.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.fit import Fitted
from zwidth.diagnosis.noise.gaps import Gain
from zwidth.diagnosis.noise.predictor import Observer, deviation, free_run_errors, window
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.settings import ADEQUACY
from zwidth.sim.device import Device
from zwidth.sim.predict import OVERFLOW

Floats = NDArray[np.float64]


class Strayed(NamedTuple):
    """Free runs in the first output, rms: their error, that of the typical run, and the motion.

    typical: runs with half of the squared motion err no more.
    """

    error: float
    typical: float
    motion: float


def strayed(device: Device, seen: Sequence[Experiment], gain: Gain) -> Strayed:
    """Return how far free runs of a device stray on recordings as it reads them; NaN for none."""
    squares: list[Floats] = []
    for e in seen:
        each = free_run_errors(device, e, gain, window(e))
        with np.errstate(all="ignore"):  # infinite after an overflow
            squares.append(
                np.array([np.mean(a[:, 0].reshape(-1, window(e)) ** 2, axis=1) for a in each])
            )
    errors, motions = np.hstack(squares)
    if not errors.size:
        return Strayed(np.nan, np.nan, np.nan)
    errors[np.isnan(errors)] = np.inf
    order = np.argsort(errors)
    share = np.cumsum(motions[order])
    typical = errors[order[int(np.searchsorted(share, 0.5 * share[-1]))]]
    with np.errstate(all="ignore"):
        return Strayed(*np.sqrt([errors.mean(), typical, motions.mean()]).tolist())


def rms(parts: Sequence[Floats]) -> float:
    """Return the rms of all parts together, NaN if they are empty."""
    joined = np.concatenate(parts)
    return float(np.sqrt(np.mean(joined**2))) if joined.size else float("nan")


def wander(typical: float, floor: float) -> bool:
    """Whether a typical free run errs too far beyond the noise of readings; False if NaN.

    Far: by more than `ADEQUACY.chance` (a share of the motion), and by more than the noise of
    readings. Both are relative to the motion.

    A noise model of slow forces predicts any error of free runs as chance, including one from
    unknown physics: an answer can be adequate and still predict badly.
    """
    return beyond_noise(typical, floor) and typical**2 - floor**2 > ADEQUACY.chance**2


def beyond_noise(error: float, floor: float) -> bool:
    """Whether more than half of a squared error is not noise of readings."""
    return error**2 > 2.0 * floor**2


def wandering(final: Fitted, observer: Observer, experiments: Sequence[Experiment]) -> bool:
    """Whether free runs of an answer `wander` on recordings that it was fitted to."""
    device = final.model.acting(final.x)
    seen = [final.model.seen(e, final.x) for e in experiments]
    _, typical, motion = strayed(device, seen, observer.gain)
    floor = float(deviation(device, seen, observer.gain)[0])
    return motion > 0.0 and wander(min(typical, OVERFLOW) / motion, floor / motion)

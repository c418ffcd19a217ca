"""How far free runs stray, and how much of it no model could avoid.

A free run errs by the noise of its readings, and by what the noise of earlier readings does to the
state in which it begins. After a contact through play, or where friction hardly holds, a tiny
difference becomes a large one, however right the model is: with true physics, one run of half a
second in four erred by 30 times the noise of readings. So each recording is followed again with
`DRAWS` draws of such noise more, and of each run's error, up to `FAR` times what they move it by
counts as unavoidable.

The noise of readings is that of their fourth differences, in which a smooth motion leaves nothing,
and at most that of the innovations, which hold missing physics too.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.fit import Fitted
from zwidth.diagnosis.noise.gaps import Gain
from zwidth.diagnosis.noise.predictor import (
    Observer,
    deviation,
    free_run_errors,
    free_run_starts,
    window,
)
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.settings import ADEQUACY
from zwidth.sim.device import Device
from zwidth.sim.predict import OVERFLOW

Floats = NDArray[np.float64]
DRAWS, SEED = 8, 0
FAR = 3.0  # deviations within which one draw of the noise lies almost always
OF_FOUR = 70.0  # variance of a fourth difference of white noise of variance 1


def strayed(device: Device, seen: Sequence[Experiment], gain: Gain) -> tuple[float, float]:
    """Return the error of free runs in the first output, and the motion in their windows; rms."""
    each = [free_run_errors(device, e, gain, window(e)) for e in seen]
    return rms([error[:, 0] for error, _ in each]), rms([motion[:, 0] for _, motion in each])


def unavoidable(
    device: Device, seen: Sequence[Experiment], observer: Observer, noise: Floats, error: float
) -> float:
    """Return the unavoidable part of an error (rms) of free runs, the noise (o,) of readings incl.

    Only the noise, where the error is no more than that, or where a run runs away.
    """
    least = float(noise[0])
    if not math.isfinite(error) or not beyond_noise(error, least):
        return least
    squares = np.concatenate([_unavoidable(device, e, observer.gain, noise) for e in seen])
    return float(np.hypot(least, np.sqrt(np.mean(squares)))) if squares.size else least


def _unavoidable(device: Device, e: Experiment, gain: Gain, noise: Floats) -> Floats:
    """Mean squares (runs,) that noise of readings before each run explains."""
    ticks = window(e)
    errors, _ = free_run_errors(device, e, gain, ticks)
    starts = free_run_starts(e, ticks)
    rows = (np.array(starts, dtype=np.int64)[:, None] + np.arange(ticks)).ravel()
    fourth = np.diff(e.measured, 4, axis=0)
    quiet = np.minimum(np.sqrt(np.mean(fourth**2, axis=0) / OF_FOUR), noise)
    random, moved = np.random.default_rng(SEED), np.zeros(rows.size)
    with np.errstate(all="ignore"):  # infinite after an overflow
        for _ in range(DRAWS):
            more = quiet * random.standard_normal(e.measured.shape)
            again, _ = free_run_errors(device, replace(e, measured=e.measured + more), gain, ticks)
            moved += (again - errors - more[rows])[:, 0] ** 2 / DRAWS
        own, by_noise = (a.reshape(-1, ticks).mean(axis=1) for a in (errors[:, 0] ** 2, moved))
        return np.minimum(own, FAR**2 * np.nan_to_num(by_noise, nan=np.inf))


def rms(parts: Sequence[Floats]) -> float:
    """Return the rms of all parts together, NaN if they are empty."""
    joined = np.concatenate(parts)
    with np.errstate(all="ignore"):  # infinite after an overflow
        return float(np.sqrt(np.mean(joined**2))) if joined.size else float("nan")


def wander(error: float, floor: float) -> bool:
    """Whether free runs err too far beyond what is unavoidable; False if NaN.

    Far: by more than `ADEQUACY.chance` (a share of the motion), and by more than the floor. Both
    are relative to the motion.

    A noise model of slow forces predicts any error of free runs as chance, including one from
    unknown physics: an answer can be adequate and still predict badly.
    """
    return beyond_noise(error, floor) and error**2 - floor**2 > ADEQUACY.chance**2


def beyond_noise(error: float, floor: float) -> bool:
    """Whether more than half of a squared error is not unavoidable."""
    return error**2 > 2.0 * floor**2


def wandering(final: Fitted, observer: Observer, experiments: Sequence[Experiment]) -> bool:
    """Whether free runs of an answer `wander` on recordings that it was fitted to."""
    device = final.model.acting(final.x)
    seen = [final.model.seen(e, final.x) for e in experiments]
    error, motion = strayed(device, seen, observer.gain)
    floor = unavoidable(device, seen, observer, deviation(device, seen, observer.gain), error)
    return motion > 0.0 and wander(min(error, OVERFLOW) / motion, floor / motion)

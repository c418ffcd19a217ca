"""The error band of an improved device: errors of its free runs, kept for later recordings.

The band is measured on held-out data exactly as a later check measures it: from the device file
alone, with the observer whose ratio the file keeps. Each window starts in the observer's state and
then runs free.

The motion of a window is its deviation from its mean. A recording of larger motion may err
proportionally more; one of smaller motion may err no less, since dry friction does not shrink with
the motion. If n windows have mean squares that scatter by the share s of their mean, m further ones
have a mean square of at most

    error^2 max(1, motion^2 / motion_n^2) (1 + t s sqrt(1 / n + 1 / m)),

where t is Student's quantile with n - 1 degrees of freedom, exceeded once in a thousand. A few
windows may agree by chance, so s is at least 0.5: the scatter of a mean square with eight degrees
of freedom, about as many as the initial state and slow noise leave. (Six windows of a simulated
bench scattered by 0.06 to 0.19 in twelve recordings. With these values alone, a thirteenth was
called changed because its windows had started less well.) Limits: overlapping information makes
windows scatter less than recordings do. A machine that was warm when it was diagnosed is outside
its band while it is cold; a check is meant to report this.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from zwidth.diagnosis.intake.gate import Fault
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import followed_by
from zwidth.diagnosis.noise.predictor import (
    SHORTEST_WINDOW,
    Observer,
    beginning_near,
    deviation,
    free_run_errors,
    window,
)
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.sim.band import Band, OutputBand
from zwidth.sim.device import Device

Floats = NDArray[np.float64]
WINDOWS = 6  # least number, if the held-out data are long enough
LESS_TRUSTING = (1.0, 10.0, 100.0, 1e3)  # factors on the ratio of the fit
SCATTER = 0.5  # least scatter of mean squares
RARE = 1e-3  # probability that an unchanged machine is called changed


@dataclass(frozen=True)
class Windows:
    """Free runs over windows: mean squares (windows, o) of error and motion; noise (o,) is rms."""

    names: tuple[str, ...]
    error: Floats
    motion: Floats
    noise: Floats

    @property
    def rms(self) -> Floats:
        """Rms error of each output over all windows, (o,); infinite after an overflow."""
        return np.sqrt(self.error.mean(axis=0))


def windows_of(
    model: Model, x: Floats, experiments: Sequence[Experiment], ratio: float, seconds: float
) -> Windows:
    """Return free runs of a model at x from an observer's states; may raise NoObserver."""
    built = model.acting(x)
    seen = [model.seen(e, x) for e in experiments]
    gain = beginning_near(built, seen, ratio)
    noise = deviation(built, seen, gain)
    observer = Observer(gain, np.maximum(noise, np.finfo(np.float64).tiny), ratio)
    errors: list[Floats] = []
    motions: list[Floats] = []
    for e in seen:
        ticks = min(max(SHORTEST_WINDOW, round(seconds / e.period)), e.ticks)
        with np.errstate(all="ignore"):  # infinite after an overflow
            free = free_run_errors(built, followed_by(built, e, observer), gain, ticks)
            error, motion = (
                np.mean(one.reshape(-1, ticks, one.shape[1]) ** 2, axis=1) for one in free
            )
        errors.append(np.nan_to_num(error, nan=np.inf))
        motions.append(motion)
    names = tuple(o.name for o in experiments[0].outputs)
    return Windows(names, np.concatenate(errors), np.concatenate(motions), noise)


def band_of(
    device: Device, judge_by: Sequence[Experiment], ratio: float, faults: Sequence[Fault] = ()
) -> Band | None:
    """Return the band of a device on held-out data, None for fewer than two windows.

    ratio: of the observer of the fit. The band uses the best of several that trust the device less:
    a device file has rounded numbers and no recording's own values, so an observer that trusts it
    fully predicts worse. Raises NoObserver if none is possible.
    """
    model = Model(device)
    ratio = min(LESS_TRUSTING, key=partial(_noise, model, judge_by, ratio)) * ratio
    shortest = min(judge_by, key=lambda e: e.ticks)
    ticks = max(SHORTEST_WINDOW, min(window(shortest), sum(e.ticks for e in judge_by) // WINDOWS))
    seconds = ticks * shortest.period
    found = windows_of(model, np.zeros(len(model.parameters)), judge_by, ratio, seconds)
    return of_windows(found, seconds, ratio, [f.kind for f in faults if f.wrong])


def _noise(model: Model, judge_by: Sequence[Experiment], ratio: float, times: float) -> float:
    """Deviation of the first output's innovations with a ratio so many times as large."""
    x = np.zeros(len(model.parameters))
    built, seen = model.acting(x), [model.seen(e, x) for e in judge_by]
    noise = float(deviation(built, seen, beginning_near(built, seen, times * ratio))[0])
    return noise if math.isfinite(noise) else math.inf


def of_windows(
    found: Windows, seconds: float, ratio: float, corrected: Sequence[str] = ()
) -> Band | None:
    """Return the band from windows of so many seconds; None for fewer than two or an overflow."""
    count = found.error.shape[0]
    if count < 2 or not np.all(np.isfinite(found.error)):
        return None
    squares = found.error.mean(axis=0)
    with np.errstate(all="ignore"):
        scatter = np.nan_to_num(found.error.std(axis=0, ddof=1) / squares)
    each = zip(
        found.names, found.rms.tolist(), found.noise.tolist(),
        np.sqrt(found.motion.mean(axis=0)).tolist(), scatter.tolist(), strict=True,
    )  # fmt: skip
    outputs = tuple(OutputBand(*one) for one in each)
    return Band(seconds, count, ratio, outputs, tuple(dict.fromkeys(corrected)))


def most(band: Band, output: OutputBand, found: Windows) -> float:
    """Return the largest rms error of an output with which a device is still within its band."""
    place = found.names.index(output.name)
    moved = float(found.motion[:, place].mean())
    grown = max(1.0, moved / output.motion**2) if output.motion > 0.0 else 1.0
    chance = float(student.ppf(1.0 - RARE, band.windows - 1)) * max(SCATTER, output.scatter)
    chance *= math.sqrt(1.0 / band.windows + 1.0 / found.error.shape[0])
    return output.error * math.sqrt(grown * (1.0 + chance))


def with_band(
    device: Device, judge_by: Sequence[Experiment], ratio: float, faults: Sequence[Fault]
) -> Device:
    """Return the device with its band, or without one if it cannot be measured."""
    try:
        return replace(device, band=band_of(device, judge_by, ratio, faults))
    except NoObserver:
        return replace(device, band=None)

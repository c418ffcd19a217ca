"""Detection, by free runs, of a drive that gave no force for a stretch of a recording.

The prediction of the next sample hardly shows this: an observer tracks the device, and missing
forces count as noise. A free run of half a second (`noise.predictor.free_run_errors`) depends on
the assumed force. So with the expected parameters x, and the drive off in [a, b),

    err(a, b) = rms error of free runs,    the stretch is arg min over a < b,

on a grid of a twentieth of the recording, and then each edge is bisected down to a sample. The
stretch is accepted if it halves the error of free runs, and if the error without it is larger than
the motion itself. A wrong parameter of the device does not have this effect, and if the drive was
always on, no stretch is accepted. (Leaving out a command of the wrong sign also halves the error;
the caller compares with the other ways to read a recording.)

Limits: one stretch, not the whole recording (that would be a free motion). The back-EMF of a
winding still acts, as in a recording whose [enable] states that its drive was off.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.predictor import free_run_errors, window
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.hypothesis import judged

Floats = NDArray[np.float64]
PARTS = 20  # of a recording: grid on which a stretch is sought
HALF = 0.5  # largest ratio of free-run errors, with and without the stretch, to accept it
LOST = 1.0  # free-run error over the motion, from which the recording is not explained


class Off(NamedTuple):
    """A stretch [s] with the drive off; on, off: errors of free runs without and with it."""

    from_s: float
    to_s: float
    on: float
    off: float


def free_error(e: Experiment, model: Model, x: Floats) -> float:
    """Return the rms error of free runs over the rms motion, infinite if no run is possible."""
    try:
        runs = _FreeRuns(e, model, x)
    except (NoObserver, ValueError):
        return np.inf
    off, size = runs.error(0, 0)
    return off / size if size > 0.0 else np.inf


class _FreeRuns:
    """Free runs of a recording at x, with the drive off in a part of it."""

    def __init__(self, e: Experiment, model: Model, x: Floats) -> None:
        noise = judged([e], model, x).noise
        self.model, self.x, self.device = model, x, model.acting(x)
        self.gain, self.window = noise.observer.gain, window(e)
        (self.begun,) = noise.problem([e]).experiments
        self.known = np.ones(e.ticks) if e.strengths is None else e.strengths

    def error(self, first: int, last: int) -> tuple[float, float]:
        """Return the rms error with the drive off in first <= k < last, and the rms motion."""
        strengths = self.known.copy()
        strengths[first:last] = 0.0
        seen = self.model.seen(replace(self.begun, strengths=strengths), self.x)
        with np.errstate(all="ignore"):  # infinite after an overflow
            errors, motion = free_run_errors(self.device, seen, self.gain, self.window)
            size = float(np.sqrt(np.mean(motion[:, 0] ** 2))) if motion.size else 0.0
            off = float(np.sqrt(np.mean(errors[:, 0] ** 2))) if size else 0.0
        return (off if np.isfinite(off) else np.inf), size


def switched_off(e: Experiment, model: Model, x: Floats) -> Off | None:
    """Return the stretch in which the drive gave no force, or None; raises NoObserver."""
    error = _FreeRuns(e, model, x).error
    on, size = error(0, 0)
    if not on > LOST * size > 0.0:
        return None
    edges = np.linspace(0, e.ticks, PARTS + 1).round().astype(int).tolist()
    stretches = [(a, b) for i, a in enumerate(edges) for b in edges[i + 1 :] if b - a < edges[-1]]
    a, b = min(stretches, key=lambda stretch: error(*stretch)[0])
    step = e.ticks // PARTS // 2
    while step:
        near = [(a + da, b + db) for da in (-step, 0, step) for db in (-step, 0, step)]
        kept = [(i, j) for i, j in near if 0 <= i < j <= e.ticks and j - i < e.ticks]
        a, b = min(kept, key=lambda stretch: error(*stretch)[0])
        step //= 2
    least = error(a, b)[0]
    if least > HALF * on:
        return None
    return Off(e.begins + a * e.period, e.begins + b * e.period, on / size, least / size)

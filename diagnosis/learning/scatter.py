"""Scatter of the innovations by state of the device: at impacts it is larger.

An observer of one gain assumes that innovations are equally large everywhere. With a nonsmooth law
they are not: at an impact in a link with play, or at a reversal with friction, an error of the
state that is elsewhere negligible decides how the device continues. So the same observer is run
again on the recording plus noise v_k of the innovations' own size, and

    s_t = mean over k and over `TICKS` about t of |r_t(y + v_k) - r_t(y)|^2

gives the sensitivity to errors at t, which is constant for a linear device. Ticks of similar s form
one class (`CLASSES` classes of equal size), whose innovations are divided by their own root mean
square. They then have variance 1 in every class, and an event stands out among similar states.
Their root mean squares on two masses with play, read every 5 ms: 0.85 in 14 of 16 classes, 1.3 and
1.8 in the two most sensitive, which contained the peaks of all false alarms.

Limits: an event raises the scatter of its own class, so its gain is at most the number of ticks of
the class, which is far beyond chance. Errors of laws, as opposed to errors of the state, are only
covered if they fall in the same classes.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from zwidth.diagnosis.account import reason
from zwidth.diagnosis.noise.predictor import SEARCHING, SETTLING, innovations, prepared
from zwidth.diagnosis.selection.hypothesis import Hypothesis

Floats = NDArray[np.float64]
READINGS = 16  # runs with added noise: s is known to a tenth
TICKS = 7
CLASSES = 16
SEED = 0


def scatter_in_like_states(h: Hypothesis, apart: Sequence[NDArray[np.bool_]]) -> list[Floats]:
    """Return the scale (ticks, o) of whitened innovations, 1 on average; apart: known events."""
    outputs, row = h.noise.observer.deviation.size, 0
    residual: list[Floats] = []
    for e in h.experiments:
        rows = (e.ticks - SETTLING) * outputs
        residual.append(h.residual[row : row + rows].reshape(-1, outputs))
        row += rows
    kept = ~np.concatenate([a[SETTLING:] for a in apart])
    told = _scales(np.concatenate(residual), _sensitivity(h), kept)
    ends = np.cumsum([r.shape[0] for r in residual])[:-1]
    return [np.pad(s, ((SETTLING, 0), (0, 0)), "edge") for s in np.split(told, ends)]


def _sensitivity(h: Hypothesis) -> Floats:
    """Sensitivity of the innovations to an error of the readings, at each tick (samples, o)."""
    random, device, observer = np.random.default_rng(SEED), h.model.acting(h.x), h.noise.observer
    found: list[Floats] = []
    for e in h.problem.experiments:
        seen = h.model.seen(e, h.x)
        ready = prepared(seen.on(device), SEARCHING)
        total = np.zeros(e.measured.shape)
        with reason("innovations in like states"):
            own = observer.weigh(innovations(device, seen, observer.gain, ready=ready))
            for _ in range(READINGS):
                noise = observer.deviation * random.standard_normal(e.measured.shape)
                moved = replace(seen, measured=seen.measured + noise)
                white = observer.weigh(innovations(device, moved, observer.gain, ready=ready))
                total += np.nan_to_num(white - own, nan=0.0, posinf=0.0, neginf=0.0) ** 2
        found.append(uniform_filter1d(total / READINGS, TICKS, axis=0)[SETTLING:])
    return np.concatenate(found)


def _scales(residual: Floats, sensitivity: Floats, kept: NDArray[np.bool_]) -> Floats:
    """Root mean square (samples, o) of the class of each sample, relative to that of all."""
    found = np.ones(residual.shape)
    for o in range(residual.shape[1]):
        whole = float(np.mean(residual[kept, o] ** 2))
        for ticks in np.array_split(np.argsort(sensitivity[:, o]), CLASSES):
            own = residual[ticks[kept[ticks]], o]
            if own.size and whole > 0.0:
                found[ticks, o] = np.sqrt(np.mean(own**2) / whole)
    return np.where(found > 0.0, found, 1.0)

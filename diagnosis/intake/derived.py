"""Detects velocities computed from positions of the same recording, and leaves them out.

    v_k = a_1 v_(k-1) + a_2 v_(k-2) + sum_j b_j (p_(k-j) - p_(k-j-1)) + e_k,    j = -LEAD ... LAG,

by least squares. If the velocity has noise of its own, e is at least that noise. If it was computed
from p (by differences, central ones, moving means, filters of first and second order), e is the
last digit that was written. As a second measurement it would repeat the encoder's noise: an
observer that assumes independent noise treats such a pair as nearly exact, and the physics as
disturbance (of friction at 340 sigma, 8 were left).

A velocity counts as computed if e is far below the roughness of v, and if the same filter run on p
alone, without any v, still gives v. (An oscillation predicts itself by its own last two values.)
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis.settings import INTAKE

Floats = NDArray[np.float64]
LEAD, LAG = 8, 16  # samples: for central differences and smoothing, and for moving means
FEEDBACK = 2
FOLLOWED = 1e-3  # of v: largest error of the filter run alone
FORGOTTEN = 200  # samples after which a filter has forgotten its start


def measured_alone(experiments: Sequence[Experiment]) -> list[Experiment]:
    """Return recordings without velocities that were computed from a position in all of them."""
    shared = [o for o in experiments[0].outputs if all(o in e.outputs for e in experiments)]
    gone = [
        o
        for o in shared
        if o.quantity == "velocity"
        and Output("position", o.mass) in shared
        and all(_worked_out(e, o) for e in experiments)
    ]
    return [_without(e, gone) for e in experiments] if gone else list(experiments)


def _without(e: Experiment, gone: Sequence[Output]) -> Experiment:
    kept = [i for i, o in enumerate(e.outputs) if o not in gone]
    measured = e.measured[:, kept]
    notes = [
        f"{o.name} of {e.name} is position_m{o.mass + 1} differenced or filtered, not a measurement"
        " of its own: it is left out, since it adds nothing"
        for o in gone
    ]
    outputs = tuple(e.outputs[i] for i in kept)
    swing = e.swing if kept[0] == 0 else float(np.std(measured[:, 0]))
    return replace(e, measured=measured, outputs=outputs, swing=swing, notes=(*e.notes, *notes))


def _worked_out(e: Experiment, velocity: Output) -> bool:
    """Whether a velocity is the filtered position of the same mass."""
    p = e.measured[:, e.outputs.index(Output("position", velocity.mass))]
    v = e.measured[:, e.outputs.index(velocity)]
    steps = np.diff(p, prepend=p[0]) / e.period
    rows = np.arange(max(LAG, FEEDBACK), e.ticks - LEAD)
    if rows.size < 4 * (LEAD + LAG):
        return False
    fed_back = [v[rows - i] for i in range(1, FEEDBACK + 1)]
    matrix = np.column_stack([*fed_back, *(steps[rows - j] for j in range(-LEAD, LAG + 1))])
    size = np.sqrt(np.mean(matrix**2, axis=0))
    if not np.all(size > 0.0):
        return False
    found = np.linalg.lstsq(matrix / size, v[rows])[0] / size
    left = v[rows] - matrix @ found
    rough = np.diff(v, 2) / np.sqrt(6.0)
    if not _rms(left) < INTAKE.worked_out * _rms(rough):
        return False
    a, b = found[:FEEDBACK], found[FEEDBACK:]
    if np.any(np.abs(np.roots([1.0, *-a])) >= 1.0):
        return False
    fed = lfilter(b, [1.0, *-a], np.concatenate([steps[LEAD:], np.zeros(LEAD)]))
    after = slice(max(LAG, min(FORGOTTEN, e.ticks // 2)), e.ticks - LEAD)
    return _rms(v[after] - fed[after]) < FOLLOWED * _rms(v[after])


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))

"""Errors of free runs over whole recordings, per output: in its unit and relative to the motion.

The model starts where the recording does and is never corrected. If the fit reads a recording in
another form, the run is converted back: a position that was counted from a velocity is differenced
and filtered again, v_k = a v_(k-1) + (1 - a) (q_k - q_(k-1)) / T, and an unfolded sensor is folded
again.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from zwidth.diagnosis.answer.held_out import models_of, told_of
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import followed_by
from zwidth.diagnosis.noise.predictor import Observer, memory_at, prepared
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.searched import Searched
from zwidth.shown import Valued
from zwidth.sim.device import Device
from zwidth.sim.predict import alone

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class WholeRun(Valued):
    """Errors of free runs over a recording, rms in the unit of an output.

    measured (ticks,), from begins [s] on, every period [s]; simulated (ticks,): "before" (the
    device file), "refit", "after" (the answer), and "law" (with a learned law, if any). held_out:
    whether nothing was fitted to the recording. bridged (ticks,): ticks without a measurement,
    whose errors do not count. folded: whether the output is an absolute value.
    """

    recording: str
    output: str
    unit: str
    begins: float
    period: float
    measured: Floats
    simulated: Mapping[str, Floats]
    held_out: bool
    bridged: NDArray[np.bool_] | None = None
    folded: bool = False

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which ticks were measured."""
        gone = self.bridged
        return np.ones(self.measured.size, dtype=np.bool_) if gone is None else ~gone

    @property
    def motion(self) -> float:
        """Rms of the measurement about its mean."""
        return float(self.measured[self.known].std())

    @property
    def errors(self) -> dict[str, float]:
        """Rms errors, infinite after an overflow."""
        known = self.known
        with np.errstate(all="ignore"):
            off = {name: (s - self.measured)[known] for name, s in self.simulated.items()}
            return {name: finite_rms(e) for name, e in off.items()}

    @property
    def shares(self) -> dict[str, float]:
        """Rms errors over the motion."""
        motion = self.motion or math.nan
        return {name: e / motion for name, e in self.errors.items()}

    def as_json(self) -> dict[str, Any]:
        """Return the JSON form: errors in units, and over the motion."""
        return {
            "recording": self.recording, "output": self.output, "unit": self.unit,
            "rms": self.errors, "motion_rms": self.motion, "share": self.shares,
            "held_out": self.held_out,
        }  # fmt: skip


def finite_rms(errors: Floats) -> float:
    """Return the rms of errors (ticks,), infinite after an overflow."""
    with np.errstate(all="ignore"):
        size = float(np.sqrt(np.mean(errors**2)))
    return size if math.isfinite(size) else math.inf


def whole_runs(
    device: Device,
    found: Searched,
    fitted: Sequence[Experiment],
    judge_by: Sequence[Experiment],
    law: Searched | None = None,
) -> tuple[WholeRun, ...]:
    """Return the whole runs of fitted and held-out recordings.

    The held-out rest of a recording runs from the end of its first part. law: the fit with a
    learned law, None if none was learned.
    """
    models = {name: (*own, found.judge) for name, own in models_of(device, found).items()}
    if law is not None:  # with its own observer, since another may not be able to follow it
        models["law"] = law.final.model, law.final.x, law.judge
    length = "rad" if device.rotary else "m"
    runs: list[WholeRun] = []
    for e, held in told_of(fitted, judge_by):
        each = {name: simulated(model, x, e, judge) for name, (model, x, judge) in models.items()}
        measured = recorded(e, e.measured)
        for o, output in enumerate(e.outputs):
            quantity = "velocity" if output in e.differenced else output.quantity
            unit = length if quantity == "position" else f"{length}/s"
            if o == 0 and e.pushed is not None:
                quantity, unit = "force", "N m" if device.rotary else "N"
            name = f"{quantity}_{output.at}"
            said = {word: found[:, o] for word, found in each.items()}
            about = e.name, name, unit, e.begins, e.period
            folded = o == 0 and e.folded
            runs.append(WholeRun(*about, measured[:, o], said, held, e.bridged, folded))
    return tuple(runs)


def simulated(
    model: Model, x: Floats, e: Experiment, observer: Observer, measured: bool = True
) -> Floats:
    """Outputs (ticks, o), as recorded, of a free run without any correction.

    measured: whether the initial state fits the recording best; else the first samples give it.
    """
    return recorded(e, free_run(model, x, e, observer, measured))


def free_run(
    model: Model, x: Floats, e: Experiment, observer: Observer, measured: bool = True
) -> Floats:
    """The same outputs (ticks, o), in the form in which the fit reads the recording."""
    device = model.acting(x)
    seen = model.seen(e, x)
    seen = followed_by(device, seen, observer) if measured else seen
    eq, fine = ready = prepared(seen.on(device))
    with np.errstate(all="ignore"):  # infinite after an overflow
        blind = np.zeros((eq.states, seen.measured.shape[1]))
        wrong = np.zeros(0)
        for own in (seen, replace(seen, before=None)):  # if no observer follows: from first samples
            memory, _ = memory_at(ready, own, device, observer.gain)
            wrong = alone(
                eq, fine, own.places(eq), own.command, own.measured, blind,
                own.external(eq.dof), memory, own.strengths,
            )  # fmt: skip
            if np.all(np.isfinite(wrong[0])):
                break
        # A different reading of the model (an origin) is in both and cancels.
        return e.measured - wrong


def recorded(e: Experiment, taken: Floats) -> Floats:
    """Return outputs (ticks, o), converted back to the form of the recording."""
    found = taken.copy()
    for o, output in enumerate(e.outputs):
        if (a := e.differenced.get(output)) is not None:
            moved = np.diff(taken[:, o], prepend=taken[0, o]) / e.period
            found[:, o] = lfilter([1.0 - a], [1.0, -a], moved)
    if e.pushed is not None:
        found[:, 0] = e.pushed.force(taken[:, 0])
    if e.folded:
        found[:, 0] = np.abs(found[:, 0])
    return found

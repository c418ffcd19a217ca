"""Fit of one recording with the fleet's structure: its own parameters, and how well they fit.

The fit descends from the typical device (`settled`: fit and noise in turn), in some tenths of a
second for 600 samples. The influence of the prior is removed from the estimates: if x has the
posterior variance v under a unit prior about 0, the recording alone gives

    1 / s^2 = 1 / v - 1,    y = x s^2 / v,

so a recording without information about a parameter has an infinite standard error for it, and does
not pull the fleet towards the typical device. Errors hold for a coloured residual
(`fitting.uncertainty`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.answer.findings import UNITS
from zwidth.diagnosis.answer.whole_run import simulated
from zwidth.diagnosis.fitting.uncertainty import covariance
from zwidth.diagnosis.intake.gate import oddities
from zwidth.diagnosis.model.own_values import first_x
from zwidth.diagnosis.model.parameters import Model, Parameter, nominal_of
from zwidth.diagnosis.noise.predictor import free_run_errors, window
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.hypothesis import Hypothesis, judged, settled
from zwidth.fleet.reading import experiment_of
from zwidth.fleet.structure import Structure
from zwidth.shown import Valued
from zwidth.sim.device import Device

Floats = NDArray[np.float64]
NUISANCE = (
    "origin",
    "zero",
    "jitter",
    "skew",
    "gain",
    "change",
)  # parameters of a run, not of a device
QUIET = 0.05  # of a command's range: within it the command counts as constant
STARTS, JUMPS = 6, 2.0  # samples after a standstill; a jump exceeds their steps by this factor
DRAWN = 160  # points of a recording that are stored for drawing
UNTOLD = 0.98  # of the prior's variance, above which a recording does not determine a parameter


@dataclass(frozen=True)
class Quick(Valued):
    """The result of the quick fit of a recording, in SI.

    x (p,): of the model; values, errors (q,): of the reported parameters, with infinite errors for
    undetermined ones; covariance (q, q). noise: deviation of the innovations of the first output;
    free: rms error of free runs of half a second over the motion; swing: rms motion; held: longest
    time that a reading is constant while the command is not, over the recording's length. drawn (2,
    points): the first output as measured and in a free run. remarks: facts about the recording.
    problem: why there is no fit; "" if there is one.
    """

    name: str
    x: Floats = field(default_factory=lambda: np.zeros(0))
    values: Floats = field(default_factory=lambda: np.zeros(0))
    errors: Floats = field(default_factory=lambda: np.zeros(0))
    covariance: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    misfit: float = 0.0
    samples: int = 0
    seconds: float = 0.0
    noise: float = 0.0
    free: float = 0.0
    swing: float = 0.0
    held: float = 0.0
    drawn: Floats = field(default_factory=lambda: np.zeros((2, 0)))
    remarks: tuple[str, ...] = ()
    problem: str = ""


@dataclass(frozen=True)
class Task:
    """Recordings (name, path) to be fitted one after another with a structure."""

    recordings: tuple[tuple[str, Path], ...]
    structure: Structure


def reported(model: Model) -> list[int]:
    """Return the indices of the parameters that describe the device."""
    return [i for i, p in enumerate(model.parameters) if p.kind not in NUISANCE]


def names_of(structure: Structure) -> dict[str, str]:
    """Return name and unit of each reported parameter."""
    model, rotary = structure.model, structure.device.rotary
    found: dict[str, str] = {}
    for i in reported(model):
        p = model.parameters[i]
        if p.kind == "effect":
            unit = model.effects[p.index].effect.parameter(p.key).unit_for(rotary)
        else:
            unit = UNITS[p.kind][0 if rotary else 1]
        found[p.name] = unit
    return found


def physical(model: Model, x: Floats) -> tuple[Floats, Floats]:
    """Return value and derivative by x of each reported parameter."""
    values: list[float] = []
    slopes: list[float] = []
    for i in reported(model):
        p, own = model.parameters[i], float(x[i])
        value, slope = _physical(model, p, own)
        values.append(value)
        slopes.append(slope)
    return np.array(values), np.array(slopes)


def _physical(model: Model, p: Parameter, x: float) -> tuple[float, float]:
    nominal = nominal_of(model, p)
    return p.value(nominal, x), p.slope(nominal, x)


def run(task: Task) -> list[Quick]:
    """Return the quick fit of each recording of a task."""
    return [_of(name, path, task.structure) for name, path in task.recordings]


def _of(name: str, path: Path, structure: Structure) -> Quick:
    try:
        e = experiment_of(path, structure.device, name)
    except (ValueError, OSError) as error:
        return Quick(name, problem=str(error))
    return quick(e, structure)


def quick(e: Experiment, structure: Structure) -> Quick:
    """Return the quick fit of a recording."""
    try:
        h = fit(e, structure)
    except NoObserver:
        return Quick(e.name, problem=f"no observer with the fleet's structure predicts {e.name}")
    return summed_up(e, h, tuple(f.sentence for f in oddities(structure.typical, e)))


def fit(e: Experiment, structure: Structure) -> Hypothesis:
    """Return the fit of a recording with the fleet's structure; raises NoObserver."""
    model = structure.model
    return settled(judged([e], model, model.within(first_x(model, [e]))))


def summed_up(e: Experiment, h: Hypothesis, remarks: Sequence[str] = ()) -> Quick:
    """Return the results of a fit as a `Quick`."""
    model, x = h.model, h.x
    values, errors, spread = estimates(h)
    observer, (begun,) = h.noise.observer, h.problem.experiments
    device: Device = model.acting(x)
    with np.errstate(all="ignore"):
        errors_of, signal = free_run_errors(device, model.seen(begun, x), observer.gain, window(e))
        size = float(np.sqrt(np.mean(signal[:, 0] ** 2))) if signal.size else 0.0
        off = float(np.sqrt(np.mean(errors_of[:, 0] ** 2))) if signal.size else 0.0
        run_freely = simulated(model, x, e, observer)[:, 0]
    every = max(1, e.ticks // DRAWN)
    drawn = np.stack([e.measured[::every, 0], np.nan_to_num(run_freely[::every])])
    return Quick(
        e.name, x, values, errors, spread, h.cost.misfit, h.samples, e.ticks * e.period,
        float(observer.deviation[0]), off / size if size > 0.0 else 0.0, e.swing, held(e), drawn,
        tuple(remarks),
    )  # fmt: skip


def estimates(h: Hypothesis) -> tuple[Floats, Floats, Floats]:
    """Return values, standard errors and covariance of reported parameters, without the prior."""
    model, own = h.model, np.array(reported(h.model))
    spread = covariance(h.fitted)[np.ix_(own, own)]
    variance = np.diag(spread)
    prior = np.array([model.parameters[i].prior for i in own])
    x = h.x.copy()
    alone = np.where(np.isfinite(variance), variance, np.inf)
    for k, i in enumerate(own):
        if not prior[k] or not np.isfinite(variance[k]):
            continue
        if variance[k] >= UNTOLD:
            alone[k] = np.inf
        else:
            alone[k] = variance[k] / (1.0 - variance[k])
            x[i] = h.x[i] * alone[k] / variance[k]
    x = model.within(x)
    values, slopes = physical(model, x)
    errors = np.abs(slopes) * np.sqrt(alone)
    with np.errstate(all="ignore"):
        alike = spread / np.sqrt(np.outer(variance, variance))
    alike = np.where(np.isfinite(alike), alike, np.eye(own.size))
    finite = np.where(np.isfinite(errors), errors, 0.0)
    return values, errors, alike * np.outer(finite, finite)


def held(e: Experiment) -> float:
    """Return the longest standstill of the first output, as a share of the recording.

    A standstill does not count if the command is constant too, as for a servo that holds its goal,
    or if the motion starts again from where it stopped, as after sticking. A sensor without new
    readings resumes with a jump to the device's present position.
    """
    moves = np.flatnonzero(np.diff(e.measured[:, 0], prepend=np.nan, append=np.nan) != 0.0)
    asks = QUIET * float(np.ptp(e.command))
    for k in np.argsort(-np.diff(moves)).tolist():
        stretch = slice(int(moves[k]), int(moves[k + 1]))
        if float(np.ptp(e.command[stretch])) > asks and not _sets_out(e.measured[:, 0], stretch):
            return (stretch.stop - stretch.start - 1) / e.ticks
    return 0.0


def _sets_out(reading: Floats, stretch: slice) -> bool:
    """Whether the first step after a standstill is no larger than the next steps, or than usual."""
    steps = np.abs(np.diff(reading[stretch.stop - 1 : stretch.stop + STARTS]))
    usual = float(np.sqrt(np.mean(np.diff(reading) ** 2)))
    return steps.size > 1 and float(steps[0]) <= JUMPS * max(usual, float(steps[1:].max()))


def to_arrays(q: Quick) -> Mapping[str, object]:
    """Return a Quick as JSON types."""
    return {
        k: v.tolist() if isinstance(v, np.ndarray) else list(v) if isinstance(v, tuple) else v
        for k, v in vars(q).items()
    }


def from_arrays(values: Mapping[str, Any]) -> Quick:
    """Rebuild a Quick from the output of `to_arrays`.

    Raises TypeError, ValueError or KeyError if it is not such output.
    """
    arrays = ("x", "values", "errors", "covariance", "drawn")
    own: dict[str, Any] = {
        k: np.array(v, dtype=np.float64) if k in arrays else v for k, v in values.items()
    }
    errors = own["errors"]
    own["errors"] = np.where(errors < 0.0, np.inf, errors)  # `fleet.kept` writes infinity this way
    own["remarks"] = tuple(own["remarks"])
    return Quick(**own)

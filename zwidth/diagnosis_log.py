"""A diagnosis as a trace over the recording's own time: predictions, residuals, force, marks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.answer.friction_curve import missing_force
from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.predictor import (
    free_run_errors,
    free_run_starts,
    innovations,
    settling,
    window,
)
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.logs.annotations import LEVELS, Annotation
from zwidth.sim.place import place_at
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Explained:
    """A fitted model on one recording: innovations and free-run errors (ticks, o).

    Samples without a prediction (while the observer settles, or before a free run) are NaN.
    """

    innovation: Floats
    free_error: Floats


def diagnosis_trace(
    problem: Problem,
    refit: Fitted,
    final: Fitted,
    experiment: Experiment,
    *,
    place: str = "m1",
    start_s: float = 0.0,
    rotary: bool = True,
    before: tuple[Model, Floats] | None = None,
    marks: Sequence[Annotation] = (),
    facts: Mapping[str, object] = MappingProxyType({}),
) -> Trace:
    """Return the trace of one recording, whole; `logs.write_log` writes it as an MCAP.

    refit: without the found effects, final: with them; before: model and x of the device file.
    place: of the missing force, a mass ("m2") or a link ("link12"); a force in command or sensor
    counts as one at m1. start_s: time of the first sample. marks: annotations of stretches of time.
    Channels: `command`, `missing_force_PLACE`; for every output `NAME` as recorded and, with each
    of `before_`, `refit_` and `found_`, `found_NAME` predicted one step ahead, `found_free_NAME` in
    free runs and `found_residual_NAME`; for every mark its severity while it lasts (2 info, 3
    warning, 4 error) and zero elsewhere.
    """
    force, length = ("N m", "rad") if rotary else ("N", "m")
    entry = place if place_at(place).kind in ("mass", "link") else "m1"
    channels: dict[str, Floats] = {"command": experiment.command}
    channels[f"missing_force_{entry}"] = missing_force(problem, refit, experiment, entry)
    units = dict.fromkeys(channels, force)
    models = {"refit": (refit.model, refit.x), "found": (final.model, final.x)}
    if before is not None:
        models = {"before": before} | models
    each = {word: _explained(problem, *model, experiment) for word, model in models.items()}
    for o, output in enumerate(experiment.outputs):
        unit = length if output.quantity == "position" else f"{length}/s"
        name, measured = output.name, experiment.measured[:, o]
        channels[name] = measured
        for word, explained in each.items():
            channels[f"{word}_{name}"] = measured - explained.innovation[:, o]
            channels[f"{word}_free_{name}"] = measured - explained.free_error[:, o]
            channels[f"{word}_residual_{name}"] = explained.innovation[:, o]
        units |= {key: unit for key in channels if key not in units}
    t = start_s + experiment.period * np.arange(experiment.ticks, dtype=np.float64)
    for mark in marks:
        lasts = (t >= mark.start) & (t <= mark.end)
        channels[mark.name] = np.where(lasts, float(LEVELS[mark.severity]), 0.0)
        units[mark.name] = ""
    return Trace(t, channels, units, "recorded", MappingProxyType(dict(facts)))


def _explained(problem: Problem, model: Model, x: Floats, experiment: Experiment) -> Explained:
    gain, device = problem.observer.gain, model.acting(x)
    seen = model.seen(experiment, x)
    with np.errstate(all="ignore"):
        ahead = innovations(device, seen, gain)
        runs, _ = free_run_errors(device, seen, gain, window(seen))
    ahead[: settling(seen)] = np.nan
    if seen.uncounted is not None:
        ahead[seen.uncounted] = np.nan
    free = np.full(ahead.shape, np.nan)
    length = window(seen)
    for place, first in enumerate(free_run_starts(seen, length)):
        free[first : first + length] = runs[place * length : (place + 1) * length]
    return Explained(ahead, free)

"""At how many sigma each effect is visible in recordings: the cost of a model without it.

Under the observer that belongs to the known noise, e(device) are the innovations of a device and J
their slopes by its linear parameters, at the truth. Without one effect

    sigma = |(I - P) (e(truth without it) - e(truth))|,    P the projector on the span of J,

as in `planning/limits.py`. An effect of full size is no small change, so the refit without it is
completed by a few Gauss-Newton steps if the first one suggests that it hardly shows.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.descend import fit, fitted_at
from zwidth.diagnosis.fitting.fit import Problem
from zwidth.diagnosis.model.parameters import Model, linear_parameters
from zwidth.diagnosis.noise.predictor import (
    SCREENING,
    SETTLING,
    Observer,
    innovations,
    told,
    whitened,
)
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.seeking.screen import Complement
from zwidth.planning.rehearsal import Noise, known_observer
from zwidth.sim.device import Device
from zwidth.sim.physics.effect import Physics

Floats = NDArray[np.float64]
LONGEST = 10000  # samples of a recording that are looked at
CLEAR = 40.0  # times what is asked: then the first step of the refit is enough
ROUNDS = 3
FITS = 2  # of a device file: its own size of errors weighs the outputs of the second


@dataclass(frozen=True)
class Sight:
    """Recordings as the truth, or all of it that the library has, predicts them.

    base: its innovations; off: the projection off what a refit of the device file's parameters
    absorbs.
    """

    model: Model
    problem: Problem
    base: Floats
    off: Complement

    def sigma(self, moved: Floats) -> float:
        """Return the size of a change of the innovations that a refit does not absorb."""
        return float(np.linalg.norm(self.off(_with_priors(self.model, moved))))


def sight(
    bare: Device, effects: Sequence[Physics], experiments: Sequence[Experiment], noise: Noise
) -> Sight:
    """Return recordings as the bare device with effects predicts them; raises NoObserver."""
    parts = [e.part(0, min(e.ticks, LONGEST)) for e in experiments]
    whole = _model(bare, effects)
    x = np.zeros(whole.linear_count)
    observer = known_observer(bare, parts[0], noise)
    device = whole.acting(x)
    errors = [innovations(device, whole.seen(e, x), observer.gain) for e in parts]
    problem = Problem(parts, _weighed(observer, errors, parts), SCREENING)
    base = problem.weighted(whole, x)
    slopes = fitted_at(problem, whole, x).jacobian
    # A spring that is concealed is none that a refit of the device file could change.
    known = {p.name for p in linear_parameters(bare)}
    off = Complement(slopes[:, [p.name in known for p in whole.parameters]])
    return Sight(whole, problem, base, off)


def standing(
    bare: Device, effects: Sequence[Physics], experiments: Sequence[Experiment], noise: Noise,
    asked: float,
) -> list[float]:  # fmt: skip
    """Return the sigma of each effect, with a full refit if it is not clearly above `asked`.

    bare: the true device without them. Raises NoObserver if there is no observer of a model.
    """
    if not effects:
        return []
    seen = sight(bare, effects, experiments, noise)
    return [
        _without(seen, seen.problem, _model(bare, [p for p in effects if p is not gone]), asked)
        for gone in effects
    ]


def standing_law(
    bare: Device, effects: Sequence[Physics], without: Sequence[Experiment],
    recorded: Sequence[Experiment], noise: Noise, asked: float,
) -> float:  # fmt: skip
    """Return the sigma of a law outside the library.

    recorded, without: recordings with it and without, of the same noise.
    """
    seen = sight(bare, effects, without, noise)
    parts = [e.part(0, min(e.ticks, LONGEST)) for e in recorded]
    there = Problem(parts, seen.problem.observer, SCREENING)
    return _without(seen, there, seen.model, asked)


def _without(seen: Sight, problem: Problem, model: Model, asked: float) -> float:
    """Return the sigma of the error of an incomplete model, refitted if necessary."""
    start = np.zeros(model.linear_count)
    sigma = seen.sigma(problem.weighted(model, start) - seen.base)
    if asked < sigma < CLEAR * asked:
        fitted = fit(problem, model, start, ROUNDS)
        sigma = min(sigma, seen.sigma(fitted.residual[: seen.base.size] - seen.base))
    return sigma


def _model(bare: Device, effects: Sequence[Physics]) -> Model:
    """The device with effects; lost commands are taken off the recording."""
    lost = [p for p in effects if p.effect.in_recording]
    model = Model(bare.with_physics(*(p for p in effects if p not in lost)))
    for p in lost:
        model = model.with_effect(p, {})
    return model


def _weighed(observer: Observer, errors: Sequence[Floats], parts: Sequence[Experiment]) -> Observer:
    kept = np.concatenate([e[SETTLING:] for e in errors])
    spread = np.sqrt(np.mean(kept**2, axis=0) / told(parts))
    return whitened(replace(observer, deviation=spread), errors, parts)


def _with_priors(model: Model, values: Floats) -> Floats:
    priors = sum(p.prior for p in model.parameters)
    return np.concatenate([values, np.zeros(priors)])


def refitted(device: Device, experiments: Sequence[Experiment], noise: Noise) -> Device:
    """Return the device with its linear parameters fitted, ignoring concealed physics."""
    parts = [e.part(0, min(e.ticks, LONGEST)) for e in experiments]
    model = Model(device)
    x = np.zeros(model.linear_count)
    for _ in range(FITS):
        built = model.acting(x)
        observer = known_observer(built, parts[0], noise)
        errors = [innovations(built, model.seen(e, x), observer.gain) for e in parts]
        kept = np.concatenate([e[SETTLING:] for e in errors])
        observer = replace(observer, deviation=np.sqrt(np.mean(kept**2, axis=0)))
        x = fit(Problem(parts, observer, SCREENING), model, x).x
    return model.build(x)

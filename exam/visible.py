"""At how many sigma each effect of a truth stands in recordings: what going without it costs.

Under the observer that belongs to the known noise, e(device) are the innovations of a device and J
their slopes by its linear parameters, at the truth. Without one effect

    sigma = |(I - P) (e(truth without it) - e(truth))|,    P the projector on the span of J,

as in `diagnosis/limits.py`; an effect of full size is no small change, so the refit without it
is taken to its own end by a few Gauss-Newton steps, where the first looks as if it hardly showed.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.experiment import Experiment
from zwidth.diagnosis.fit import Problem
from zwidth.diagnosis.parameters import IN_RECORDING, Model, linear_parameters
from zwidth.diagnosis.predictor import SCREENING, SETTLING, Observer, innovations, whitened
from zwidth.diagnosis.rehearsal import Noise, known_observer
from zwidth.diagnosis.screen import Complement
from zwidth.sim.device import Device
from zwidth.sim.physics.effect import Physics

Floats = NDArray[np.float64]
LONGEST = 10000  # samples of a recording that are looked at
CLEAR = 4.0  # times what is asked: then the first step of the refit is enough
ROUNDS = 3


def standing(
    bare: Device, effects: Sequence[Physics], experiments: Sequence[Experiment], noise: Noise,
    asked: float,
) -> list[float]:  # fmt: skip
    """Return the sigma of each effect, refitted to the end where it is not clearly above `asked`.

    bare: the true device without them. Raises NoObserver where none follows.
    """
    parts = [e.part(0, min(e.ticks, LONGEST)) for e in experiments]
    whole = _model(bare, effects)
    x = np.zeros(whole.linear_count)
    observer = known_observer(bare, parts[0], noise)
    device = whole.acting(x)
    errors = [innovations(device, whole.seen(e, x), observer.gain) for e in parts]
    problem = Problem(parts, _weighed(observer, errors), SCREENING)
    base = problem.weighted(whole, x)
    slopes = problem.jacobian(whole, x, _with_priors(whole, base))
    # A spring that is concealed is none that a refit of the device file could change.
    known = {p.name for p in linear_parameters(bare)}
    off = Complement(slopes[:, [p.name in known for p in whole.parameters]])
    found: list[float] = []
    for gone in effects:
        model = _model(bare, [p for p in effects if p is not gone])
        start = np.zeros(model.linear_count)
        moved = problem.weighted(model, start) - base
        sigma = float(np.linalg.norm(off(_with_priors(whole, moved))))
        if asked < sigma < CLEAR * asked:
            fitted = problem.fit(model, start, rounds=ROUNDS, final=False)
            moved = fitted.residual[: base.size] - base
            sigma = min(sigma, float(np.linalg.norm(off(_with_priors(whole, moved)))))
        found.append(sigma)
    return found


def _model(bare: Device, effects: Sequence[Physics]) -> Model:
    """The device with effects; lost commands are taken off the recording."""
    lost = [p for p in effects if p.effect.name in IN_RECORDING]
    model = Model(bare.with_physics(*(p for p in effects if p not in lost)))
    for p in lost:
        model = model.with_effect(p, {})
    return model


def _weighed(observer: Observer, errors: Sequence[Floats]) -> Observer:
    kept = np.concatenate([e[SETTLING:] for e in errors])
    return whitened(replace(observer, deviation=np.sqrt(np.mean(kept**2, axis=0))), errors)


def _with_priors(model: Model, values: Floats) -> Floats:
    priors = sum(p.prior for p in model.parameters)
    return np.concatenate([values, np.zeros(priors)])

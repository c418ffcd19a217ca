"""Observer and fit in turn, until both agree: the observer never changes inside a fit."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.beginning import begun, with_play
from zwidth.diagnosis.noise.predictor import (
    SETTLING,
    Observer,
    choose_observer,
    deviation,
    innovations,
    observer_for,
    told,
    whitened,
)
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.sim.device import Device
from zwidth.sim.physics.effect import Physics

Floats = NDArray[np.float64]
REFITS = 6
SETTLED = 1.02  # chi2 per sample at which the observer and the refit agree
TURNS = 4
AGREED = 10.0  # -2 log likelihood gained by a turn, below which they do


def refit(
    device: Device, experiments: Sequence[Experiment], effects: tuple[Physics, ...] = ()
) -> tuple[Problem, Fitted]:
    """Fit the linear parameters, choosing the observer anew between fits until both agree."""
    model = Model(device, effects, tuple({} for _ in effects))
    problem, fitted = settle(experiments, model, np.zeros(model.linear_count))
    for _ in range(TURNS):
        again = settle(problem.experiments, model, fitted.x)
        if again[0].cost(again[1]) > problem.cost(fitted) - AGREED:
            break
        problem, fitted = again
    return problem, fitted


def settle(experiments: Sequence[Experiment], model: Model, x: Floats) -> tuple[Problem, Fitted]:
    """Fit a model from x, choosing the observer anew between fits until both agree.

    Raises NoObserver where no observer follows the recordings with it.
    """
    near = None
    for _ in range(REFITS):
        problem = prepared_for(experiments, model, x, near=near)
        fitted = problem.fit(model, x, final=False)
        experiments, x, near = problem.experiments, fitted.x, problem.observer.ratio
        if abs(fitted.chi2 / fitted.samples - 1.0) < SETTLED - 1.0:
            break
    problem = prepared_for(experiments, model, x)  # the likeliest observer of all
    return problem, problem.fit(model, x)


def prepared_for(
    experiments: Sequence[Experiment],
    model: Model,
    x: Floats,
    ratio: float | None = None,
    near: float | None = None,
    white: bool = False,
) -> Problem:
    """Return the problem of a model at x: observer, beginnings, deviations.

    ratio: None for the likeliest observer, whose innovations are whitened. Those of an observer
    that was asked for are only where `white`: whitened, every observer sees much the same. Raises
    NoObserver where there is no observer of that ratio, or the model runs away under it. near: as
    `choose_observer` takes it.
    """
    device = model.acting(x)
    seen = [model.seen(e, x) for e in experiments]
    if ratio is None:
        chosen = choose_observer(device, seen, near)
    else:
        gain = observer_for(device, seen[0], ratio)
        chosen = Observer(gain, deviation(device, seen, gain), ratio, told=told(seen))
    # With play they are dear to seek, and where the observer of nearly the same model began does.
    kept = with_play(device.physics)
    starts = [
        e.start if kept and e.start is not None else begun(device, e, chosen).start for e in seen
    ]
    known = [replace(e, start=s) for e, s in zip(experiments, starts, strict=True)]
    errors = [innovations(device, model.seen(e, x), chosen.gain) for e in known]
    if not all(np.all(np.isfinite(e)) for e in errors):
        raise NoObserver(f"no observer follows the recording with {model.label}")
    if ratio is None or white:
        return Problem(known, whitened(chosen, errors, known))
    joined = np.concatenate([e[SETTLING:] for e in errors])
    spread = np.sqrt(np.mean(joined**2, axis=0) / told(known))
    return Problem(known, replace(chosen, deviation=spread))


def cost_at(ratio: float, fitted: Fitted, experiments: Sequence[Experiment]) -> float:
    """Return what a model costs under the observer of a ratio; infinite where there is none.

    Whitened, another observer is another model of the noise, which alone made a recording likelier
    by 120 in -2 log likelihood. So what another model is worth is held against the model in hand
    under its own observer and under the other's.
    """
    try:
        there = prepared_for(experiments, fitted.model, fitted.x, ratio, white=True)
        return there.cost(there.fit(fitted.model, fitted.x))
    except NoObserver:
        return np.inf

"""Alternates between noise model and fit until both agree; the noise is fixed during a fit."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.descend import descended, fit
from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import NEXT_SAMPLE, Family, Motions, likeliest
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.sim.device import Device

Floats = NDArray[np.float64]
TURNS, ROUNDS = 6, 12
STILL = 0.5  # change of -2 log likelihood, below which the turns agree


def prepared_for(
    experiments: Sequence[Experiment], model: Model, x: Floats, family: Family = NEXT_SAMPLE
) -> Problem:
    """Return the recordings with the most likely noise of a model at x; may raise NoObserver.

    With play, motions that are known of nearly the same model are followed on from.
    """
    known = tuple(e.motions for e in experiments if e.motions is not None)
    motions: Motions = known if len(known) == len(experiments) else None
    return likeliest(experiments, model, x, family, motions).problem(experiments)


def fitted_in_turn(
    experiments: Sequence[Experiment],
    model: Model,
    x: Floats,
    family: Family = NEXT_SAMPLE,
    turns: int = TURNS,
    rounds: int = ROUNDS,
) -> tuple[float, Floats, float]:
    """Fit a model from x and choose its noise again, in turn: cost, x, and the observer's ratio.

    family: of the noise in the first round; later rounds continue from there.
    """
    best = (np.inf, x, 1.0)
    for _ in range(turns):
        problem = prepared_for(experiments, model, x, family)
        ended = descended(problem, model, x, rounds)
        x, ratio = ended.x, problem.observer.ratio
        before, family = best[0], NEXT_SAMPLE.near(ratio)
        if ended.cost < before:
            best = ended.cost, x, ratio
        if ended.cost > before - STILL:
            break
    return best


def settle(
    experiments: Sequence[Experiment], model: Model, x: Floats, family: Family = NEXT_SAMPLE
) -> tuple[Problem, Fitted]:
    """Fit a model from x, choosing its noise again in turn; may raise NoObserver."""
    _, x, ratio = fitted_in_turn(experiments, model, x, family)
    problem = prepared_for(experiments, model, x, NEXT_SAMPLE.near(ratio))
    return problem, fit(problem, model, x)


def refit(device: Device, experiments: Sequence[Experiment]) -> tuple[Problem, Fitted]:
    """Fit the linear parameters, choosing the noise again between fits until both agree."""
    model = Model(device)
    return settle(experiments, model, np.zeros(model.linear_count))


def cost_at(ratio: float, model: Model, x: Floats, experiments: Sequence[Experiment]) -> float:
    """Return the cost of a model with the observer of a ratio, infinite if none is possible.

    After whitening, another observer is another noise model, which alone changed -2 log likelihood
    by 120. So two models are compared with the observers of both.
    """
    try:
        there = prepared_for(experiments, model, x, NEXT_SAMPLE.of(ratio))
        return descended(there, model, x, ROUNDS).cost
    except NoObserver:
        return np.inf

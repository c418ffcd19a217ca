"""Fit what was found once more with a slower observer, where that predicts further ahead.

The likeliest observer explains the next sample. Where what is missing is no white force but a slow
error of the model, it follows the measurement so closely that slow physics (a stiffness, a bias)
hardly matters to it, and its parameters come out biased. Free runs on the data fitted to decide.
"""

from collections.abc import Sequence

import numpy as np

from zwidth.diagnosis.experiment import Experiment
from zwidth.diagnosis.fit import Fitted, Problem
from zwidth.diagnosis.predictor import free_run_errors
from zwidth.diagnosis.settle import prepared_for
from zwidth.diagnosis.steady import NoObserver

SLOWER = (1e3, 1e1, 1e-1, 1e-3)
BETTER = 0.8  # of the free run's error
FREE_RUN_S = 0.5
SHORTEST_WINDOW = 50  # ticks


def window(experiment: Experiment) -> int:
    """Return the ticks of a free run."""
    return max(SHORTEST_WINDOW, round(FREE_RUN_S / experiment.period))


def longer_view(
    experiments: Sequence[Experiment], problem: Problem, fitted: Fitted
) -> tuple[Problem, Fitted]:
    """Return the fit whose free runs err least; the given one unless another is clearly better."""
    best, error = (problem, fitted), BETTER * free_run_error(experiments, problem, fitted)
    for ratio in SLOWER:
        if ratio >= problem.observer.ratio:
            continue
        try:
            tried = at_ratio(experiments, best[1], ratio)
        except NoObserver:  # so slow that it does not hold a device without springs
            continue
        found = free_run_error(experiments, *tried)
        if found < error:
            best, error = tried, found
    return best


def free_run_error(experiments: Sequence[Experiment], problem: Problem, fitted: Fitted) -> float:
    """Return the rms error of free runs, first output; infinite without any."""
    device = fitted.model.acting(fitted.x)
    seen = [fitted.model.seen(e, fitted.x) for e in experiments]
    runs = [free_run_errors(device, e, problem.observer.gain, window(e))[0][:, 0] for e in seen]
    joined = np.concatenate(runs)
    size = float(np.sqrt(np.mean(joined**2))) if joined.size else np.inf
    return size if np.isfinite(size) else np.inf


def at_ratio(
    experiments: Sequence[Experiment], fitted: Fitted, ratio: float
) -> tuple[Problem, Fitted]:
    """Return the fit of a model under an observer of a ratio, with its deviations."""
    problem = prepared_for(experiments, fitted.model, fitted.x, ratio)
    fitted = problem.fit(fitted.model, fitted.x)
    problem = prepared_for(problem.experiments, fitted.model, fitted.x, ratio)
    return problem, problem.fit(fitted.model, fitted.x)

"""Take effects out again: the fit without one, and whether one may stay."""

import numpy as np
from scipy.stats import chi2

from zwidth.diagnosis.fit import Fitted, Problem
from zwidth.diagnosis.trials import THRESHOLD
from zwidth.diagnosis.uncertainty import covariance, inflation
from zwidth.sim.device import place_label

UNSURE = 5.7e-7  # odds that nothing looks as large as what is kept, five sigma of one magnitude
CERTAIN = 400.0  # what Wald's test must say of an effect that is kept without another fit
NOTHING = 0.1  # the same of an effect of no size, which only changes how the kernel steps
BEYOND = 1e3  # chi-square lost without an effect, that no coarse tick or short fit explains
FREE = 1e12  # variance, in x, of what the recording does not determine at all


def fit_without(problem: Problem, fitted: Fitted, index: int) -> Fitted:
    """Fit a model again without one of its effects; asked twice of the same, answer from memory."""
    gone = place_label(fitted.model.effects[index])
    key = (gone, fitted.model.label, fitted.x.tobytes())
    if key not in problem.without:
        problem.without[key] = problem.fit(*fitted.model.less(fitted.x, index))
    return problem.without[key]


def prune(problem: Problem, fitted: Fitted) -> Fitted:
    """Remove every effect whose absence costs less than the threshold, or that may be zero."""
    index = 0
    while index < len(fitted.model.effects):
        sure = wald(fitted, index)
        if sure is not None and sure[0] > CERTAIN:
            index += 1
            continue
        without = fit_without(problem, fitted, index)
        gained = (without.chi2 - fitted.chi2) / inflation(fitted.white)
        nothing = (sure is not None and sure[0] < NOTHING) or _only_steps(problem, fitted, index)
        if gained < THRESHOLD or nothing or (gained < BEYOND and may_be_zero(fitted, index)):
            fitted, index = without, 0
        else:
            index += 1
    return fitted


def _only_steps(problem: Problem, fitted: Fitted, index: int) -> bool:
    """Whether an effect of no size explains as much, which only changes how the kernel steps.

    Play beside friction gained 364 sigma so in a log without noise, a gap of 3e-7 +- 8e-7 rad.
    """
    x, physics = fitted.x.copy(), fitted.model.effects[index]
    vanishes = False
    for j, p in enumerate(fitted.model.parameters):
        if p.kind == "effect" and p.index == index:
            nothing = physics.effect.parameter(p.key).vanishing
            if nothing is not None:
                x[j] = (nothing - physics.values[p.key]) / p.scale
                vanishes = True
    if not vanishes:
        return False
    none = problem.residual(fitted.model, x)
    return float(none @ none) - fitted.chi2 < THRESHOLD * inflation(fitted.white)


def may_be_zero(fitted: Fitted, index: int) -> bool:
    """Whether the magnitudes of an effect are nothing within their errors, all together.

    Chi-square alone deceives where the fit before it had stopped short of its minimum, as it does
    on the creases that friction makes.
    """
    found = wald(fitted, index)
    return found is not None and found[0] < float(chi2.isf(UNSURE, found[1]))


def wald(fitted: Fitted, index: int) -> tuple[float, int] | None:
    """Return Wald's m' C^-1 m of an effect's magnitudes m, C their covariance, and how many.

    Together: one of them may well be undetermined (a constant force beside the origin of a spring)
    where another is sure. None for an effect without magnitudes, and for one with a phase or angle,
    which at a magnitude of zero means nothing: its chi-square is no normal deviate's there.
    """
    physics = fitted.model.effects[index]
    if physics.effect.turning:
        return None
    names = physics.effect.magnitudes
    parameters = fitted.model.parameters
    own = [
        j for j, p in enumerate(parameters)
        if p.kind == "effect" and p.index == index and p.key in names
    ]  # fmt: skip
    if not own:
        return None
    scales = np.array([parameters[j].scale for j in own])
    keys = [parameters[j].key for j in own]
    none = np.array([physics.effect.parameter(key).none_of_it() for key in keys])
    size = (np.array([physics.values[key] for key in keys]) - none) / scales + fitted.x[own]
    spread = np.nan_to_num(covariance(fitted)[np.ix_(own, own)], posinf=FREE)
    variance, axes = np.linalg.eigh(spread)
    found = np.sum((axes.T @ size) ** 2 / np.maximum(variance, np.finfo(float).tiny))
    return float(found), len(own)

"""Name the physics: forward steps with second opinions, swaps and removal.

After a step has taken an effect (`diagnosis.trials`), observer and fit are settled; an observer
that takes all motion for physics and none for disturbance is asked as well, and the likelier answer
is kept; effects that no longer pay are removed; and each of several is exchanged for what may
explain more in its place, up to three effects.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from diagnosis.candidates import MAGNITUDE
from diagnosis.experiment import Experiment
from diagnosis.fit import Fitted, Problem
from diagnosis.horizon import longer_view
from diagnosis.parameters import Model, effect_labels
from diagnosis.predictor import FINAL
from diagnosis.settle import refit
from diagnosis.trials import FIVE_SIGMA, THRESHOLD, Say, Step, Trial, richer_trials, take
from diagnosis.uncertainty import covariance, inflation, over_creases
from diagnosis.views import Answer, ask, runs_freer, settled_on
from sim.device import Device, place_label

Floats = NDArray[np.float64]
MOST = 3  # effects
UNSURE = 6.3e-5  # odds that nothing looks as large as what is kept, four sigma of one magnitude
CERTAIN = 1e3  # what Wald's test must say of an effect that is kept without another fit
FREE = 1e12  # variance, in x, of what the recording does not determine at all
SWAP_GAIN = 4.0  # chi-square by which an effect as simple must be better to replace one


@dataclass(frozen=True)
class Searched:
    """The refit without physics, the final fit with what was found, and the way there."""

    problem: Problem
    refit: Fitted
    final: Fitted
    steps: tuple[Step, ...]
    interrupted: bool = False


def search(
    device: Device, experiments: Sequence[Experiment], say: Say = lambda _: None
) -> Searched:
    """Search for missing physics in the experiments (the part to fit on)."""
    problem, linear = refit(device, experiments)
    experiments = problem.experiments
    size = np.sqrt(linear.chi2 / linear.samples)
    say(f"linear refit: innovations {size:.3f} of their noise model")
    current, steps, interrupted = linear, list[Step](), False
    trusted = False  # an observer that trusts the model was followed for its free runs
    try:
        for _ in range(2 * MOST):
            if len(current.model.effects) == MOST:
                break
            asked = ask(problem, current, experiments, say)
            problem, current = asked.problem, asked.current
            experiments = problem.experiments
            if not current.model.effects:
                linear = current
            kept = surviving(asked.believed)
            if kept is None:
                steps.append(replace(asked.step, taken=None))
                break
            answer, best = kept
            freer = runs_freer(asked, answer, best)
            if freer is not None:
                say(f"an observer that trusts the model more takes {freer.trial.label}")
                answer, best, trusted = freer, prune(freer.problem, freer.settled), True
            say(f"taken: {answer.trial.label}")
            steps.append(replace(answer.step, taken=answer.trial))
            problem, current = answer.problem, best
            experiments = problem.experiments
            if answer.trial.label not in effect_labels(current.model.effects):
                break
            if not trusted:  # the fast one would take it back
                problem, current, swaps = swapped(problem, current, say)
                steps += swaps
                problem, current = merged(problem, current, say)
                experiments = problem.experiments
    except KeyboardInterrupt:
        say("interrupted: what was found until now is judged; once more to leave")
        interrupted = True
    if current.model.effects:
        problem, current = longer_view(experiments, problem, current)
        current = prune(problem, current)
    problem = Problem(problem.experiments, problem.observer, FINAL)
    current = over_creases(problem, problem.fit(current.model, current.x))
    baseline = problem.fit(Model(device), linear.x)
    return Searched(problem, baseline, current, tuple(steps), interrupted)


def surviving(believed: Sequence[Answer]) -> tuple[Answer, Fitted] | None:
    """Return the first answer whose effect stays when what no longer pays is removed."""
    for answer in believed:
        pruned = prune(answer.problem, answer.settled)
        if answer.trial.label in effect_labels(pruned.model.effects):
            return answer, pruned
    return None


def swapped(problem: Problem, current: Fitted, say: Say) -> tuple[Problem, Fitted, list[Step]]:
    """Take each effect out and look whether another explains more in its place.

    Early steps see the recording with the rest of the physics still missing, so what they took may
    have stood for several effects at once. Returns the steps too: they name the rivals of every
    effect beside all others.
    """
    steps: list[Step] = []
    index = exchanged = 0
    while index < len(current.model.effects):
        label = place_label(current.model.effects[index])
        without = fit_without(problem, current, index)
        step = take(problem, without, problem.experiments, say)
        own = Trial(label, current.light(), without.chi2 - current.chi2, _extra(current, without))
        best = step.taken
        stays = best is None or best.label == label or exchanged >= MOST
        if stays or best is None or not _clearly(best, own, step.inflation):
            steps.append(replace(step, taken=own))
            index += 1
            continue
        say(f"{best.label} in place of {label}")
        try:
            problem, current = settled_on(best, problem.experiments)
        except ValueError:
            steps.append(replace(step, taken=own))
            index += 1
            continue
        current = prune(problem, current)
        steps, index, exchanged = [], 0, exchanged + 1
    return problem, current, steps


def merged(problem: Problem, current: Fitted, say: Say) -> tuple[Problem, Fitted]:
    """Put a richer effect in the place of one, or of two, that are its special case or part of it.

    Coulomb friction with a drag may be Stribeck friction, with a constant force directional: the
    simpler one, found first, bars the richer, and what is left then looks like something else. One
    for one must be better by five sigma.
    """
    wide = inflation(current.white)
    price = wide * float(np.log(current.samples))
    best: Trial | None = None
    paid = current.chi2 + price * current.x.size
    for i, one in enumerate(current.model.effects):
        alone = fit_without(problem, current, i)
        for trial in richer_trials(problem, alone, one):
            asked = trial.fitted.chi2 + price * trial.fitted.x.size + FIVE_SIGMA * wide
            if asked < paid and not trial.on_bound:
                best, paid = trial, asked
        for j in range(len(alone.model.effects)):
            rest = fit_without(problem, alone, j)
            for trial in richer_trials(problem, rest, one):
                asked = trial.fitted.chi2 + price * trial.fitted.x.size
                if asked < paid and not trial.on_bound:
                    best, paid = trial, asked
    if best is None:
        return problem, current
    try:
        there, settled = settled_on(best, problem.experiments)
    except ValueError:
        return problem, current
    kept = prune(there, settled)
    if best.label not in effect_labels(kept.model.effects):
        return problem, current
    say(f"{best.label} is richer and explains more")
    return there, kept


def _extra(full: Fitted, part: Fitted) -> int:
    return max(1, full.x.size - part.x.size)


def _clearly(new: Trial, old: Trial, wide: float) -> bool:
    """Whether a swap pays: as simple and better, or simpler and within five sigma."""
    if new.parameters < old.parameters:
        return old.gained - new.gained < FIVE_SIGMA * wide
    more = FIVE_SIGMA * wide if new.parameters > old.parameters else SWAP_GAIN * wide
    return new.gained - new.price > old.gained - old.price + more


def fit_without(problem: Problem, fitted: Fitted, index: int) -> Fitted:
    """Fit a model again without one of its effects; asked twice of the same, answer from memory."""
    labels = [p.name.split(".")[0] for p in fitted.model.parameters]
    gone = place_label(fitted.model.effects[index])
    key = (gone, fitted.model.label, fitted.x.tobytes())
    if key not in problem.without:
        keep = np.array([label != gone for label in labels])
        problem.without[key] = problem.fit(fitted.model.without_effect(index), fitted.x[keep])
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
        cheap = without.chi2 - fitted.chi2 < THRESHOLD * inflation(fitted.white)
        if cheap or may_be_zero(fitted, index):
            fitted, index = without, 0
        else:
            index += 1
    return fitted


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
    where another is sure. None for an effect without magnitudes.
    """
    physics = fitted.model.effects[index]
    names = MAGNITUDE.get(physics.effect.name, ())
    parameters = fitted.model.parameters
    own = [
        j for j, p in enumerate(parameters)
        if p.kind == "effect" and p.index == index and p.key in names
    ]  # fmt: skip
    if not own:
        return None
    scales = np.array([parameters[j].scale for j in own])
    size = np.array([physics.values[parameters[j].key] for j in own]) / scales + fitted.x[own]
    spread = np.nan_to_num(covariance(fitted)[np.ix_(own, own)], posinf=FREE)
    variance, axes = np.linalg.eigh(spread)
    found = np.sum((axes.T @ size) ** 2 / np.maximum(variance, np.finfo(float).tiny))
    return float(found), len(own)

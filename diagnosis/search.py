"""Name the physics: forward steps with swaps and removal, each by a joint fit.

A step screens every effect at every place, fits the most promising jointly with the linear
parameters from their best starts, and takes the one with the highest evidence: chi-square gained
less ln(samples) a parameter. It is believed only if it gains more than `THRESHOLD`, which is what
the best of some two hundred starts gains on white noise less than once in a hundred recordings,
widened by the spectrum of the residual (a coloured residual makes every gain look larger). Simplest
first: a richer effect must beat a simpler one by five sigma.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from diagnosis.candidates import candidates
from diagnosis.experiment import Experiment
from diagnosis.fit import Fitted, Problem
from diagnosis.parameters import Model
from diagnosis.predictor import Observer, choose_observer
from diagnosis.screen import screen
from sim.device import Device, place_label
from sim.physics.effect import Physics

Floats = NDArray[np.float64]
THRESHOLD = 30.0
FIVE_SIGMA = 25.0
FITTED = 8  # candidates fitted a step
MOST = 3  # effects
REFITS = 3
SETTLED = 1.02  # chi2 per sample at which the observer and the refit agree
Say = Callable[[str], None]


@dataclass(frozen=True)
class Trial:
    """A candidate's joint fit. gained: chi2 of the model before, less this one's."""

    label: str
    fitted: Fitted
    gained: float
    parameters: int


@dataclass(frozen=True)
class Step:
    """One round of the search: the trials, best evidence first; taken is the one believed, if any."""

    trials: tuple[Trial, ...]
    taken: Trial | None
    inflation: float


@dataclass(frozen=True)
class Searched:
    """The refit without physics, the final fit with what was found, and the way there."""

    problem: Problem
    refit: Fitted
    final: Fitted
    steps: tuple[Step, ...]


def refit(
    device: Device, experiments: Sequence[Experiment], effects: tuple[Physics, ...] = ()
) -> tuple[Problem, Fitted]:
    """Fit the linear parameters, choosing the observer anew between fits until both agree."""
    model = Model(device, effects, tuple({} for _ in effects))
    current, x = device, np.zeros(model.linear_count)
    for _ in range(REFITS):
        problem = Problem(experiments, _observer(current, experiments))
        fitted = problem.fit(model, x)
        x = fitted.x
        current, _ = model.build(x)
        if abs(fitted.chi2 / fitted.samples - 1.0) < SETTLED - 1.0:
            break
    problem = Problem(experiments, _observer(current, experiments))
    return problem, problem.fit(model, x)


def _observer(device: Device, experiments: Sequence[Experiment]) -> Observer:
    return choose_observer(device, experiments)


def search(
    device: Device, experiments: Sequence[Experiment], say: Say = lambda _: None
) -> Searched:
    """Search for missing physics in the experiments (the part to fit on)."""
    problem, linear = refit(device, experiments)
    say(f"linear refit: innovations {np.sqrt(linear.chi2 / linear.samples):.3f} of their noise model")
    current, steps = linear, []
    while len(current.model.effects) < MOST:
        step = take(problem, current, experiments, say)
        steps.append(step)
        if step.taken is None:
            break
        problem, current = _settle(device, experiments, step.taken.fitted)
        current = prune(problem, current)
    baseline = problem.fit(Model(device), linear.x)
    return Searched(problem, baseline, current, tuple(steps))


def _settle(
    device: Device, experiments: Sequence[Experiment], fitted: Fitted
) -> tuple[Problem, Fitted]:
    """Choose the observer anew with the physics found, and fit once more."""
    built, _ = fitted.model.build(fitted.x)
    problem = Problem(experiments, choose_observer(built, experiments))
    return problem, problem.fit(fitted.model, fitted.x)


def take(
    problem: Problem, current: Fitted, experiments: Sequence[Experiment], say: Say
) -> Step:
    """Try every candidate on top of a fitted model."""
    built, _ = current.model.build(current.x)
    screened = screen(problem, current, candidates(built, experiments))
    wide = inflation(current.white)
    trials: list[Trial] = []
    for one in screened[:FITTED]:
        if one.score < 0.2 * THRESHOLD and trials:
            break
        model = current.model.with_effect(one.start.physics, one.start.scales)
        extra = len(model.parameters) - current.x.size
        start = np.concatenate([current.x, np.zeros(extra)])
        fitted = problem.fit(model, start)
        trials.append(Trial(one.start.label, fitted, current.chi2 - fitted.chi2, extra))
    trials.sort(key=lambda t: evidence(t, current.samples), reverse=True)
    if not trials:
        return Step((), None, wide)
    best = _simplest(trials, wide)
    say(f"best candidate {best.label}: chi-square gained {best.gained:.0f}")
    believed = best.gained > THRESHOLD * wide + 2.0 * best.parameters
    return Step(tuple(trials), best if believed else None, wide)


def evidence(trial: Trial, samples: int) -> float:
    """Chi-square gained less the price of the parameters."""
    return trial.gained - trial.parameters * float(np.log(samples))


def _simplest(trials: Sequence[Trial], wide: float) -> Trial:
    """The trial with the fewest parameters among those within five sigma of the best."""
    top = trials[0]
    near = [t for t in trials if top.gained - t.gained < FIVE_SIGMA * wide]
    return min(near, key=lambda t: (t.parameters, -t.gained))


def prune(problem: Problem, fitted: Fitted) -> Fitted:
    """Remove every effect whose absence costs less than the threshold."""
    index = 0
    while len(fitted.model.effects) > 1 and index < len(fitted.model.effects):
        labels = [p.name.split(".")[0] for p in fitted.model.parameters]
        gone = place_label(fitted.model.effects[index])
        keep = np.array([label != gone for label in labels])
        without = problem.fit(fitted.model.without_effect(index), fitted.x[keep])
        if without.chi2 - fitted.chi2 < THRESHOLD:
            fitted, index = without, 0
        else:
            index += 1
    return fitted


def inflation(white: Floats) -> float:
    """How much larger a chi-square gain may be by colour alone: the residual's spectrum's maximum.

    Over a spectrum smoothed to 32 bands; 1 for a white residual of unit variance, never below 1.
    """
    from scipy.signal import welch

    _, power = welch(white, nperseg=min(64, white.size))
    return max(1.0, float(power[1:].max() / 2.0))



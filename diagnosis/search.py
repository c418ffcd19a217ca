"""Name the physics: forward steps with swaps and removal, each by a joint fit.

A step screens every effect at every place, fits the most promising jointly with the linear
parameters from their best starts, and takes the one with the highest evidence: chi-square gained
less ln(samples) a parameter. It is believed only if it gains more than `THRESHOLD`, which is what
the best of some two hundred starts gains on white noise less than once in a hundred recordings,
widened by the spectrum of the residual (a coloured residual makes every gain look larger). Simplest
first: a richer effect must beat a simpler one by five sigma.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from diagnosis.candidates import CONTAINED, MAGNITUDE, Start, candidates
from diagnosis.experiment import Experiment
from diagnosis.fit import Fitted, Problem
from diagnosis.horizon import longer_view
from diagnosis.lattice import STEPPED, sharpened, stepped_trials
from diagnosis.parameters import Model, effect_labels
from diagnosis.predictor import FINAL, Observer, choose_observer
from diagnosis.screen import screen
from diagnosis.uncertainty import covariance, inflation
from diagnosis.waves import wave_starts
from sim.device import Device, place_label
from sim.physics.effect import Physics

Floats = NDArray[np.float64]
THRESHOLD = 30.0
FIVE_SIGMA = 25.0
FITTED = 8  # candidates fitted a step
WORTH = 10.0  # first-order chi-square that is worth a fit
FIRST_ROUNDS = 4  # of a fit, after which only the candidates near the best go on
FURTHER_ROUNDS = 8
STILL_NEAR = 100.0  # chi-square behind the best
MOST = 3  # effects
SURE = 4.0  # standard errors that an effect must be away from nothing
MOSTLY = 0.8  # of what a richer effect gains: then the simple one comes first
REFITS = 6
SWAP_GAIN = 4.0  # chi-square by which an effect as simple must be better to replace one
SHARPENED = 3  # times that an encoder's error is predicted again
SETTLED = 1.02  # chi2 per sample at which the observer and the refit agree
Say = Callable[[str], None]


@dataclass(frozen=True)
class Trial:
    """A candidate's joint fit. gained: chi2 of the model before, less this one's.

    price: chi-square that the search for its period costs. experiments: the recordings as it sees
    them, None where no different.
    """

    label: str
    fitted: Fitted
    gained: float
    parameters: int
    on_bound: str = ""
    price: float = 0.0
    experiments: Sequence[Experiment] | None = None

    @property
    def effect(self) -> str:
        """The effect's name."""
        return self.label.split("@")[0]


@dataclass(frozen=True)
class Step:
    """One round of the search: trials, best evidence first; taken is the one believed, if any."""

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
    interrupted: bool = False


def refit(
    device: Device, experiments: Sequence[Experiment], effects: tuple[Physics, ...] = ()
) -> tuple[Problem, Fitted]:
    """Fit the linear parameters, choosing the observer anew between fits until both agree."""
    model = Model(device, effects, tuple({} for _ in effects))
    return settle(experiments, model, np.zeros(model.linear_count))


def settle(experiments: Sequence[Experiment], model: Model, x: Floats) -> tuple[Problem, Fitted]:
    """Fit a model from x, choosing the observer anew between fits until both agree."""
    for _ in range(REFITS):
        problem = Problem(experiments, observer(experiments, model, x))
        fitted = problem.fit(model, x)
        x = fitted.x
        if abs(fitted.chi2 / fitted.samples - 1.0) < SETTLED - 1.0:
            break
    problem = Problem(experiments, observer(experiments, model, x))
    return problem, problem.fit(model, x)


def observer(experiments: Sequence[Experiment], model: Model, x: Floats) -> Observer:
    """Return the observer for the recordings as the model at x sees them."""
    return choose_observer(model.acting(x), [model.seen(e, x) for e in experiments])


def search(
    device: Device, experiments: Sequence[Experiment], say: Say = lambda _: None
) -> Searched:
    """Search for missing physics in the experiments (the part to fit on)."""
    problem, linear = refit(device, experiments)
    size = np.sqrt(linear.chi2 / linear.samples)
    say(f"linear refit: innovations {size:.3f} of their noise model")
    current, steps, interrupted = linear, list[Step](), False
    try:
        while len(current.model.effects) < MOST:
            step = take(problem, current, experiments, say)
            steps.append(step)
            if step.taken is None:
                break
            problem, settled = settled_on(step.taken, experiments)
            experiments = problem.experiments
            current = prune(problem, settled)
            if step.taken.label not in effect_labels(current.model.effects):
                break
            if len(current.model.effects) > 1:
                problem, current, swaps = swapped(problem, current, say)
                steps += swaps
                experiments = problem.experiments
    except KeyboardInterrupt:
        say("interrupted: what was found until now is judged; once more to leave")
        interrupted = True
    if current.model.effects:
        problem, current = longer_view(experiments, problem, current)
        current = prune(problem, current)
    problem = Problem(problem.experiments, problem.observer, FINAL)
    current = problem.fit(current.model, current.x)
    baseline = problem.fit(Model(device), linear.x)
    return Searched(problem, baseline, current, tuple(steps), interrupted)


def settled_on(trial: Trial, experiments: Sequence[Experiment]) -> tuple[Problem, Fitted]:
    """Settle observer and fit on a trial, and what it says of the recordings."""
    experiments = trial.experiments or experiments
    problem, settled = settle(experiments, trial.fitted.model, trial.fitted.x)
    if settled.model.sensor_error_known:
        for _ in range(SHARPENED):
            experiments = sharpened(problem, settled, experiments)
            problem, settled = settle(experiments, settled.model, settled.x)
    return problem, settled


def swapped(problem: Problem, current: Fitted, say: Say) -> tuple[Problem, Fitted, list[Step]]:
    """Take each effect out and look whether another explains more in its place.

    Early steps see the recording with the rest of the physics still missing, so what they took may
    have stood for several effects at once. Returns the steps too: they name the rivals of every
    effect beside all others.
    """
    steps: list[Step] = []
    index = 0
    while index < len(current.model.effects) and len(steps) <= 2 * MOST:
        label = place_label(current.model.effects[index])
        without = fit_without(problem, current, index)
        step = take(problem, without, problem.experiments, say)
        own = Trial(label, current, without.chi2 - current.chi2, _extra(current, without))
        best = step.taken
        if best is None or best.label == label or not _clearly(best, own, step.inflation):
            steps.append(replace(step, taken=own))
            index += 1
            continue
        say(f"{best.label} in place of {label}")
        problem, current = settled_on(best, problem.experiments)
        current = prune(problem, current)
        steps, index = [], 0
        if len(current.model.effects) < 2:
            break
    return problem, current, steps


def _extra(full: Fitted, part: Fitted) -> int:
    return max(1, full.x.size - part.x.size)


def _clearly(new: Trial, old: Trial, wide: float) -> bool:
    """Whether a swap pays: as simple and better, or simpler and within five sigma."""
    if new.parameters < old.parameters:
        return old.gained - new.gained < FIVE_SIGMA * wide
    more = FIVE_SIGMA * wide if new.parameters > old.parameters else SWAP_GAIN * wide
    return new.gained - new.price > old.gained - old.price + more


def fit_without(problem: Problem, fitted: Fitted, index: int) -> Fitted:
    """Fit a model again without one of its effects."""
    labels = [p.name.split(".")[0] for p in fitted.model.parameters]
    gone = place_label(fitted.model.effects[index])
    keep = np.array([label != gone for label in labels])
    return problem.fit(fitted.model.without_effect(index), fitted.x[keep])


def take(problem: Problem, current: Fitted, experiments: Sequence[Experiment], say: Say) -> Step:
    """Try every candidate on top of a fitted model."""
    built = current.model.build(current.x)
    starts = [s for s in candidates(built, experiments) if s.physics.effect.name not in STEPPED]
    waves, prices = wave_starts(problem, current)
    screened = screen(problem, current, [*starts, *waves])
    wide = inflation(current.white)
    near = [one for one in screened[:FITTED] if one.score > WORTH] or screened[:1]
    trials = [_tried(problem, current, one.start, prices, FIRST_ROUNDS) for one in near]
    most = max((t.gained for t in trials), default=0.0)
    trials = [
        _further(problem, current, t) if most - t.gained < STILL_NEAR * wide else t for t in trials
    ]
    for t in stepped_trials(problem, current, experiments):
        say(f"{t.label}: chi-square gained {t.gained:.0f}")
        trials.append(Trial(t.label, t.fitted, t.gained, 1, "", t.price, t.problem.experiments))
    for t in trials:
        if t.on_bound and t.gained > THRESHOLD * wide:
            say(f"{t.label} is left out: its {t.on_bound} runs to the end of what is allowed")
    trials = [t for t in trials if not t.on_bound]
    trials.sort(key=lambda t: evidence(t, current.samples), reverse=True)
    if not trials:
        return Step((), None, wide)
    best = _simplest(trials, wide)
    say(f"best candidate {best.label}: chi-square gained {best.gained:.0f}")
    believed = best.gained > (THRESHOLD + best.price) * wide + 2.0 * best.parameters
    return Step(tuple(trials), best if believed else None, wide)


def _tried(
    problem: Problem, current: Fitted, start: Start, prices: Mapping[str, float], rounds: int
) -> Trial:
    model = current.model.with_effect(start.physics, start.scales)
    extra = len(model.parameters) - current.x.size
    x = np.concatenate([current.x, np.zeros(extra)])
    fitted = problem.fit(model, x, rounds, current.jacobian)
    gained = current.chi2 - fitted.chi2
    price = prices.get(start.physics.effect.name, 0.0)
    return Trial(start.label, fitted, gained, extra, at_bound(fitted), price)


def _further(problem: Problem, current: Fitted, trial: Trial) -> Trial:
    """Fit a trial that may be the best to its end."""
    fitted = problem.fit(trial.fitted.model, trial.fitted.x, FURTHER_ROUNDS, current.jacobian)
    gained = current.chi2 - fitted.chi2
    return replace(trial, fitted=fitted, gained=gained, on_bound=at_bound(fitted))


def at_bound(fitted: Fitted) -> str:
    """Return the parameter of the last effect that stands on its upper bound, "" for none."""
    last = len(fitted.model.effects) - 1
    for p, x in zip(fitted.model.parameters, fitted.x, strict=True):
        if p.kind == "effect" and p.index == last and x > p.upper - 1e-3 * max(1.0, abs(p.upper)):
            return p.key
    return ""


def evidence(trial: Trial, samples: int) -> float:
    """Chi-square gained less the price of the parameters."""
    return trial.gained - trial.price - trial.parameters * float(np.log(samples))


def _simplest(trials: Sequence[Trial], wide: float) -> Trial:
    """The trial with the fewest parameters among those within five sigma of the best."""
    top = trials[0]
    if top.effect == "directional_friction":  # Coulomb and a constant force come before it
        plain = [t for t in trials if top.effect in CONTAINED.get(t.effect, ())]
        most = max(plain, key=lambda t: t.gained, default=top)
        if most.gained > MOSTLY * top.gained:
            return most
    near = [t for t in trials if top.gained - t.gained < FIVE_SIGMA * wide]
    return min(near, key=lambda t: (t.parameters, -t.gained))


def prune(problem: Problem, fitted: Fitted) -> Fitted:
    """Remove every effect whose absence costs less than the threshold, or that may be zero."""
    index = 0
    while index < len(fitted.model.effects):
        without = fit_without(problem, fitted, index)
        cheap = without.chi2 - fitted.chi2 < THRESHOLD * inflation(fitted.white)
        if cheap or may_be_zero(fitted, index):
            fitted, index = without, 0
        else:
            index += 1
    return fitted


def may_be_zero(fitted: Fitted, index: int) -> bool:
    """Whether all magnitudes of an effect lie within `SURE` of their errors of zero.

    Chi-square alone deceives where the fit before it had stopped short of its minimum, as it does
    on the creases that friction makes.
    """
    physics = fitted.model.effects[index]
    names = MAGNITUDE.get(physics.effect.name, ())
    spread = np.sqrt(np.diag(covariance(fitted)))
    found = [
        abs(physics.values[p.key] + p.scale * float(x)) < SURE * p.scale * float(s)
        for p, x, s in zip(fitted.model.parameters, fitted.x, spread, strict=True)
        if p.kind == "effect" and p.index == index and p.key in names
    ]
    return bool(found) and all(found)

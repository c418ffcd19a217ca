"""One step of the search: every effect on top of a fitted model, screened, fitted, ranked.

Most are screened out by their first-order gain; the best few are fitted jointly with the linear
parameters, first with the slopes known already, those near the best to the end. The one with the
highest evidence, chi-square gained less ln(samples) a parameter, is taken; it is believed only if
it gains more than `THRESHOLD` and two a parameter. One parameter gains 24 by chance with odds of
1e-6, the best of some two hundred starts with odds of 2e-4; on 48 of 52 clean recordings the best
gained 12 or less, and what gained more had other causes than chance. It is widened by the spectrum
of the residual (a coloured residual makes every gain look larger). Simplest first: a richer effect
must beat a simpler one by five sigma.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.candidates import candidates
from zwidth.diagnosis.experiment import Experiment
from zwidth.diagnosis.fit import Fitted, Problem
from zwidth.diagnosis.lattice import stepped_trials
from zwidth.diagnosis.mishaps import attempt
from zwidth.diagnosis.modes import PRICE, mode_starts
from zwidth.diagnosis.parameters import Model
from zwidth.diagnosis.screen import Screened, screen
from zwidth.diagnosis.uncertainty import inflation
from zwidth.diagnosis.waves import wave_starts
from zwidth.jobs.parallel import in_parallel, threads
from zwidth.sim.physics import EFFECTS, contains
from zwidth.sim.physics.effect import Physics
from zwidth.sim.place import of_label

Floats = NDArray[np.float64]
THRESHOLD = 22.0
FIVE_SIGMA = 25.0
FITTED = 8  # candidates fitted a step
AMONG = 3  # of a few named candidates
STRAIGHTENED = 4  # of them from the device file, where the refit is bent
WORTH = 10.0  # first-order chi-square that is worth a fit
FIRST_ROUNDS = 4  # of a fit, after which only the candidates near the best go on
FURTHER_ROUNDS = 8
SHIFTED = 0.03  # in x: as little a fit goes by itself
STILL_KNOWN = 0.3  # in x, by which the model's slopes change little
BENT = 2.0  # prior deviations: a refit so far off may have bent itself to what is missing
STILL_NEAR = 100.0  # chi-square behind the best
MOSTLY = 0.8  # of what a richer effect gains: then the simple one comes first
Say = Callable[[str], None]


def silent(_: str) -> None:
    """Say nothing."""


@dataclass(frozen=True)
class Trial:
    """A candidate's joint fit, `light`. gained: chi2 of the model before, less this one's.

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
        return of_label(self.label)[0]

    @property
    def has_valleys(self) -> bool:
        """Whether a fit of the effect ends in the valley where it began."""
        return any(p.valleys for p in EFFECTS[self.effect].parameters)

    @property
    def worth(self) -> float:
        """Chi-square gained less the price of the search."""
        return self.gained - self.price


@dataclass(frozen=True)
class Step:
    """One round of the search: trials, best evidence first.

    believed: those that gain more than chance, best first; taken: the one believed most, if any.
    """

    trials: tuple[Trial, ...]
    taken: Trial | None
    inflation: float
    believed: tuple[Trial, ...] = ()


def take(
    problem: Problem,
    current: Fitted,
    experiments: Sequence[Experiment],
    say: Say,
    stepped: bool = True,
    wide: float | None = None,
) -> Step:
    """Try every candidate on top of a fitted model.

    stepped: also those that no slope leads to, which are told from white innovations only. wide:
    what chance gains is widened by; None for the colour of what the fitted model leaves, which is
    too much where it is known to lack something large.
    """
    built = current.model.build(current.x)
    starts = [s for s in candidates(built, experiments) if s.physics.effect.sought != "lattice"]
    find_waves = partial(wave_starts, problem, current)
    waves, prices = attempt("candidates", "what repeats over position", find_waves) or ([], {})
    find_modes = partial(mode_starts, problem, current)
    modes = attempt("candidates", "a further mass", find_modes) or []
    resonant = [name for name, effect in EFFECTS.items() if effect.sought == "resonances"]
    prices = {**prices, **dict.fromkeys(resonant, PRICE)}
    plain = [s for s in starts if s.physics.effect.name not in resonant]
    screened = screen(problem, current, [*plain, *waves, *modes])
    wide = inflation(current.white) if wide is None else wide
    promising = [one for one in screened[:FITTED] if one.score > WORTH] or screened[:1]
    trials = _all_tried(problem, current, current, promising, prices)
    straight = _straight(problem, current)
    if straight is not None:
        again = screen(problem, straight, starts)[:STRAIGHTENED]
        trials += _all_tried(problem, current, straight, again, prices)
        trials = _best_of_each(trials)
    most = max((t.gained for t in trials), default=0.0)
    trials = _near_ones_further(problem, current, trials, most - STILL_NEAR * wide)
    for t in stepped_trials(problem, current, experiments) if stepped else ():
        say(f"{t.label}: chi-square gained {t.gained:.0f}")
        light = t.fitted.light()
        trials.append(Trial(t.label, light, t.gained, 1, "", t.price, t.problem.experiments))
    for t in trials:
        if t.on_bound and t.gained > THRESHOLD * wide:
            say(f"{t.label} is left out: with it, {t.on_bound} runs out of what physics allows")
    trials = [t for t in trials if not t.on_bound]
    trials.sort(key=lambda t: evidence(t, current.samples), reverse=True)
    if not trials:
        return Step((), None, wide)
    best = _simplest(trials, wide)
    say(f"best candidate {best.label}: chi-square gained {best.gained:.0f}")
    order = [best, *(t for t in trials if t is not best)]
    believed = tuple(t for t in order if t.worth > THRESHOLD * wide + 2.0 * t.parameters)
    return Step(tuple(trials), believed[0] if believed else None, wide, believed)


def richer_trials(problem: Problem, current: Fitted, simple: Physics) -> list[Trial]:
    """Fit every effect that contains a simple one, on top of a model without it."""
    starts = [
        start
        for start in candidates(current.model.build(current.x), problem.experiments)
        if contains(
            start.physics.effect.name, start.physics.place, simple.effect.name, simple.place
        )
    ]
    screened = screen(problem, current, starts) if starts else []
    tried = _all_tried(problem, current, current, screened, {})
    return _near_ones_further(problem, current, tried, -math.inf)


def best_among(problem: Problem, current: Fitted, labels: Collection[str]) -> Trial | None:
    """Fit the most promising of some effects on top of a model, and the best of them to its end."""
    starts = [
        s
        for s in candidates(current.model.build(current.x), problem.experiments)
        if s.label in labels
    ]
    near = [one for one in screen(problem, current, starts)[:AMONG] if one.score > WORTH]
    trials = _all_tried(problem, current, current, near, {})
    best = max(trials, key=lambda t: evidence(t, current.samples), default=None)
    if best is None:
        return None
    return attempt("candidates", best.label, partial(_further, problem, current, best))


def _straight(problem: Problem, current: Fitted) -> Fitted | None:
    """Return the model with the linear parameters of the device file, where the fit is far off.

    A refit that can mimic what is missing hides it from a search that starts there.
    """
    linear = np.array([p.prior for p in current.model.parameters])
    if np.abs(current.x[linear]).max(initial=0.0) < BENT:
        return None
    return problem.at(current.model, np.where(linear, 0.0, current.x))


def _best_of_each(trials: Sequence[Trial]) -> list[Trial]:
    best: dict[str, Trial] = {}
    for t in trials:
        if t.label not in best or t.gained > best[t.label].gained:
            best[t.label] = t
    return list(best.values())


def _tried(
    problem: Problem, current: Fitted, at: Fitted, one: Screened, prices: Mapping[str, float]
) -> Trial:
    """Fit an effect on top of a model, from where it stands at `at`.

    A strong effect begins where the model absorbs, to first order, what it can of it, if that is
    the better beginning: from the unmoved model a fit of few rounds would not arrive.
    """
    start = one.start
    model = current.model.with_effect(start.physics, start.scales, start.bounds)
    extra = np.zeros(len(model.parameters) - current.x.size)
    x, known = np.concatenate([at.x, extra]), at.jacobian if at is current else None
    far = float(np.abs(one.shift).max(initial=0.0))
    if far > SHIFTED:
        moved = model.within(np.concatenate([at.x + one.shift, extra]))
        if _chi2(problem, model, moved) < _chi2(problem, model, x):
            x, known = moved, known if far < STILL_KNOWN else None
    fitted = problem.fit(model, x, FIRST_ROUNDS, known, final=False)
    gained = current.chi2 - fitted.chi2
    price = prices.get(start.physics.effect.name, 0.0)
    return Trial(start.label, fitted.light(), gained, extra.size, at_bound(fitted), price)


def _chi2(problem: Problem, model: Model, x: Floats) -> float:
    residual = problem.residual(model, x)
    return float(residual @ residual)


def _all_tried(
    problem: Problem,
    current: Fitted,
    at: Fitted,
    promising: Sequence[Screened],
    prices: Mapping[str, float],
) -> list[Trial]:
    fits = [
        (one.start.label, partial(_tried, problem, current, at, one, prices)) for one in promising
    ]
    return _all_fitted(fits)


def _near_ones_further(
    problem: Problem, current: Fitted, trials: Sequence[Trial], least: float
) -> list[Trial]:
    """The trials, those that gain more than the least fitted to their end, in their order."""
    fits = [
        (t.label, partial(_further, problem, current, t) if t.gained > least else partial(_same, t))
        for t in trials
    ]
    return _all_fitted(fits)


def _same(trial: Trial) -> Trial:
    return trial


def _all_fitted(fits: Sequence[tuple[str, Callable[[], Trial]]]) -> list[Trial]:
    """What fits give, named by their labels, less what an error cost."""
    tasks = [partial(attempt, "candidates", label, fit) for label, fit in fits]
    return [trial for trial in in_parallel(tasks, threads()) if trial is not None]


def _further(problem: Problem, current: Fitted, trial: Trial) -> Trial:
    """Fit a trial that may be the best to its end."""
    near = np.abs(trial.fitted.x[: current.x.size] - current.x).max(initial=0.0) < 1.0
    known = current.jacobian if near else None
    fitted = problem.fit(trial.fitted.model, trial.fitted.x, FURTHER_ROUNDS, known, final=False)
    gained = current.chi2 - fitted.chi2
    return replace(trial, fitted=fitted.light(), gained=gained, on_bound=at_bound(fitted))


def at_bound(fitted: Fitted) -> str:
    """Return a parameter that physics does not allow, "" for none.

    Of the last effect: it stands on one of its bounds where that is a limit of physics and none of
    the law (`Parameter.ends`). Of any: as `against_physics`.
    """
    last = len(fitted.model.effects) - 1
    for p, x in zip(fitted.model.parameters, fitted.x, strict=True):
        if p.kind == "effect" and p.index == last:
            low = "lower" in p.ends and x < p.lower + 1e-3
            high = "upper" in p.ends and x > p.upper - 1e-3 * max(1.0, abs(p.upper))
            if low or high:
                return p.key
    return against_physics(fitted)


def against_physics(fitted: Fitted) -> str:
    """Return a parameter by which an effect is no physics (`Effect.forbidden`), "" for none."""
    effects = fitted.model.effects_at(fitted.x)
    return next((wrong for p in effects if (wrong := p.effect.forbidden(dict(p.values)))), "")


def evidence(trial: Trial, samples: int) -> float:
    """Chi-square gained less the price of the parameters."""
    return trial.worth - trial.parameters * float(np.log(samples))


def _simplest(trials: Sequence[Trial], wide: float) -> Trial:
    """The trial with the fewest parameters among those within five sigma of the best."""
    top = trials[0]
    if EFFECTS[top.effect].parts_first:
        plain = [t for t in trials if t.effect in EFFECTS[top.effect].contains]
        most = max(plain, key=lambda t: t.gained, default=top)
        if most.gained > MOSTLY * top.gained:
            return most
    near = [t for t in trials if top.worth - t.worth < FIVE_SIGMA * wide]
    return min(near, key=lambda t: (t.parameters, -t.gained))

"""Name the physics: forward steps with second opinions, swaps and removal.

After a step has taken an effect (`diagnosis.trials`), observer and fit are settled; an observer
that takes all motion for physics and none for disturbance is asked as well, and the likelier answer
is kept; effects that no longer pay are removed; and each of several is exchanged for what may
explain more in its place, up to three effects.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from zwidth.diagnosis.creases import across_creases, over_creases
from zwidth.diagnosis.exchange import MOST, against, merged, paired, plainly_there, split, swapped
from zwidth.diagnosis.experiment import Experiment
from zwidth.diagnosis.fit import Fitted, Problem
from zwidth.diagnosis.horizon import longer_view
from zwidth.diagnosis.leftover import leftover
from zwidth.diagnosis.mishaps import isolated
from zwidth.diagnosis.parameters import Model, effect_labels
from zwidth.diagnosis.predictor import FINAL
from zwidth.diagnosis.removal import prune
from zwidth.diagnosis.selection.search import Search
from zwidth.diagnosis.settle import refit, under_likeliest_noise
from zwidth.diagnosis.trials import Say, Step, against_physics
from zwidth.diagnosis.views import Answer, ask, runs_freer
from zwidth.sim.device import Device


@dataclass(frozen=True)
class Searched:
    """The refit without physics, the final fit with what was found, and the way there."""

    problem: Problem
    refit: Fitted
    final: Fitted
    steps: tuple[Step, ...]
    interrupted: bool = False
    tried: "Search | None" = None


@dataclass
class _Way:
    """Where a search stands. likely: what likelihood took before free runs decided, if they did.

    trusted: an observer that trusts the model was followed for its free runs.
    """

    problem: Problem
    linear: Fitted
    current: Fitted
    experiments: Sequence[Experiment]
    steps: list[Step] = field(default_factory=list[Step])
    likely: tuple[Problem, Fitted] | None = None
    trusted: bool = False
    interrupted: bool = False


def search(
    device: Device, experiments: Sequence[Experiment], say: Say = lambda _: None
) -> Searched:
    """Search for missing physics in the experiments (the part to fit on).

    What was found stays found where a later step is interrupted or fails. Raises NoObserver where
    no observer follows the recordings with the device.
    """
    problem, linear = refit(device, experiments)
    size = np.sqrt(linear.chi2 / linear.samples)
    say(f"linear refit: innovations {size:.3f} of their noise model")
    way = _Way(problem, linear, linear, problem.experiments)
    try:
        with isolated("search", "a further effect"):
            for _ in range(2 * MOST):
                if len(way.current.model.effects) == MOST or not _stepped(way, say):
                    break
    except KeyboardInterrupt:
        say("interrupted: what was found until now is judged; once more to leave")
        way.interrupted = True
    with isolated("search", "the last look at what was found"):
        _looked_over(way, say)
    _end(way)
    if not way.current.model.effects and way.likely is not None:
        # Nothing of the free runs' choice pays.
        with isolated("search", "what likelihood takes"):
            way.problem, way.current = _calm(*way.likely)
            _name_rivals(way, say)
            _end(way)
    baseline = way.problem.fit(Model(device), way.linear.x)
    return Searched(way.problem, baseline, way.current, tuple(way.steps), way.interrupted)


def _stepped(way: _Way, say: Say) -> bool:
    """Take the effect that is believed most, and exchange what it shows to be wrong.

    False where nothing is believed.
    """
    asked = ask(way.problem, way.current, way.experiments, say)
    way.problem, way.current = asked.problem, asked.current
    way.experiments = way.problem.experiments
    if not way.current.model.effects:
        way.linear = way.current
    kept = surviving(asked.believed)
    if kept is None:
        way.steps.append(replace(asked.step, taken=None))
        return False
    answer, best = kept
    freer = runs_freer(asked, answer, best)
    if freer is not None:
        say(f"an observer that trusts the model more takes {freer.trial.label}")
        # Free runs speak for it, and the likeliest observer hides what is slow: it stays.
        way.likely = way.likely or (answer.problem, best)
        answer, best, way.trusted = freer, _pruned_but(freer), True
    say(f"taken: {answer.trial.label}")
    way.steps.append(replace(answer.step, taken=answer.trial))
    way.problem, way.current = answer.problem, best
    way.experiments = way.problem.experiments
    if answer.trial.label not in effect_labels(way.current.model.effects):
        return False
    if freer is None and way.trusted:  # where nothing is left, likelihood judges fairly again
        way.trusted = leftover(way.problem, way.current).significant
    if not way.trusted or plainly_there(way.problem, way.current):  # else the fast one undoes it
        _exchange(way, say)
    return True


def _exchange(way: _Way, say: Say) -> None:
    """Exchange effects for what explains more in their place, one for two, one for one and so on.

    Every kind of exchange fails by itself.
    """
    before = way.current.model.label
    with isolated("exchange", "two for one"):
        way.problem, way.current = split(way.problem, way.current, say, way.trusted)
        before = way.current.model.label
    swaps: list[Step] = []
    with isolated("exchange", "one for one"):
        way.problem, way.current, swaps = swapped(way.problem, way.current, say, way.trusted)
        if way.current.model.label != before:  # what was put in may be two
            way.problem, way.current = split(way.problem, way.current, say, way.trusted)
    way.steps += swaps
    if not way.trusted:
        with isolated("exchange", "two for two"):
            way.problem, way.current = paired(way.problem, way.current, swaps, say)
        with isolated("exchange", "richer ones"):
            way.problem, way.current = merged(way.problem, way.current, say)
    way.experiments = way.problem.experiments


def _looked_over(way: _Way, say: Say) -> None:
    """Look at what was found again: by free runs, under calmer observers, without what idles."""
    if not way.current.model.effects:
        return
    way.problem, way.current = longer_view(way.experiments, way.problem, way.current)
    way.problem, way.current = _calm(way.problem, way.current)
    way.current = prune(way.problem, way.current)
    if way.interrupted:
        return
    if way.problem.observer.whitening is None:  # free runs decided
        way.problem, way.current = split(way.problem, way.current, say, freely=True)
    _name_rivals(way, say)


def _name_rivals(way: _Way, say: Say) -> None:
    if not way.interrupted:
        way.steps += _unweighed(way.problem, way.current, way.steps, say)


def _end(way: _Way) -> None:
    """Fit the last time; where that fails, the fit before stays."""
    with isolated("search", "the last fit"):
        way.problem, way.current = _ended(way.problem, way.current)


def _calm(problem: Problem, current: Fitted) -> tuple[Problem, Fitted]:
    """The fit under the likeliest model of the noise, where noise alone is left.

    Before anything is removed: noise of another colour than it is taken for hides what is there.
    """
    if problem.observer.whitening is None or leftover(problem, current).significant:
        return problem, current
    calm = under_likeliest_noise(problem, current)
    return calm, current if calm is problem else calm.fit(current.model, current.x)


def _ended(problem: Problem, current: Fitted) -> tuple[Problem, Fitted]:
    """The last fit, with finer substeps and amid its creases."""
    problem = Problem(problem.experiments, problem.observer, FINAL)
    current = over_creases(problem, problem.fit(current.model, current.x))
    kept = prune(problem, current)  # what the coarser search saw may be nothing
    return problem, across_creases(
        problem, current if kept is current else over_creases(problem, kept)
    )


def _unweighed(problem: Problem, current: Fitted, steps: Sequence[Step], say: Say) -> list[Step]:
    """Steps that name the rivals of effects that an exchange brought in last."""
    known = {s.taken.label for s in steps if s.taken is not None}
    new: list[Step] = []
    for index, label in enumerate(effect_labels(current.model.effects)):
        if label not in known:
            step, own = against(problem, current, index, say)
            new.append(replace(step, taken=own))
    return new


def _pruned_but(answer: Answer) -> Fitted:
    """Remove what no longer pays beside an effect that was just taken, and not that one."""
    pruned = prune(answer.problem, answer.settled)
    kept = answer.trial.label in effect_labels(pruned.model.effects)
    return pruned if kept else answer.settled


def surviving(believed: Sequence[Answer]) -> tuple[Answer, Fitted] | None:
    """Return the first answer whose effect stays when what no longer pays is removed."""
    for answer in believed:
        pruned = prune(answer.problem, answer.settled)
        kept = answer.trial.label in effect_labels(pruned.model.effects)
        if kept and not against_physics(pruned):
            return answer, pruned
    return None

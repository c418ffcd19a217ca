"""Name the physics: forward steps with second opinions, swaps and removal.

After a step has taken an effect (`diagnosis.trials`), observer and fit are settled; an observer
that takes all motion for physics and none for disturbance is asked as well, and the likelier answer
is kept; effects that no longer pay are removed; and each of several is exchanged for what may
explain more in its place, up to three effects.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from zwidth.diagnosis.creases import across_creases, over_creases
from zwidth.diagnosis.exchange import MOST, against, merged, paired, plainly_there, split, swapped
from zwidth.diagnosis.experiment import Experiment
from zwidth.diagnosis.fit import Fitted, Problem
from zwidth.diagnosis.horizon import longer_view
from zwidth.diagnosis.leftover import leftover
from zwidth.diagnosis.parameters import Model, effect_labels
from zwidth.diagnosis.predictor import FINAL
from zwidth.diagnosis.removal import prune
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


def search(
    device: Device, experiments: Sequence[Experiment], say: Say = lambda _: None
) -> Searched:
    """Search for missing physics in the experiments (the part to fit on)."""
    problem, linear = refit(device, experiments)
    experiments = problem.experiments
    size = np.sqrt(linear.chi2 / linear.samples)
    say(f"linear refit: innovations {size:.3f} of their noise model")
    current, steps, interrupted = linear, list[Step](), False
    likely: tuple[Problem, Fitted] | None = None  # what likelihood took before free runs decided
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
                # Free runs speak for it, and the likeliest observer hides what is slow: it stays.
                likely = likely or (answer.problem, best)
                answer, best, trusted = freer, _pruned_but(freer), True
            say(f"taken: {answer.trial.label}")
            steps.append(replace(answer.step, taken=answer.trial))
            problem, current = answer.problem, best
            experiments = problem.experiments
            if answer.trial.label not in effect_labels(current.model.effects):
                break
            if freer is None and trusted:  # where nothing is left, likelihood judges fairly again
                trusted = leftover(problem, current).significant
            if not trusted or plainly_there(problem, current):  # else the fast one takes it back
                problem, current = split(problem, current, say, trusted)
                before = current.model.label
                problem, current, swaps = swapped(problem, current, say, trusted)
                if current.model.label != before:  # what was put in may be two
                    problem, current = split(problem, current, say, trusted)
                steps += swaps
                if not trusted:
                    problem, current = paired(problem, current, swaps, say)
                    problem, current = merged(problem, current, say)
                experiments = problem.experiments
    except KeyboardInterrupt:
        say("interrupted: what was found until now is judged; once more to leave")
        interrupted = True
    if current.model.effects:
        problem, current = longer_view(experiments, problem, current)
        problem, current = _calm(problem, current)
        current = prune(problem, current)
        if not interrupted:
            if problem.observer.whitening is None:  # free runs decided
                problem, current = split(problem, current, say, freely=True)
            steps += _unweighed(problem, current, steps, say)
    problem, current = _ended(problem, current)
    if not current.model.effects and likely is not None:  # nothing of the free runs' choice pays
        problem, current = _calm(*likely)
        if not interrupted:
            steps += _unweighed(problem, current, steps, say)
        problem, current = _ended(problem, current)
    baseline = problem.fit(Model(device), linear.x)
    return Searched(problem, baseline, current, tuple(steps), interrupted)


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

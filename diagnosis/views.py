"""What is missing, asked under several observers and answered by likelihood.

An observer chosen for a model that lacks physics takes part of the motion for disturbance, and a
filter that whitens what is left takes its colour for noise: under both, the physics that is missing
explains little (a ripple of 370 sigma gained a chi-square of 75). Without it the fast observer is
nevertheless the likeliest one. So every candidate is tried under that observer, whitened, and under
slower ones, not whitened, which take all motion for physics; and then judged by what is the same
whatever the observer, the likelihood of the recording under the observer that is likeliest for the
candidate itself:

    cost = -2 log likelihood + priors + price of the search,    deviations concentrated out.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from zwidth.diagnosis.creases import along_gaps, with_gaps
from zwidth.diagnosis.experiment import Experiment
from zwidth.diagnosis.fit import Fitted, Problem
from zwidth.diagnosis.horizon import BETTER, free_run_error
from zwidth.diagnosis.lattice import sharpened
from zwidth.diagnosis.mishaps import attempt, isolated
from zwidth.diagnosis.parameters import Model
from zwidth.diagnosis.settle import NotWorth, cost_at, prepared_for, settle
from zwidth.diagnosis.steady import NoObserver
from zwidth.diagnosis.trials import (
    FIVE_SIGMA,
    THRESHOLD,
    Say,
    Step,
    Trial,
    against_physics,
    at_bound,
    evidence,
    silent,
    take,
)
from zwidth.diagnosis.uncertainty import inflation
from zwidth.jobs.parallel import in_parallel, threads

SLOWER = (1e-2,)  # of the observer's ratio
ASKED = 5  # trials of each view whose likelihood is looked at
SETTLED = 3  # of them all, settled
HOPE = 10.0  # -2 log likelihood gained by a trial as it stands, to be worth settling
WEAK = 200.0  # -2 log likelihood gained, below which a slower observer must agree
RATHER = 0.3  # of what the best explains, that another must to be looked at
WIDENED = (0.8, 1.0, 1.25)  # gaps of play, from which a device file's values are fitted
WALKED = 12.0  # -2 log likelihood beyond `HOPE` that play must gain for its gaps to be walked
STOPPED = 300.0  # the same behind the best, by which a first fit of play leads nowhere
NEARLY = 100.0  # the same, within which a walk may lead to a deeper valley
SHARPENED = 3  # times that an encoder's error is predicted again


@dataclass(frozen=True)
class Answer:
    """A trial, settled under its own likeliest observer, and what it costs.

    view: the problem under which it was fitted; slow: whether that was a slower observer's.
    """

    step: Step
    trial: Trial
    view: Problem
    slow: bool
    problem: Problem
    settled: Fitted
    cost: float


@dataclass(frozen=True)
class Asked:
    """What all observers say: step under the likeliest one, and the answers believed, best first.

    problem, current: the model that was asked about, settled anew where it could be likelier.
    trusting: what each slower observer takes by itself, not settled.
    """

    problem: Problem
    current: Fitted
    step: Step
    believed: list[Answer]
    trusting: list[Answer]


def ask(problem: Problem, current: Fitted, experiments: Sequence[Experiment], say: Say) -> Asked:
    """Ask all observers what is missing in a model that is settled.

    What is believed must also beat the same model settled from the linear parameters that came with
    it: a refit that had stopped short of its best would make a claim of anything.
    """
    asked = _asked(problem, current, experiments, say)
    again = settled_without(asked)
    if again is None:
        return asked
    say("the model without it is settled anew from there, and is likelier than before")
    return _asked(*again, again[0].experiments, say)


def settled_without(asked: Asked) -> tuple[Problem, Fitted] | None:
    """Settle the model without what is believed most from there, if that is likelier."""
    if not asked.believed:
        return None
    own, best = asked.current, asked.believed[0]
    try:
        again = settle(asked.problem.experiments, own.model, best.settled.x[: own.x.size])
    except NoObserver:
        return None
    if against_physics(again[1]):
        return None
    return again if again[0].cost(again[1]) < asked.problem.cost(own) - HOPE else None


def _asked(problem: Problem, current: Fitted, experiments: Sequence[Experiment], say: Say) -> Asked:
    asked = list(views(problem, current, experiments, say))
    for view, there, slow in asked:
        again = _likelier(problem, current, view, there) if slow else None
        if again is not None:
            problem, current = again
            asked = list(views(problem, current, experiments, say))
            break
    own = problem.cost(current)
    pool: list[Answer] = []
    steps: list[Step] = []
    for view, there, slow in asked:
        step = take(view, there, view.experiments, silent if slow else say, stepped=not slow)
        steps.append(step)
        worth = _worth(step, current)
        tasks = [
            partial(attempt, "candidates", t.label, partial(_standing, t, view.experiments))
            for t in worth
        ]
        standing = in_parallel(tasks, threads())
        for trial, one in zip(worth, standing, strict=True):
            if one is not None:
                at, fitted = one
                found = at.cost(fitted) + trial.price
                pool.append(Answer(step, trial, view, slow, at, fitted, found))
    believed = _settled(pool, own, current, problem.experiments, say)
    trusting = [a for a in pool if a.slow and a.trial is a.step.taken]
    return Asked(problem, current, steps[0], believed, trusting)


def _likelier(
    problem: Problem, current: Fitted, view: Problem, there: Fitted
) -> tuple[Problem, Fitted] | None:
    """Settle once more from where a slower observer fits the same model, if that is likelier.

    Observer and fit in turn may stop at a fast observer that follows what the model gets wrong.
    """
    own = problem.cost(current)
    try:
        at, fitted = _as_it_stands(there.model, there, view.experiments)
        if at.cost(fitted) > own - HOPE:
            return None
        again = settle(view.experiments, there.model, there.x)
    except NoObserver:
        return None
    return again if again[0].cost(again[1]) < own - HOPE else None


def views(
    problem: Problem, current: Fitted, experiments: Sequence[Experiment], say: Say
) -> Iterator[tuple[Problem, Fitted, bool]]:
    """The given observer, then slower ones that hold the device, with the model fitted again."""
    yield problem, current, False
    for share in SLOWER:
        ratio = share * problem.observer.ratio
        try:
            slow = prepared_for(experiments, current.model, current.x, ratio)
            refitted = slow.fit(current.model, current.x)
            slow = prepared_for(slow.experiments, current.model, refitted.x, ratio)
            yield slow, slow.fit(current.model, refitted.x), True
        except NoObserver:  # so slow that it does not hold the device
            return


def _settled(
    pool: Sequence[Answer],
    own: float,
    current: Fitted,
    experiments: Sequence[Experiment],
    say: Say,
) -> list[Answer]:
    """Settle the likeliest few of different effects; those that are believed, the best first."""
    wide, each = inflation(current.white), float(np.log(current.samples))

    def weighed(answer: Answer) -> float:
        return answer.cost + each * answer.trial.parameters

    found: list[Answer] = []
    tried: set[str] = set()
    for answer in sorted(pool, key=weighed):
        trial = answer.trial
        least = max([HOPE, *(RATHER * (own - a.cost) for a in found)])
        if trial.label in tried or len(tried) == SETTLED or answer.cost > own - least:
            continue
        tried.add(trial.label)
        with isolated("candidates", trial.label):
            one = _believed(answer, own, current, experiments, say)
            found += [] if one is None else [one]
    if not found:
        return []
    found.sort(key=weighed)
    near = [a for a in found if a.cost - found[0].cost < FIVE_SIGMA * wide]
    best = min(near, key=lambda a: (a.trial.parameters, a.cost))
    return [best, *(a for a in found if a is not best)]


def _believed(
    answer: Answer, own: float, current: Fitted, experiments: Sequence[Experiment], say: Say
) -> Answer | None:
    """An answer settled, None where it does not gain enough, under whatever observer."""
    trial = answer.trial
    try:
        problem, fitted = settled_on(trial, answer.view.experiments, own - HOPE)
    except NotWorth:
        return None
    except NoObserver as error:
        say(f"{trial.label} is left out: {error}")
        return None
    if key := at_bound(fitted):
        say(f"{trial.label} is left out: with it, {key} runs out of what physics allows")
        return None
    paid = problem.cost(fitted) + trial.price
    least = THRESHOLD * inflation(current.white) + 2.0 * trial.parameters
    if own - paid <= least:
        return None
    if cost_at(problem.observer.ratio, current, experiments) - paid <= least:
        return None
    if own - paid < WEAK and _by_noise(current, answer, problem, fitted, paid, least):
        return None
    return replace(answer, problem=problem, settled=fitted, cost=paid)


def _by_noise(
    current: Fitted, answer: Answer, problem: Problem, fitted: Fitted, paid: float, least: float
) -> bool:
    """Whether a slower observer, which is another model of the noise, gains as much as a claim.

    Under coloured noise of the sensor an eccentric encoder gained 50 so, and a wave of it more.
    """
    slower = SLOWER[0] * problem.observer.ratio
    with_it = cost_at(slower, fitted, problem.experiments) + answer.trial.price
    return cost_at(slower, current, answer.view.experiments) - min(paid, with_it) <= least


def settled_on(
    trial: Trial, experiments: Sequence[Experiment], worth: float = np.inf
) -> tuple[Problem, Fitted]:
    """Settle observer and fit on a trial, and what it says of the recordings.

    Raises NotWorth where the first fit costs more than `worth`.
    """
    experiments = trial.experiments or experiments
    problem, settled = settle(experiments, trial.fitted.model, trial.fitted.x, worth)
    if trial.has_valleys and problem.cost(settled) < worth - WALKED:
        problem, settled = _deepest_valley(problem, settled)
    if settled.model.sensor_error_known:
        for _ in range(SHARPENED):
            experiments = sharpened(problem, settled, experiments)
            problem, settled = settle(experiments, settled.model, settled.x)
    return problem, settled


def _deepest_valley(problem: Problem, settled: Fitted) -> tuple[Problem, Fitted]:
    """Settle a model with play where its gaps were walked to their best.

    Also, with wider and narrower gaps, from the linear parameters of the device file: a refit
    without play bends far, and what starts there stays in another valley.
    """

    def cost(at: tuple[Problem, Fitted]) -> float:
        return at[0].cost(at[1])

    model = settled.model
    best = problem, settled
    with suppress(NoObserver, NotWorth):
        best = min(best, _walked(problem, settled), key=cost)
    straight = np.where([p.prior for p in model.parameters], 0.0, settled.x)
    for factor in WIDENED:
        with suppress(NoObserver, NotWorth):
            start = with_gaps(model, straight, factor)
            there = settle(problem.experiments, model, start, cost(best) + STOPPED)
            if cost(there) < cost(best) + NEARLY:
                best = min(best, _walked(*there), key=cost)
    return best


def _walked(problem: Problem, fitted: Fitted) -> tuple[Problem, Fitted]:
    walked = along_gaps(problem, fitted)
    return settle(problem.experiments, fitted.model, walked.x)


def runs_freer(asked: Asked, best: Answer, settled: Fitted) -> Answer | None:
    """Return what a slower observer takes, settled, if it runs free with clearly less error.

    Where what is missing is no white force, one sample ahead is not what tells.
    """
    limit = free_run_error(best.problem.experiments, best.problem, settled)
    for answer in asked.trusting:
        free = free_run_error(answer.view.experiments, answer.view, answer.trial.fitted)
        if free > BETTER * limit:
            continue
        with suppress(NoObserver, NotWorth):
            problem, fitted = settled_on(answer.trial, answer.view.experiments)
            paid = problem.cost(fitted) + answer.trial.price
            return replace(answer, problem=problem, settled=fitted, cost=paid)
    return None


def _worth(step: Step, current: Fitted) -> list[Trial]:
    ordered = sorted(step.trials, key=lambda t: evidence(t, current.samples), reverse=True)
    most = max((t.worth for t in ordered), default=0.0)
    kept = [t for t in ordered[:ASKED] if t.worth > max(RATHER * most, HOPE)]
    return [*kept, *(t for t in step.believed[:1] if not any(t is k for k in kept))]


def _standing(trial: Trial, experiments: Sequence[Experiment]) -> tuple[Problem, Fitted] | None:
    """A trial as it stands under its own likeliest observer; None where none follows."""
    with suppress(NoObserver, NotWorth):
        return _as_it_stands(trial.fitted.model, trial.fitted, trial.experiments or experiments)
    return None


def _as_it_stands(
    model: Model, fitted: Fitted, experiments: Sequence[Experiment]
) -> tuple[Problem, Fitted]:
    """A model at its x, not fitted again, under its own likeliest observer."""
    problem = prepared_for(experiments, model, fitted.x)
    residual = problem.residual(model, fitted.x)
    return problem, replace(fitted, residual=residual, chi2=float(residual @ residual))

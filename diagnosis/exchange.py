"""Exchange effects: one for one, a richer for its parts, two for two.

Early steps see the recording with the rest of the physics still missing, so what they took may have
stood for several effects at once.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from zwidth.diagnosis.candidates import candidates
from zwidth.diagnosis.fit import Fitted, Problem
from zwidth.diagnosis.horizon import BETTER, at_ratio, free_run_error
from zwidth.diagnosis.parameters import Model, effect_labels
from zwidth.diagnosis.removal import fit_without, prune
from zwidth.diagnosis.steady import NoObserver
from zwidth.diagnosis.trials import (
    FIVE_SIGMA,
    THRESHOLD,
    Say,
    Step,
    Trial,
    against_physics,
    at_bound,
    best_among,
    richer_trials,
    silent,
    take,
)
from zwidth.diagnosis.uncertainty import inflation
from zwidth.diagnosis.views import settled_on
from zwidth.sim.device import place_label
from zwidth.sim.physics import EFFECTS, RICHER_FORMS
from zwidth.sim.place import label_of, of_label

MOST = 3  # effects
SWAP_GAIN = 4.0  # chi-square by which an effect as simple must be better to replace one
RICHER = 1e-3  # odds at which chance makes what contains an effect so much better
TRUSTED = 0.03  # of what an effect explains, below which no law is taken for exact
SEEN = 2.0  # thresholds that every effect must gain under the likeliest observer to be exchanged
CHOICE = 2.0 * float(np.log(40))  # chi-square that one effect more costs, one of forty to choose
NEAR = 50.0  # chi-square behind an effect, of what may stand in its place if another changes too
RIVALS = 2  # of each effect, tried in pairs
FREED = 4  # trials of a split that are settled to run free


def plainly_there(problem: Problem, current: Fitted) -> bool:
    """Whether the likeliest observer misses every effect, not only one that trusts the model."""
    least = SEEN * THRESHOLD * inflation(current.white)
    alone = (fit_without(problem, current, i) for i in range(len(current.model.effects)))
    return all(without.chi2 - current.chi2 > least for without in alone)


def swapped(
    problem: Problem, current: Fitted, say: Say, freely: bool = False
) -> tuple[Problem, Fitted, list[Step]]:
    """Take each effect out and look whether another explains more in its place.

    Returns the steps too: they name the rivals of every effect beside all others.
    """
    steps: list[Step] = []
    index = exchanged = 0
    while index < len(current.model.effects):
        step, own = against(problem, current, index, say)
        label, wide = own.label, step.inflation
        best = step.taken
        stays = best is None or best.label == label or exchanged >= MOST
        richer = best is not None and best.parameters >= own.parameters
        if stays or best is None or (freely and richer) or not _clearly(best, own, wide):
            steps.append(replace(step, taken=own))
            index += 1
            continue
        limit = _paid(problem, current) + FIVE_SIGMA
        free = free_run_error(problem.experiments, problem, current) / BETTER if freely else np.inf
        exchange = _settled(best, problem, limit, free)
        if exchange is None:
            steps.append(replace(step, taken=own))
            index += 1
            continue
        say(f"{best.label} in place of {label}")
        problem, current = exchange
        steps, index, exchanged = [], 0, exchanged + 1
    return problem, current, steps


def against(problem: Problem, current: Fitted, index: int, say: Say) -> tuple[Step, Trial]:
    """Try all others in the place of an effect; the step, and the effect itself as a trial."""
    without = fit_without(problem, current, index)
    wide = inflation(current.white)
    step = take(problem, without, problem.experiments, say, wide=wide)
    label = place_label(current.model.effects[index])
    gained = without.chi2 - current.chi2
    return step, Trial(label, current.light(), gained, _extra(current, without))


def merged(problem: Problem, current: Fitted, say: Say) -> tuple[Problem, Fitted]:
    """Put a richer effect in the place of one, or of two, that are its special case or part of it.

    Coulomb friction with a drag may be Stribeck friction, with a constant force directional: the
    simpler one, found first, bars the richer, and what is left then looks like something else. One
    for one must be better than chance makes it once in a thousand: where both are five sigma apart
    on the whole recording, that errs as seldom one way as the other, and what is nearer is named as
    a rival. (The steps of the search ask more, when other physics is still missing and makes the
    richer look better.) And by a share of what the
    simple one explains: strong friction stops inside a substep, and bristles of 1e-6 rad, which
    nobody could see, explained 1 % more than none.
    """
    wide = inflation(current.white)
    price = wide * float(np.log(current.samples))
    best: Trial | None = None
    paid = current.chi2 + price * current.x.size
    for i, one in enumerate(current.model.effects):
        alone = fit_without(problem, current, i)
        for trial in richer_trials(problem, alone, one):
            more = trial.fitted.x.size - current.x.size
            chance = wide * float(chi2.isf(RICHER, max(1, more)))
            least = max(chance, TRUSTED * (alone.chi2 - current.chi2))
            asked = trial.fitted.chi2 + price * current.x.size + least
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
    exchange = _settled(best, problem, np.inf, np.inf)
    if exchange is None or best.label not in effect_labels(exchange[1].model.effects):
        return problem, current
    say(f"{best.label} is richer and explains more")
    return exchange


def split(
    problem: Problem, current: Fitted, say: Say, freely: bool = False
) -> tuple[Problem, Fitted]:
    """Put two effects in the place of one that contains what is simpler, if they explain as much.

    A constant force and Coulomb friction look like directional friction, which as one effect gains
    more than either; Coulomb friction and gravity like a soft presliding one. The simpler stands
    in its place, the second is what then gains most. With no fewer parameters they must be better
    by five sigma. freely: an observer that trusts the model was followed; then free runs decide.
    """
    wide = inflation(current.white)
    price = wide * float(np.log(current.samples))
    best: Trial | None = None
    paid = current.chi2 + price * current.x.size
    parts: list[Trial] = []
    for i, one in enumerate(current.model.effects):
        if len(current.model.effects) == MOST or not one.effect.contains:
            continue
        there = _simplest_instead(problem, current, i)
        if there is None:
            continue
        believed = take(problem, there, problem.experiments, silent, wide=wide).believed
        parts += believed
        for trial in believed:
            better = trial.fitted.chi2 < current.chi2 - FIVE_SIGMA * wide
            asked = trial.fitted.chi2 + price * trial.fitted.x.size + CHOICE * wide
            if asked < paid and (better or _fewer(trial, current)):
                best, paid = trial, asked
    exchange = None
    if freely:
        exchange = _freest(problem, current, parts)
    elif best is not None:
        exchange = _settled(best, problem, np.inf, np.inf)
    if exchange is None or len(exchange[1].model.effects) <= len(current.model.effects):
        return problem, current
    say(f"{exchange[1].model.label} in place of {current.model.label}")
    return exchange


def _simplest_instead(problem: Problem, current: Fitted, index: int) -> Fitted | None:
    """Fit what an effect contains in its place, from where the rest of the model stands.

    Not from the model without it: that may have bent itself so far that nothing leads back.
    """
    one = current.model.effects[index]
    labels = {label_of(name, one.place.acts_on) for name in one.effect.contains}
    model, x = current.model.less(current.x, index)
    best: dict[str, tuple[float, Model, np.ndarray]] = {}
    for start in candidates(model.build(x), problem.experiments):
        if start.label in labels:
            tried = model.with_effect(start.physics, start.scales, start.bounds)
            begin = np.concatenate([x, np.zeros(len(tried.parameters) - x.size)])
            residual = problem.residual(tried, begin)
            left = float(residual @ residual)
            if start.label not in best or left < best[start.label][0]:
                best[start.label] = left, tried, begin
    fits = [problem.fit(tried, begin) for _, tried, begin in best.values()]
    kept = [f for f in fits if not at_bound(f)]
    return min(kept, key=lambda f: f.chi2, default=None)


def _freest(
    problem: Problem, current: Fitted, trials: Sequence[Trial]
) -> tuple[Problem, Fitted] | None:
    """Settle a few trials: the one whose free runs err least, clearly less or by less unknowns."""
    own = free_run_error(problem.experiments, problem, current)
    found: tuple[Problem, Fitted] | None = None
    least = np.inf
    for trial in sorted(trials, key=lambda t: t.gained, reverse=True)[:FREED]:
        limit = min(least, own / BETTER if _fewer(trial, current) else own * BETTER)
        if problem.observer.whitening is not None:
            exchange = _settled(trial, problem, np.inf, limit)
        else:  # a slower observer, which the likeliest is not to replace
            seen = trial.experiments or problem.experiments
            exchange = at_ratio(seen, trial.fitted, problem.observer.ratio)
        if exchange is None:
            continue
        free = free_run_error(exchange[0].experiments, *exchange)
        if free < limit:
            found, least = exchange, free
    return found


def _fewer(trial: Trial, current: Fitted) -> bool:
    return trial.fitted.x.size < current.x.size


def paired(
    problem: Problem, current: Fitted, steps: Sequence[Step], say: Say
) -> tuple[Problem, Fitted]:
    """Exchange two effects at once, where each alone would be worse.

    A friction at the wrong mass explains part of the one beside it, and each holds the other there.
    steps: of `swapped`, one for every effect; a near rival of one is taken, and then what is akin
    to another tried in its place.
    """
    if len(current.model.effects) < 2 or len(steps) != len(current.model.effects):
        return problem, current
    wide = inflation(current.white)
    price = wide * float(np.log(current.samples))
    paid = current.chi2 + price * current.x.size - SWAP_GAIN * wide
    best: Trial | None = None
    for i, step in enumerate(steps):
        for rival in _near(step, wide):
            model = rival.fitted.model
            for j in range(len(model.effects) - 1):
                other = j if j < i else j + 1
                rest = fit_without(problem, rival.fitted, j)
                trial = best_among(problem, rest, _akin(steps[other], wide))
                if trial is None or trial.on_bound:
                    continue
                asked = trial.fitted.chi2 + price * trial.fitted.x.size
                if asked < paid:
                    best, paid = trial, asked
    if best is None:
        return problem, current
    exchange = _settled(best, problem, _paid(problem, current) - SWAP_GAIN, np.inf)
    if exchange is None:
        return problem, current
    say(f"{exchange[1].model.label} in place of {current.model.label}")
    return exchange


def _paid(problem: Problem, fitted: Fitted) -> float:
    """Cost of a fit in -2 log likelihood, its parameters paid."""
    return problem.cost(fitted) + float(np.log(fitted.samples)) * fitted.x.size


def _settled(
    trial: Trial, problem: Problem, limit: float, free: float
) -> tuple[Problem, Fitted] | None:
    """Settle a trial and remove what it makes idle; None where it costs or errs too much."""
    try:
        there, settled = settled_on(trial, problem.experiments)
    except NoObserver:
        return None
    kept = prune(there, settled)
    if against_physics(kept):
        return None
    if _paid(there, kept) > limit:
        return None
    runs = not np.isfinite(free) or free_run_error(there.experiments, there, kept) < free
    return (there, kept) if runs else None


def _near(step: Step, wide: float) -> list[Trial]:
    """The nearest rivals of the effect that a step took, that slopes lead to."""
    own = step.taken
    if own is None:
        return []
    near = [
        t
        for t in step.trials
        if t.label != own.label and t.experiments is None and own.gained - t.gained < NEAR * wide
    ]
    return sorted(near, key=lambda t: t.gained, reverse=True)[:RIVALS]


def _akin(step: Step, wide: float) -> set[str]:
    """Labels of what may stand for an effect: near rivals, what is simpler, what is richer."""
    if step.taken is None:
        return set()
    name, place = of_label(step.taken.label)
    found = {t.label for t in _near(step, wide)}
    akin = (*EFFECTS[name].contains, *(effect.name for effect in RICHER_FORMS[name]))
    found |= {label_of(other, place) for other in akin}
    return found - {step.taken.label}


def _extra(full: Fitted, part: Fitted) -> int:
    return max(1, full.x.size - part.x.size)


def _clearly(new: Trial, old: Trial, wide: float) -> bool:
    """Whether a swap pays: as simple and better, or simpler and within five sigma."""
    if new.parameters < old.parameters:
        return old.gained - new.gained < FIVE_SIGMA * wide
    more = FIVE_SIGMA * wide if new.parameters > old.parameters else SWAP_GAIN * wide
    return new.gained - new.price > old.gained - old.price + more

"""The result of a search, as later stages of the diagnosis use it.

If the family of noise models contains the truth, errors one sample ahead contain all information of
a recording, and the cheapest hypothesis is the answer. This is checked (`answer.adequacy`): free
runs of the answer must err no more than its noise predicts. If they err more, no hypothesis of the
family is true, and errors further ahead judge differently: filters, clocks and bristles show best
in the next sample, where the remainder of friction looks like noise of a slow colour. So the search
is repeated with noise that counts errors as far ahead as free runs go (`noise.family.as_far_as`),
and the two answers are compared by the errors of their free runs over every horizon, stretch by
stretch; the horizon with the clearest difference decides. A recording of half a second has too few
free runs to reject anything, and no error can be predicted for an answer whose simulated
repetitions run away; in these cases both searches are always made. If the chosen answer does not
explain held-out data, the other is compared with it there (`answer.stands`).
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from operator import is_

from zwidth.diagnosis.answer.adequacy import Adequacy, adequacy, freer, wandering
from zwidth.diagnosis.fitting.descend import fit
from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.mishaps import Say, attempt
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import as_far_as
from zwidth.diagnosis.noise.predictor import FINAL, Observer
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.seeking.lattice import with_rate
from zwidth.diagnosis.selection.effort import NORMAL, Effort
from zwidth.diagnosis.selection.hypothesis import Hypothesis, independent, judged, settled
from zwidth.diagnosis.selection.search import Moves, Search, from_afar, search, two_at_once
from zwidth.diagnosis.selection.slower import FAR_S
from zwidth.sim.device import Device

LEAST = 3  # of what was tried, that are fitted to see what chance leaves
NEXT = 3  # that are asked where held-out data speak against what is believed most
TELLING = 30  # free runs, of which fewer refuse nothing
NEXT_MOVES, AHEAD = Moves(), Moves(last=())  # steps and lost commands show in the next sample alone


@dataclass(frozen=True)
class Searched:
    """What a search found: the refit without physics, the final fit, and all that was tried.

    problem: the recordings with the noise of the best hypothesis; judge: the observer for held-out
    data, which is the answer's own likeliest one. held: whether its free runs err no more than its
    noise predicts on the fitted recordings. far: whether a longer horizon was tried. near: the
    answer by the next sample, if that did not decide. beside: the answer of the other of the two
    judges.
    """

    problem: Problem
    refit: Fitted
    final: Fitted
    tried: Search
    judge: Observer
    held: bool = False
    far: bool = False
    near: Hypothesis | None = None
    beside: "Searched | None" = None

    @property
    def interrupted(self) -> bool:
        """Whether the search was."""
        return self.tried.interrupted


class Searches:
    """The searches of one diagnosis: of the same recordings there is one, whoever asks for it.

    Events and learned laws are both sought in everything that was recorded, before either is known.
    """

    def __init__(self, search: Callable[[Sequence[Experiment]], Searched]) -> None:
        self._search = search
        self._made: list[tuple[tuple[Experiment, ...], Searched]] = []

    def __call__(self, experiments: Sequence[Experiment]) -> Searched:
        """Search recordings, or return what a search of just these found; as `searched` raises."""
        for those, found in self._made:
            if len(those) == len(experiments) and all(map(is_, those, experiments)):
                return found
        found = self._search(experiments)
        self._made.append((tuple(experiments), found))
        return found


def searched(
    device: Device,
    experiments: Sequence[Experiment],
    say: Say,
    effort: Effort = NORMAL,
    moves: Moves = NEXT_MOVES,
) -> Searched:
    """Search, and where no hypothesis that was found holds over free runs, search for what does.

    Raises NoObserver if no observer follows the recordings with the device.
    """
    near = search(device, experiments, effort, say, moves)
    first = as_found(device, near)
    sound = attempt("search", "how far ahead it holds", partial(holds, device, first))
    fails = sound is not None and not sound.sound
    if fails and not near.interrupted and from_afar(near):
        first = as_found(device, near)
        sound = attempt("search", "how far ahead it holds", partial(holds, device, first))
    if not near.interrupted and _strays(first) and two_at_once(near):
        first = as_found(device, near)
        sound = attempt("search", "how far ahead it holds", partial(holds, device, first))
    if near.interrupted:
        return first
    if sound is not None and sound.sound:
        first = replace(first, held=True)
        if sound.runs >= TELLING:
            return first
    return farther(device, first, say)


def farther(device: Device, found: Searched, say: Say) -> Searched:
    """Search for what shows over a longer horizon, and return the answer whose free runs err less.

    Laws that differ little in the next sample can differ much in where the motion ends: a link that
    hardens imitates play from sample to sample, and drifts over a cycle.
    """
    near = found.tried
    say("searching again by the prediction error over a longer horizon")
    far = attempt("search", "over a longer horizon", partial(_farther, device, near))
    if far is None:
        return replace(found, far=True)
    second = replace(as_found(device, far), far=True, near=near.best)
    first = replace(found, tried=replace(near, interrupted=far.interrupted), far=True)
    if runs_freer(second, first, near.best.experiments):
        say(f"better over a longer horizon: {far.best.model.label}")
        return replace(second, beside=first)
    return replace(first, beside=second)


def runs_freer(new: Searched, old: Searched, experiments: Sequence[Experiment]) -> bool:
    """Whether one answer runs free clearly better than another (`adequacy.freer`)."""
    return freer((new.final, new.judge), (old.final, old.judge), experiments)


def holds(device: Device, found: Searched) -> Adequacy | None:
    """How an answer stands on the recordings that it was fitted to."""
    experiments = found.problem.experiments
    return adequacy(Model(device), found.refit, found.final, found.judge, experiments)


def _strays(found: Searched) -> bool:
    """Whether free runs err far beyond the noise of readings, which only chance would explain."""
    asked = partial(wandering, found.final, found.judge, found.problem.experiments)
    return attempt("search", "how far free runs stray", asked) or False


def _farther(device: Device, near: Search) -> Search | None:
    """The search over a longer horizon; None where no observer looks so far."""
    least = looking_far(near)
    if least is None:
        return None
    with suppress(NoObserver):
        experiments, family = near.best.experiments, least.family
        far = search(device, experiments, near.effort, near.say, AHEAD, family, least)
        return replace(far, apart=near.apart)
    return None


def looking_far(near: Search) -> Hypothesis | None:
    """Return what leaves least over a longer horizon of all that was tried, under noise that does.

    None if none looks so far. Errors count as often as they are independent in that hypothesis
    alone: the remainder of missing physics is also dependent, and would be taken for chance.
    """
    ahead = as_far_as(FAR_S, near.best.experiments)
    told: list[Hypothesis] = []
    for h in near.tried.values():
        with suppress(NoObserver):
            told.append(judged(h.experiments, h.model, h.x, ahead))
    told.sort(key=lambda h: h.cost.misfit)
    ended = [settled(h) for h in told[:LEAST]]
    if not ended:
        return None
    least = min(ended, key=lambda h: h.cost.misfit)
    return independent(least, FAR_S)


def as_found(device: Device, found: Search) -> Searched:
    """Return refit and best hypothesis of a search under the noise of the best."""
    best = found.best
    problem = Problem(best.problem.experiments, best.noise.observer, FINAL)
    own = [
        v for v in found.plain.model.varying if v.declared
    ]  # of what changes, the refit knows none
    bare = Model(device, varying=tuple(own))
    baseline = fit(problem, bare, found.plain.x[: len(bare.parameters)])
    final = with_rate(problem, _final(problem, best))
    return Searched(problem, baseline, final, found, judge_of(best))


def judge_of(best: Hypothesis) -> Observer:
    """Return the likeliest observer of a hypothesis, whatever it was found under."""
    if best.family.whitening:
        return best.noise.observer
    try:
        return judged(best.experiments, best.model, best.x).noise.observer
    except NoObserver:
        return best.noise.observer


def next_believed(found: Searched) -> Iterator[Searched]:
    """Yield what else is believed over nothing, the cheapest first, where the best was refused.

    A hypothesis with all effects of the best and more is rejected with it.
    """
    search = found.tried
    refused, plain = search.best.labels, search.plain
    left = [
        h
        for h in search.tried.values()
        if h.model.effects and not refused <= h.labels and search.ahead(h, plain)
    ]
    for h in sorted(left, key=lambda h: h.cost.total)[:NEXT]:
        ended = attempt("search", h.model.label, partial(settled, h))
        if ended is not None and not ended.against_physics and search.ahead(ended, plain):
            answer = as_found(plain.model.nominal, replace(search, best=ended))
            yield replace(answer, far=found.far, beside=found.beside)


def unnamed(found: Searched) -> Searched:
    """Return a search as if nothing had been believed: the device file's own physics, refitted.

    With the noise of the next sample, whatever noise was used to find what is not believed.
    """
    plain = _by_the_next_sample(found.tried.plain)
    problem = Problem(plain.problem.experiments, plain.noise.observer, FINAL)
    refit = fit(problem, plain.model, plain.x)
    tried = replace(found.tried, plain=plain, best=plain)
    return Searched(
        problem, refit, refit, tried, judge_of(plain), far=found.far, beside=found.beside
    )


def _by_the_next_sample(h: Hypothesis) -> Hypothesis:
    if not h.family.whitening:
        with suppress(NoObserver):
            return settled(judged(h.experiments, h.model, h.x))
    return h


def _final(problem: Problem, h: Hypothesis) -> Fitted:
    """A hypothesis in fine substeps: fitted once more where it has no creases."""
    if not h.creased:
        return fit(problem, h.model, h.x)
    residual = problem.residual(h.model, h.x)
    assert h.slopes is not None
    chi2 = float(residual @ residual)
    return Fitted(h.model, h.x, chi2, residual, h.slopes, h.samples)

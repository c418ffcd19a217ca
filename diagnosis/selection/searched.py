"""The result of a search, as later stages of the diagnosis use it.

If the family of noise models contains the truth, errors one sample ahead contain all information of
a recording, and the cheapest hypothesis is the answer. This is checked (`answer.adequacy`): free
runs of the answer must err no more than its noise predicts. If they err more, no hypothesis of the
family is true, and errors further ahead judge differently: filters, clocks and bristles show best
in one-step errors, in which the remainder of friction looks like slow noise. So the search is
repeated with noise that counts errors as far ahead as free runs go (`noise.family.as_far_as`), and
the two answers are compared by the errors of their free runs over every horizon, stretch by
stretch; the horizon with the clearest difference decides. Both searches are always made if the
recordings have too few free runs to reject anything (half a second), or if the answer's simulated
repetitions run away. If the chosen answer does not explain held-out data, the other is compared
with it there (`answer.stands`).
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

from zwidth.diagnosis.account import spent
from zwidth.diagnosis.answer.adequacy import Adequacy, adequacy, freer
from zwidth.diagnosis.answer.straying import wandering
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
from zwidth.diagnosis.selection.search import (
    Moves,
    Search,
    from_afar,
    one_more,
    restart,
    search,
    searched_on,
    two_at_once,
)
from zwidth.diagnosis.selection.slower import FAR_S
from zwidth.diagnosis.settings import PURSUIT
from zwidth.sim.device import Device

LEAST = 3  # least number of hypotheses fitted over a longer horizon
NEXT = 3  # hypotheses tried after held-out data rejected the best
TELLING = 30  # free runs: fewer cannot reject an answer
NEXT_MOVES, AHEAD = Moves(), Moves(last=())  # steps and lost commands show only in one-step errors


@dataclass(frozen=True)
class Searched:
    """The result of a search: the refit without physics, the final fit, and all that was tried.

    problem: the recordings with the noise of the best hypothesis; judge: the most likely observer
    of the answer, for held-out data. held: whether free runs on the fitted recordings err no more
    than the noise predicts. far: whether a longer horizon was tried. near: the answer by one-step
    errors, if the longer horizon decided. beside: the answer over the other horizon. later: whether
    one more effect explains held-out data that look like an event.
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
    later: bool = False

    @property
    def interrupted(self) -> bool:
        """Whether the search was interrupted."""
        return self.tried.interrupted


class _Quiet:
    """Whether chance explains the free runs of the best of a search, asked once for each best."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._last: tuple[Hypothesis, Searched, Adequacy | None] | None = None

    def __reduce__(self) -> tuple[type, tuple[Device]]:
        """What was asked last is asked anew where a result is read from a file."""
        return _Quiet, (self._device,)

    def told(self, near: Search) -> tuple[Searched, Adequacy | None]:
        """The best as an answer, and its adequacy on the recordings that it was fitted to."""
        if self._last is None or self._last[0] is not near.best:
            found = as_found(self._device, near)
            asked = partial(holds, self._device, found)
            self._last = near.best, found, attempt("search", "how far ahead it holds", asked)
        return self._last[1:]

    def __call__(self, near: Search) -> bool:
        found, sound = self.told(near)
        return sound is not None and sound.sound and sound.runs >= TELLING and not _strays(found)


def searched(
    device: Device,
    experiments: Sequence[Experiment],
    say: Say,
    effort: Effort = NORMAL,
    moves: Moves = NEXT_MOVES,
) -> Searched:
    """Search by one-step errors and, if that answer fails in free runs, over a longer horizon.

    Raises NoObserver if no observer can follow the recordings with the device.
    """
    quiet = _Quiet(device)
    near = search(device, experiments, effort, say, replace(moves, quiet=quiet))
    first, sound = quiet.told(near)
    fails = sound is not None and not sound.sound
    if fails and not near.interrupted and from_afar(near):
        first, sound = quiet.told(near)
    asked = not near.interrupted and (_doubtful(near) or _strays(first))
    if asked and two_at_once(near):
        first, sound = quiet.told(near)
    if near.interrupted:
        return first
    if sound is not None and sound.sound:
        first = replace(first, held=True)
        if sound.runs >= TELLING:
            return first
    return farther(device, first, say)


def farther(device: Device, found: Searched, say: Say) -> Searched:
    """Search over a longer horizon too, and return the answer whose free runs err less.

    Laws with similar one-step errors can lead to very different motions: a link that hardens
    imitates play from sample to sample, and drifts over a cycle.
    """
    near = found.tried
    say("searching again, now minimising the prediction error over a longer horizon")
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
    """Whether free runs of one answer are clearly better (`adequacy.freer`)."""
    return freer((new.final, new.judge), (old.final, old.judge), experiments)


def holds(device: Device, found: Searched) -> Adequacy | None:
    """The adequacy of an answer on the recordings that it was fitted to."""
    experiments = found.problem.experiments
    return adequacy(Model(device), found.refit, found.final, found.judge, experiments)


def _doubtful(near: Search) -> bool:
    """Whether one more effect would cost less, though it is not believed: two may be missing.

    It must gain more than the best of as many effects gains by chance, 2 ln of their number.
    """
    best = near.best.cost
    more = [h.cost for h in near.tried.values() if one_more(h, near.best)]
    chance = 2.0 * math.log(max(1, len(more)))
    return any(c.total < best.total and best.misfit - c.misfit > chance for c in more)


def _strays(found: Searched) -> bool:
    """Whether free runs err far beyond the noise of readings, which only chance would explain."""
    asked = partial(wandering, found.final, found.judge, found.problem.experiments)
    return attempt("search", "how far free runs stray", asked) or False


def _farther(device: Device, near: Search) -> Search | None:
    """The search over a longer horizon; None if no observer is possible there."""
    least = looking_far(near)
    if least is None:
        return None
    with suppress(NoObserver):
        experiments, family = near.best.experiments, least.family
        ticks = sum(e.ticks for e in experiments)
        most = spent() + max(PURSUIT.farther * spent(), PURSUIT.at_least_farther * ticks)
        far = search(device, experiments, near.effort, near.say, AHEAD, family, least, most)
        return replace(far, apart=near.apart)
    return None


def looking_far(near: Search) -> Hypothesis | None:
    """Return the tried hypothesis with the least misfit over a longer horizon, with such noise.

    None if no observer is possible there. Only this hypothesis decides how often errors count
    (`independent`): errors of missing physics are dependent too, and would count as chance.
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
    ]  # the refit has none of the found changes
    bare = Model(device, varying=tuple(own))
    baseline = fit(problem, bare, found.plain.x[: len(bare.parameters)])
    final = with_rate(problem, _final(problem, best))
    return Searched(problem, baseline, final, found, judge_of(best))


def judge_of(best: Hypothesis) -> Observer:
    """Return the most likely one-step observer of a hypothesis, if possible."""
    if best.family.whitening:
        return best.noise.observer
    try:
        return judged(best.experiments, best.model, best.x).noise.observer
    except NoObserver:
        return best.noise.observer


def searched_through(found: Searched, experiments: Sequence[Experiment]) -> Searched:
    """Return the result of a search that continues on other recordings; may raise NoObserver."""
    tried = fitted_anew(found.tried, experiments)
    searched_on(tried)
    return replace(held(tried), far=found.far)


def fitted_anew(before: Search, experiments: Sequence[Experiment]) -> Search:
    """Return the search on other recordings, with its cheapest hypotheses fitted to them.

    Changes of parameters are left out, since they belong to the earlier recordings. Raises
    NoObserver if the refit without effects has none there.
    """
    every: list[Hypothesis] = []
    for h in before.tried.values():
        model, x = h.model.constant(h.x)
        with suppress(NoObserver):
            every.append(judged(experiments, model, x, h.family, None, h.prices))
    order = sorted(every, key=lambda h: h.cost.total)
    own = before.best.labels
    kept = {before.plain.labels, own, *(own - {label} for label in own)}
    near = [h for h in order if h.cost.total - order[0].cost.total < PURSUIT.hopeless]
    asked = [
        h for h in order if any(h is n for n in near[: before.effort.near]) or h.labels in kept
    ]
    fits = (attempt("candidates", h.model.label, partial(settled, h)) for h in asked)
    done = [h for h in fits if h is not None and not h.against_physics]
    plain = next((h for h in done if h.labels == before.plain.labels), None)
    if plain is None:
        raise NoObserver("the refit could not be fitted to the other recordings")
    found = begun_on(before, plain, plain)
    for h in sorted(done, key=lambda h: (len(h.model.effects), h.cost.total)):
        found.keep(h)
        if found.ahead(h, found.best):
            found.best = h
    return found


def begun_on(before: Search, plain: Hypothesis, best: Hypothesis) -> Search:
    """Return a search that so far has only these two hypotheses."""
    new = replace(before, tried={}, grown=set(), looked=set(), exchanged=set())
    restart(new, plain, best)
    new.on_bounds |= before.on_bounds
    return new


def held(tried: Search) -> Searched:
    """Return the answer of a search, and whether its free runs are adequate."""
    device = tried.plain.model.nominal
    found = as_found(device, tried)
    sound = attempt("search", "how far ahead it holds", partial(holds, device, found))
    return replace(found, held=sound is not None and sound.sound)


def next_believed(found: Searched) -> Iterator[Searched]:
    """Yield the cheapest hypotheses that are believed and lack an effect of the rejected best."""
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
    """Return the search with only the device file's own physics, refitted to one-step errors."""
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
    """A hypothesis in fine substeps, fitted once more if it has no creases."""
    if not h.creased:
        return fit(problem, h.model, h.x)
    residual = problem.residual(h.model, h.x)
    assert h.slopes is not None
    chi2 = float(residual @ residual)
    return Fitted(h.model, h.x, chi2, residual, h.slopes, h.samples)

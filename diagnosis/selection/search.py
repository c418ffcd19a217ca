"""The search: from the device file to the hypothesis that costs least.

    settle the linear parameters repeat: add the effect that is believed most (a beam, until nothing
    is believed) put simpler, other, fewer effects in place (until nothing costs less: the rivals)

`evidence` decides which effects are believed, `moves` which are tried, `Effort` how many. An effect
that only lowers one-step errors may not displace one that a longer horizon needs (`slower`): of the
believed effects, the one that explains more over that horizon is added first, and none that the
horizon needs is removed.
"""

import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.account import spent, stage
from zwidth.diagnosis.fitting.evolve import Generations, evolve
from zwidth.diagnosis.mishaps import Say, attempt, isolated, silent
from zwidth.diagnosis.model.own_values import first_x, varying
from zwidth.diagnosis.model.parameters import Model, effect_labels
from zwidth.diagnosis.noise.family import NEXT_SAMPLE, Family
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment, beginnings
from zwidth.diagnosis.selection.across import across
from zwidth.diagnosis.selection.effort import NORMAL, Effort
from zwidth.diagnosis.selection.evidence import believed
from zwidth.diagnosis.selection.hypothesis import (
    Hypothesis,
    against,
    judged,
    priced,
    settled,
)
from zwidth.diagnosis.selection.moves import (
    Begun,
    Move,
    Proposal,
    added,
    glanced,
    merged,
    nearest,
    removed,
    replaced,
    showing,
    shown,
    simpler,
    split,
    stepped,
    swapped,
)
from zwidth.diagnosis.selection.slower import Slower
from zwidth.diagnosis.settings import PURSUIT
from zwidth.jobs.parallel import in_parallel, threads
from zwidth.sim.device import Device
from zwidth.sim.place import Place, of_label

Floats = NDArray[np.float64]
Result = TypeVar("Result")
Apart = Callable[[Hypothesis], "Sequence[Experiment] | None"]
LADDER = (1.0, 1e-1, 1e-2, 1e-3, 1e-4)  # ratios under which populations grow
WORTH_SAYING = 2.0  # [s]: fits that take longer are announced
GROWN_TICKS = 10000  # of all recordings together, to which populations are fitted
AGAIN, STILL = 6, 10.0  # most turns about the best; gain in misfit that justifies another
MOST_APART, LEAST_LEFT = 8, 0.5  # parts set apart in turn; least share of ticks left to search
MOST_ASKED = 20  # effects of each view that may explain an apparent event
FAR_SPREAD, NEAR_SPREADS = 0.5, (0.3, 0.1)  # in x; 1 is the uncertainty of a device file


@dataclass(frozen=True)
class Moves:
    """The moves of a search: to add an effect, to replace a hypothesis, to replace an effect.

    glancing: moves to add, tried first; last: tried once nothing else is believed. apart: returns
    the recordings of a hypothesis without an apparent event, None if there is none. quiet: whether
    chance explains the free runs of the best; then nothing is left that only a longer horizon
    shows, and `near` is tried in place of `adding`.
    """

    adding: Sequence[Move] = (added,)
    last: Sequence[Move] = (stepped,)
    glancing: Sequence[Move] = (glanced,)
    exchanging: Sequence[Move] = (removed, simpler, split, merged, swapped)
    replacing: Callable[[int], Move] = replaced
    apart: Apart | None = None
    quiet: "Callable[[Search], bool] | None" = None
    near: Sequence[Move] = (nearest,)


@dataclass
class Search:
    """The state of a search: the cheapest fit of each structure that was tried.

    plain: without physics; best: the cheapest believed hypothesis. on_bounds: fits that ended at
    unphysical values: not answers, but a richer law among them is a rival of the law that it
    contains. clear: whether every clear sign led to a believed effect. apart: how often a part of
    the recordings was set apart because of an event; recorded: number of ticks before that. slower:
    the judge of a longer horizon, None if this search uses it already. most: member-ticks of the
    account from which nothing more is fitted.
    """

    plain: Hypothesis
    best: Hypothesis
    effort: Effort
    say: Say
    moves: Moves = Moves()
    tried: dict[frozenset[str], Hypothesis] = field(default_factory=dict)
    on_bounds: dict[frozenset[str], Hypothesis] = field(default_factory=dict)
    grown: set[frozenset[str]] = field(default_factory=set)
    looked: set[frozenset[str]] = field(default_factory=set)
    exchanged: set[frozenset[str]] = field(default_factory=set)
    slower: Slower | None = None
    clear: bool = True
    apart: int = 0
    recorded: int = 0
    fits: int = 0
    spent: float = 0.0
    interrupted: bool = False
    most: float = math.inf

    def keep(self, h: Hypothesis) -> Hypothesis:
        """Keep a hypothesis unless a cheaper one of its structure is known; return the cheaper."""
        return _cheaper(self.tried, h)

    def sound(self, fitted: Iterable[Hypothesis]) -> list[Hypothesis]:
        """Keep fitted hypotheses; return the physical ones."""
        every = list(fitted)
        for h in every:
            if h.against_physics:
                _cheaper(self.on_bounds, h)
        return [self.keep(h) for h in every if not h.against_physics]

    def ahead(self, new: Hypothesis, old: Hypothesis) -> bool:
        """Whether a hypothesis is believed over another, or costs less with no more effects."""
        if len(new.model.effects) <= len(old.model.effects):
            return new.cost.total < old.cost.total
        return believed(new.cost, old.cost, against(new, old).phi)

    def needs(self, old: Hypothesis, new: Hypothesis) -> bool:
        """Whether a longer horizon clearly prefers the old hypothesis to the new one."""
        return self.slower is not None and self.slower.prefers(old, new)


class Enough(Exception):
    """A search has taken as many simulations as it may; what it found so far is kept."""


def _cheaper(kept: dict[frozenset[str], Hypothesis], h: Hypothesis) -> Hypothesis:
    known = kept.get(h.labels)
    if known is None or h.cost.total < known.cost.total:
        kept[h.labels] = h
    return kept[h.labels]


def search(
    device: Device,
    experiments: Sequence[Experiment],
    effort: Effort = NORMAL,
    say: Say = silent,
    moves: Moves = Moves(),
    family: Family = NEXT_SAMPLE,
    begun: Hypothesis | None = None,
    most: float = math.inf,
) -> Search:
    """Search for effects that explain recordings; raises NoObserver if no observer is possible.

    family: the noise models with which all hypotheses are compared. begun: a hypothesis of another
    search, from which this one continues if it is believed. most: as in `Search`.
    """
    model = Model(device, varying=varying(device, experiments))
    with stage("refit"):
        first = judged(experiments, model, first_x(model, experiments), family)
        plain = across(settled(first))
    ticks = sum(e.ticks for e in experiments)
    slower = Slower(plain) if family.whitening else None
    found = Search(plain, plain, effort, say, moves, slower=slower, recorded=ticks, most=most)
    found.keep(plain)
    if begun is not None and begun.model.effects:
        known = attempt("search", begun.model.label, partial(settled, begun))
        if known is not None and not known.against_physics and found.ahead(known, plain):
            found.best = found.keep(known)
    say("linear parameters refitted; now trying every effect")
    _until_nothing_gains(found, _rounds)
    if found.best is found.plain:
        with stage("refit"):
            found.plain = found.best = found.keep(settled(plain, to_the_end=True))
    return found


def from_afar(found: Search) -> bool:
    """Search for the valley of the best again; if another costs less, continue from there.

    Returns whether one does. Friction, a dead band and a force that repeats with position together
    have enough creases to trap a fit, though none of them alone does.
    """
    before = found.best

    def look(found: Search) -> None:
        look_for_valleys(found)
        if found.best is not before:
            _rounds(found)

    _until_nothing_gains(found, look)
    return found.best is not before


def two_at_once(found: Search) -> bool:
    """Add two effects to the best, since neither is believed alone; returns whether both are.

    If several laws act together, each alone explains little while the others count as noise.
    """
    before = found.best

    def look(found: Search) -> None:
        alone = [h for h in found.tried.values() if one_more(h, before)]
        begun = sorted(alone, key=lambda h: h.cost.total)[: found.effort.beside]
        if not begun or len(before.model.effects) + 2 > found.effort.effects:
            return
        found.say("trying two more effects together")
        proposals = [
            p
            for h in begun
            for move in found.moves.adding
            for p in _proposed(move, h, found.effort)
        ]
        for h in fitted(found, proposals, found.effort.ended):
            if found.ahead(h, before):
                found.best = h
                found.say(f"accepted: {h.model.label}")
                _rounds(found)
                return

    _until_nothing_gains(found, look)
    return found.best is not before


def one_more(h: Hypothesis, than: Hypothesis) -> bool:
    """Whether a hypothesis has all effects of another, and one more."""
    return than.labels < h.labels and len(h.labels) == len(than.labels) + 1


def _until_nothing_gains(found: Search, work: Callable[[Search], None]) -> None:
    """Work to the end, an error or an interruption; results so far are kept."""
    try:
        with isolated("search", "a further effect"):
            try:
                work(found)
            except Enough:
                found.say(
                    "this search reached its limit of simulations: continuing with its best result"
                )
    except KeyboardInterrupt:
        found.say("interrupted: judging the result so far; press Ctrl-C again to quit")
        found.interrupted = True


def _rounds(found: Search) -> None:
    for _ in range(found.effort.rounds):
        before = found.best
        with stage("adding effects"):
            _grown(found)
        with stage("trying others in their place"):
            _exchanged(found)
        if found.best is before:
            break
    _ended(found)


def _ended(found: Search) -> None:
    """Fit near rivals until they converge: they had two rounds of fitting, the best had many.

    A rival with no more effects that then costs less becomes the best, and so does one without an
    effect that is no longer believed over its absence.
    """
    best = found.best
    near = [
        h
        for h in found.tried.values()
        if h is not best and not h.ended and h.cost.total - best.cost.total < PURSUIT.near_rival
    ]
    if not near:
        return
    found.say("fitting the closest rivals until they converge")
    with stage("ending rivals"):
        fits = [(h.model.label, partial(settled, h, to_the_end=True)) for h in near]
        again = _each("candidates", fits)
    for h in again:
        if h.against_physics:  # not an answer, even if it was one before
            found.tried.pop(h.labels, None)
    kept = found.sound(again)
    simple = [h for h in kept if len(h.model.effects) <= len(best.model.effects)]
    idle = [h for h in kept if h.labels < best.labels and not _worth(best, h)]  # as in _exchanged
    least = min(idle or simple, key=lambda h: h.cost.total, default=best)
    if (idle or found.ahead(least, best)) and not found.needs(best, least):
        found.best = least
        _exchanged(found)  # find its own rivals


def _grown(found: Search) -> None:
    """Add effects while one is believed."""
    beam = [found.best]
    while len(found.best.model.effects) < found.effort.effects:
        if found.best.labels in found.grown:
            return
        found.grown.add(found.best.labels)
        found.say("trying one more effect")
        before, accepted = found.best, _believed_beside(found, beam)
        if _set_apart(found, before, accepted):
            beam = [found.best]
            continue
        if not accepted:
            found.say("no further effect accepted")
            return
        found.best, beam = accepted[0], accepted[: found.effort.beam]
        found.say(f"accepted: {found.best.model.label}")
        _leave_out(found)
        beam = [found.best, *(h for h in beam if h.labels != found.best.labels)]


def _leave_out(found: Search) -> None:
    """Leave out effects that the best no longer needs even if the others are not refitted.

    A friction that imitated play has no size once the play is included.
    """
    while len(found.best.model.effects) > 1:
        h = found.best
        some = [h.less(i) for i in range(len(h.model.effects))]
        # Without the penalty of their parameters, which is only computed where it decides.
        cheap = [n for n in some if n is not None and not _worth(h, n)]
        idle = [n for n in map(priced, cheap) if not (_worth(h, n) or found.needs(h, n))]
        if not idle:
            return
        found.best = found.keep(settled(min(idle, key=lambda n: n.cost.total), turns=2))
        found.say(f"no longer needed: {', '.join(h.labels - found.best.labels)}")


def _set_apart(found: Search, before: Hypothesis, accepted: Sequence[Hypothesis]) -> bool:
    """Set an event apart if it explains more than the next effect; returns whether it did.

    A hand on the device distorts every fit, and effects that explain part of it are believed one
    after the other. An event must gain more than the next effect, and must remain with each of the
    effects that are believed: an amplifier that reaches its limit once or twice looks like a hand.
    The gain is the cost of the recordings minus their cost with ordinary noise in place of the
    event, at the cost per sample of the rest.
    """
    if found.moves.apart is None or found.apart >= MOST_APART:
        return False
    stands_apart = found.moves.apart

    def without_event(h: Hypothesis) -> Sequence[Experiment] | None:
        return attempt("events", "what stands apart", partial(stands_apart, h))

    def gone(h: Hypothesis) -> bool:
        return without_event(h) is None

    left = without_event(found.best)
    if left is None or sum(e.ticks for e in left) < LEAST_LEFT * found.recorded:
        return False
    gained = before.cost.misfit - accepted[0].cost.misfit if accepted else 0.0
    if any(gone(h) for h in accepted):
        return False

    def again(h: Hypothesis) -> Hypothesis:
        return settled(judged(left, h.model, h.x, h.family, None, h.prices))

    with suppress(NoObserver):
        before, best = found.best, again(found.best)
        explained = before.cost.misfit - best.cost.misfit * before.samples / best.samples
        if not explained > max(gained, PURSUIT.near_rival):
            return False
        least = PURSUIT.rival_share * explained
        named = _tick_by_tick(found, explained) or explaining(found, least, gone)
        if named is not None:
            found.best = named
            found.say(f"accepted: {named.model.label}")
            return True
        found.say("one-time event found: continuing without that part of the recording")
        restart(found, best if before is found.plain else again(found.plain), best)
        found.apart += 1
        return True
    return False


def _tick_by_tick(found: Search, explained: float) -> Hypothesis | None:
    """The best with an effect that is sought tick by tick, if it explains more than an event.

    A lost command acts like a hit of one sample, and a few would be set apart one after the other.
    """
    asked = [p for move in found.moves.last for p in _proposed(move, found.best, found.effort)]
    least = found.best.cost.misfit - explained
    new = [h for h in fitted(found, asked, found.effort.ended) if h.cost.misfit < least]
    return next((h for h in new if found.ahead(h, found.best)), None)


def explaining(
    found: Search, least: float, gone: Callable[[Hypothesis], bool]
) -> Hypothesis | None:
    """The best with one more effect that is believed and explains an apparent event, None if none.

    least: what the effect must gain to first order. gone: whether the event has disappeared. All
    such effects are fitted to the end, not only the likeliest: friction that acts all the time
    gains more than a limit that is reached twice, and leaves the event as it is.
    """
    every = replace(found.effort, near=MOST_ASKED, far=MOST_ASKED)
    asked = _proposed(showing(least), found.best, every)
    new = fitted(found, asked, len(asked))
    return next((h for h in new if found.ahead(h, found.best) and gone(h)), None)


def restart(found: Search, plain: Hypothesis, best: Hypothesis) -> None:
    """Continue with other recordings, without earlier costs, which cannot be compared."""
    found.plain, found.best, found.tried, found.on_bounds = plain, best, {}, {}
    found.slower = None if found.slower is None else Slower(plain)
    for done in (found.grown, found.looked, found.exchanged):
        done.clear()
    for h in (plain, best):
        found.keep(h)


def searched_on(found: Search) -> None:
    """Continue from the best, after `restart` with corrected recordings."""
    _until_nothing_gains(found, _rounds)


def _believed_beside(found: Search, beam: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Hypotheses with one more effect that are believed over the best, the cheapest first.

    First tries effects that are clear in the first part of the recordings, then all effects, and
    once nothing else is believed, effects that are sought tick by tick.
    """
    moves = found.moves
    for asked in (moves.glancing if found.clear else (), moves.adding, moves.last):
        if asked is moves.adding and moves.quiet is not None and moves.quiet(found):
            asked = moves.near
        proposals = [p for h in beam for move in asked for p in _proposed(move, h, found.effort)]
        new = fitted(found, proposals, found.effort.ended)
        if not new:
            found.clear = found.clear and asked is not moves.glancing
            continue
        count = f"{len(proposals)} candidate{'s' if len(proposals) > 1 else ''} tried"
        found.say(f"{count}; largest improvement: {new[0].model.label}")
        accepted = [h for h in new if found.ahead(h, found.best)]
        if accepted and accepted[0] is not new[0]:
            found.say("this improvement is not significant; another one is")
        if len(accepted) > 1 and found.slower is not None:
            first, accepted = accepted[0], found.slower.first(accepted)
            if accepted[0] is not first:
                found.say(f"better over a longer horizon: {accepted[0].model.label}")
        if accepted and found.best.has_valleys:
            accepted = _ahead_from_there(found, accepted)
        if not accepted and asked in (moves.adding, moves.near):
            accepted = _in_place_of(found, new[0])
        if accepted:
            return accepted
        found.clear = False
    return []


def _ahead_from_there(found: Search, new: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The hypotheses believed over the best, also if this is fitted from where the first ended.

    With play a fit ends in one of many local minima. On a rig with four effects it ended 109 in -2
    ln above the minimum that a fit with a fifth, spurious effect reached, which "gained" 96. And
    such motion is chaotic: under an observer that hardly corrects, a spurious mass of half a
    milligram gained 273, and lost 13 000 with another number of substeps, while true effects of two
    rigs lose less than 10. So an effect must also be believed with the finer substeps.
    """
    best, first = found.best, new[0]
    gone = [i for i, n in enumerate(effect_labels(first.model.effects)) if n not in best.labels]
    model, x = first.model.less(first.x, *gone)
    if frozenset(effect_labels(model.effects)) == best.labels:
        near = best.family.near(first.ratio)
        with suppress(NoObserver):
            begun = judged(
                best.experiments, model, x, best.family, near, best.prices, first.noise.motions
            )
            again = found.keep(settled(begun, turns=2))
            if again.cost.total < best.cost.total:
                found.best = again
    best = found.best.in_finer_steps()
    return [h for h in new if found.ahead(h, found.best) and found.ahead(h.in_finer_steps(), best)]


def _in_place_of(found: Search, doubtful: Hypothesis) -> list[Hypothesis]:
    """Hypotheses believed over the best, with another effect in place of one that gains too little.

    A ripple that hardly gains may imitate gravity whose own fit ended in another valley.
    """
    more = [
        i
        for i, label in enumerate(effect_labels(doubtful.model.effects))
        if label not in found.best.labels
    ]
    beyond = found.best.labels < doubtful.labels and len(more) == 1  # not all of a beam
    if not beyond or not doubtful.cost.total < found.best.cost.total:
        return []
    (index,) = more
    found.say("trying other effects in place of the one added last")
    others = _proposed(found.moves.replacing(index), doubtful, found.effort)
    return [h for h in fitted(found, others, found.effort.beside) if found.ahead(h, found.best)]


def _exchanged(found: Search) -> None:
    """Try simpler, other and fewer effects while that costs less.

    An alternative becomes the rival of an effect that stays. As soon as one costs less, the search
    continues from there.
    """
    left: set[frozenset[str]] = set()  # left for cheaper ones before all their moves
    for _ in range(4 * found.effort.effects):
        h = found.best
        if not h.model.effects or h.labels in found.exchanged:
            return
        found.say("trying other effects in place of each one found")
        left.add(h.labels)
        less: list[Hypothesis] = []
        for some in _instead(found):
            # An effect must be believed over its absence, not only cost less.
            idle = [n for n in some if n.labels < h.labels and not _worth(h, n)]
            idle = [n for n in idle if not found.needs(h, n)]
            less += [n for n in some if n.cost.total < h.cost.total and not found.needs(h, n)]
            better = idle or [n for n in less if n.labels not in found.exchanged | left]
            if better:
                found.best = min(better, key=lambda n: n.cost.total)
                found.say(f"better: {found.best.model.label}")
                break
        else:  # no alternative costs less, or it was tried before
            found.exchanged.add(h.labels)
            found.best = min([h, *less], key=lambda n: n.cost.total)


def _instead(found: Search) -> Iterator[list[Hypothesis]]:
    """Yield fitted alternatives to the best, move by move; each move is fitted on demand.

    The effect that explains least is replaced first, since it most often stands for another one.
    """
    h, effort = found.best, found.effort
    many = max(effort.ended, len(h.model.effects))
    new: list[Hypothesis] = []
    for move in found.moves.exchanging:
        some = _tried(found, move, many)
        new += some
        yield some
    without = {next(iter(h.labels - n.labels)): n.cost.total for n in new if n.labels < h.labels}
    labels = effect_labels(h.model.effects)
    for i in sorted(range(len(labels)), key=lambda i: without.get(labels[i], math.inf)):
        yield _tried(found, found.moves.replacing(i), effort.beside)
    if effort.generations:  # so that replacements are compared in their best valleys
        less = [
            n
            for n in new
            if n.has_valleys
            and len(n.model.effects) == len(h.model.effects)
            and n.cost.total - h.cost.total < PURSUIT.hopeless
        ]
        grown = [n for n in (_grown_on(found, [one]) for one in less) if n is not None]
        new += grown
        yield grown
    yield _unfolded(found, h, new)


def _unfolded(found: Search, h: Hypothesis, new: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The cheapest alternative with a simpler law in place of a richer one, with one more effect.

    A law with more parameters replaces two that act together as soon as it explains more than one
    of them alone: friction that falls with speed replaces dry friction beside a drag. And two laws
    together may imitate one beside which there is another. Only the cheapest alternative is tried,
    since each requires all moves.
    """
    asked = [
        n
        for n in new
        if len(n.model.effects) <= min(len(h.model.effects), found.effort.effects - 1)
        and not n.labels < h.labels
        and n.x.size < h.x.size
        and n.labels not in found.grown
    ]
    if not asked:
        return []
    likeliest = min(asked, key=lambda n: n.cost.total)
    found.grown.add(likeliest.labels)
    return fitted(found, _proposed(shown, likeliest, found.effort), found.effort.ended)


def _worth(more: Hypothesis, less: Hypothesis) -> bool:
    return believed(more.cost, less.cost, against(more, less).phi)


def look_for_valleys(found: Search) -> None:
    """Let populations evolve from the best hypothesis and from the device file.

    They evolve under each ratio of a ladder, since what the best hypothesis leaves unexplained
    counts as noise and makes its own ratio too large. The cheapest result, each with its own noise,
    continues.
    """
    h, effort = found.best, found.effort
    if not h.creased or effort.generations == 0 or h.labels in found.looked:
        return
    found.looked.add(h.labels)
    found.say(f"fitting {h.model.label} again from other starting values")
    prior = np.array([p.prior for p in h.model.parameters])
    starts = [h.x, np.where(prior, 0.0, h.x)]
    ladder = LADDER if h.family.whitening else (h.ratio,)
    first = _arrived(h, effort, [(ratio, starts, FAR_SPREAD) for ratio in ladder])
    new = _grown_on(found, [h, *first])
    if new is not None and new.cost.total < h.cost.total:
        found.best = new
        for done in (found.grown, found.exchanged):  # in another valley other effects may gain
            done.discard(new.labels)


def _grown_on(found: Search, begun: Sequence[Hypothesis]) -> Hypothesis | None:
    """Let populations evolve about the best of some hypotheses of one structure while that gains.

    A result is fitted to the end before it is compared with the best, since a population ends
    beside the bottom of a valley. Returns the best, None if it is not physical.
    """
    effort = found.effort
    best = min(begun, key=lambda a: a.cost.misfit)
    best = attempt("a population", best.model.label, partial(settled, best)) or best
    for _ in range(AGAIN):
        legs = [(best.ratio, [best.x], spread) for spread in NEAR_SPREADS]
        near = _arrived(best, effort, legs)[:1]
        ended = _each("a population", [(a.model.label, partial(settled, a)) for a in near])
        gained = best.cost.misfit - ended[0].cost.misfit if ended else 0.0
        best = ended[0] if gained > 0.0 else best
        if gained < STILL:
            break
    return None if best.against_physics else found.keep(best)


def _arrived(
    h: Hypothesis, effort: Effort, legs: Sequence[tuple[float, Sequence[Floats], float]]
) -> list[Hypothesis]:
    """Results of populations from legs (ratio, xs, spread), each with its own noise, best first."""
    stretch = beginnings(h.experiments, GROWN_TICKS)

    def grown(ratio: float, xs: Sequence[Floats], spread: float) -> list[Hypothesis]:
        plan = Generations(effort.members, effort.generations, spread)
        arrived: list[Hypothesis] = []
        for a in evolve(stretch, h.model, xs, ratio, plan):
            with suppress(NoObserver):
                arrived.append(h.anew(a.x))
        return arrived

    asked = [(h.model.label, partial(grown, *leg)) for leg in legs]
    every = [a for arrived in _each("a population", asked) for a in arrived]
    return sorted(every, key=lambda a: a.cost.misfit)


def _proposed(move: Move, h: Hypothesis, effort: Effort) -> list[Proposal]:
    return attempt("search", move.__name__, lambda: list(move(h, effort))) or []


def _tried(found: Search, move: Move, ended: int) -> list[Hypothesis]:
    return fitted(found, _proposed(move, found.best, found.effort), ended)


def fitted(found: Search, proposals: Iterable[Proposal], ended: int) -> list[Hypothesis]:
    """Fit proposals, `ended` of them to the end; return these, the cheapest first.

    Costs under one observer can be compared, so the cheapest first fits of each view continue;
    their own noise then decides which are fitted to the end. A fit that ends at unphysical values
    is not an answer (`Search.on_bounds`).
    """
    if spent() > found.most:
        raise Enough
    asked, begun_at = list(proposals), time.monotonic()
    if found.fits and asked:
        expected = found.spent / found.fits * len(asked)
        if expected >= WORTH_SAYING:
            found.say(f"fitting {len(asked)} candidates, about {expected:.0f} s")
    views: dict[int, list[Begun]] = {}
    for start in _each("candidates", [(p.label, p.begun) for p in asked]):
        views.setdefault(id(start.proposal.under), []).append(start)
    promising: list[Begun] = []
    for group in views.values():
        order = sorted(group, key=lambda b: b.cost)
        count = max(ended, found.effort.judged)
        promising += [
            b
            for i, b in enumerate(order)
            if (i < count and b.cost - order[0].cost < PURSUIT.hopeless) or b.proposal.akin
        ]
    begun: dict[frozenset[str], Hypothesis] = {}
    first = [(b.proposal.label, partial(_judged, b)) for b in promising]
    for h in _each("candidates", first):
        known = begun.get(h.labels)
        if known is None or h.cost.total < known.cost.total:
            begun[h.labels] = h
    akin = {b.proposal.labels for b in promising if b.proposal.akin}
    order = sorted(begun.values(), key=lambda h: h.cost.total)
    finished = _to_their_end(found, order, ended, akin)
    found.fits += len(asked)
    found.spent += time.monotonic() - begun_at
    return sorted(finished, key=lambda h: h.cost.total)


def _to_their_end(
    found: Search, order: Sequence[Hypothesis], ended: int, akin: set[frozenset[str]]
) -> list[Hypothesis]:
    """Fit the most likely hypotheses to the end, the next ones if none ends at physical values."""
    near = [h for h in order if _comes_near(found, h, h.labels in akin)]
    finished: list[Hypothesis] = []
    if order and not near:  # a distant rival is reported without a fit
        finished = _stands(found, [(h.model.label, partial(priced, h)) for h in order[:1]])
    while near and not finished:
        likely = _likely(near, ended, akin)
        chosen = {h.labels for h in likely}
        if found.slower is not None:
            more = [h for h in order if h.labels > found.best.labels and h.labels not in chosen]
            likely += found.slower.ahead_of(likely, more)
        finished = _stands(found, [(h.model.label, partial(settled, h, turns=2)) for h in likely])
        near = [
            h
            for h in near
            if h.labels not in chosen and h.cost.total - order[0].cost.total < PURSUIT.hopeless
        ]
    return finished


def _stands(
    found: Search, fits: Sequence[tuple[str, Callable[[], Hypothesis]]]
) -> list[Hypothesis]:
    return found.sound(_each("candidates", fits))


def _comes_near(found: Search, h: Hypothesis, akin: bool) -> bool:
    """Whether a complete fit may bring a hypothesis near the best one.

    Not if its cost is higher by a large share of everything that the best explains
    (`PURSUIT.lagging`), unless its effects contain those of the best, are contained in them, or are
    other forms of the same laws at the same places: such a fit lags behind because it has not
    ended. (Friction that rises with speed beside a constant force lagged 0.43 behind friction by
    direction on one part of a recording, more on others, and ended ahead of it by 0.23.)
    """
    best = found.best
    if h.labels > best.labels or h.labels < best.labels:
        return True
    if akin and _places(h.labels - best.labels) == _places(best.labels - h.labels):
        return True
    explained = max(found.plain.cost.misfit - best.cost.misfit, 0.0)
    lags = h.cost.misfit - best.cost.misfit
    return lags < max(PURSUIT.hopeless, PURSUIT.lagging * explained)


def _places(labels: frozenset[str]) -> set[Place]:
    return {of_label(label)[1].acts_on for label in labels}


def _likely(begun: Sequence[Hypothesis], ended: int, akin: set[frozenset[str]]) -> list[Hypothesis]:
    """The hypotheses to fit to the end: the cheapest of `ended` different laws, and the akin ones.

    A law may be kept at several places, since the right place shows only in a complete fit.
    """
    order = sorted(begun, key=lambda h: h.cost.total)
    found: list[Hypothesis] = []
    for h in order:
        laws = {_laws(other) for other in found}
        more = len(laws) < ended and len(found) < Effort.most_ended * ended
        near = h.cost.total - order[0].cost.total < PURSUIT.hopeless
        if near and (more or h.labels in akin):
            found.append(h)
    return found


def _laws(h: Hypothesis) -> tuple[str, ...]:
    return tuple(sorted(p.effect.name for p in h.model.effects))


def _each(stage: str, tasks: Sequence[tuple[str, Callable[[], Result | None]]]) -> list[Result]:
    """Results of labelled tasks, run in parallel, without those that failed or returned None."""
    asked = [partial(attempt, stage, label, task) for label, task in tasks]
    return [one for one in in_parallel(asked, threads()) if one is not None]


def _judged(begun: Begun) -> Hypothesis | None:
    try:
        return begun.proposal.judged(begun.x)
    except NoObserver:
        return None

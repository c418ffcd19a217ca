"""Moves: neighbours of a hypothesis that are worth a fit; the cost then decides between them."""

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.descend import creased, descend
from zwidth.diagnosis.fitting.fit import Problem
from zwidth.diagnosis.fitting.landscape import Landscape
from zwidth.diagnosis.model.parameters import Model, effect_labels
from zwidth.diagnosis.noise.family import SLOWER, Family, Motions, blind
from zwidth.diagnosis.noise.gaps import with_play
from zwidth.diagnosis.noise.predictor import SCREENING, SETTLING
from zwidth.diagnosis.noise.settle import prepared_for
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment, beginnings
from zwidth.diagnosis.seeking.candidates import Start
from zwidth.diagnosis.seeking.lattice import stepped_trials
from zwidth.diagnosis.seeking.places import open_places, starts_at
from zwidth.diagnosis.seeking.playing import arrivals, scanned
from zwidth.diagnosis.seeking.screen import Screened
from zwidth.diagnosis.seeking.screening import View, screened, shown_starts, view
from zwidth.diagnosis.seeking.sizes import sizes_of
from zwidth.diagnosis.selection.effort import Effort
from zwidth.diagnosis.selection.hypothesis import Hypothesis, Prices, judged, settled
from zwidth.diagnosis.settings import PURSUIT
from zwidth.jobs.parallel import in_parallel, threads
from zwidth.sim.device import place_label
from zwidth.sim.physics import richer_at
from zwidth.sim.physics.effect import Effect, Physics
from zwidth.sim.place import label_of

Floats = NDArray[np.float64]
SLOWEST = 1e-6  # ratio of an observer that hardly corrects the model
NO_SIGN = PURSUIT.no_sign
SCANNED_TICKS = 3000  # of all recordings together, in scans of play and their populations
TELLING_TICKS = 10 * SETTLING  # least ticks of a recording by which starts are ranked
FAR_TICKS = 6000  # of all recordings together, in far views: enough to show strong effects
BENT = 0.05  # in x: a fit that moved farther is also viewed at its device file
GIVEN_WAY = 2.0  # in x: the most that parameters adapt before a fit


@dataclass(frozen=True)
class Proposal:
    """A model worth a fit, and its start: x, and the problem of the first fit.

    under: the problem of the first fit, None if the proposal needs no such fit. family: of the
    noise; near: ratio about which the noise is sought, None for the whole family. prices: as in
    `Hypothesis`. akin: whether only the place of an effect differs from the original hypothesis, or
    the law is a simpler or a richer one of its kind. motions: those of the original, with play.
    """

    experiments: Sequence[Experiment]
    model: Model
    x: Floats
    family: Family
    under: Problem | None = None
    near: float | None = None
    prices: Prices = ()
    akin: bool = False
    motions: Motions = None

    def judged(self, x: Floats) -> Hypothesis:
        """Return the hypothesis at x with its most likely noise; may raise NoObserver.

        A first fit with the noise of a view is continued with the hypothesis's own noise; otherwise
        it would cost more than a fit that started with its own.
        """
        among = None if self.near is None else self.family.near(self.near)
        h = judged(self.experiments, self.model, x, self.family, among, self.prices, self.motions)
        if among is not None or self.under is None:
            return h
        return _on_its_way(h, Effort.own_rounds)

    @property
    def label(self) -> str:
        """The effects, as text."""
        return self.model.label

    @property
    def labels(self) -> frozenset[str]:
        """effect@place of each effect."""
        return frozenset(effect_labels(self.model.effects))

    def begun(self) -> "Begun":
        """Return the result of a first fit to the problem `under`."""
        if self.under is None:
            return Begun(self, self.x, 0.0)
        ground = Landscape(self.under.experiments, self.under.observer, self.model, SCREENING)
        rounds = (2 if with_play(self.model.effects) else 1) * Effort.first_rounds
        first = descend(ground, self.x, rounds, creased(self.model), first=True)
        return Begun(self, first.x, first.cost)


@dataclass(frozen=True)
class Begun:
    """A proposal after its first fit: x, and its cost with the observer of that fit."""

    proposal: Proposal
    x: Floats
    cost: float


def _on_its_way(h: Hypothesis, rounds: int) -> Hypothesis:
    moved = h.moved(descend(h.far_ground, h.x, rounds, h.creased, first=True).x)
    return moved if moved.cost.misfit < h.cost.misfit else h


Starts = Mapping[str, list[Start]]
Move = Callable[[Hypothesis, Effort], Iterator[Proposal]]


def glanced(h: Hypothesis, effort: Effort) -> Iterator[Proposal]:
    """Yield the hypothesis with one more effect clear in the first part of long recordings."""
    if (ticks := _glance(h.experiments)) is not None:
        views = itertools.chain(_views(h, ticks), _views_afar(h, ticks))
        yield from _more(h, effort, views, PURSUIT.clear_sign)


def _glance(experiments: Sequence[Experiment]) -> int | None:
    """Ticks of all recordings that suffice for strong effects, None if the cut saves too little."""
    ticks = max(PURSUIT.glance, TELLING_TICKS * len(experiments))
    return ticks if sum(e.ticks for e in experiments) >= PURSUIT.worth_a_glance * ticks else None


def _cut(problem: Problem, ticks: int | None) -> Problem:
    """The first ticks of the recordings of a problem, None for all."""
    if ticks is None:
        return problem
    return Problem(beginnings(problem.experiments, ticks), problem.observer)


def added(h: Hypothesis, effort: Effort) -> Iterator[Proposal]:
    """Yield the hypothesis with one more effect that stands out in any of its views."""
    yield from showing(NO_SIGN)(h, effort)


def showing(least: float) -> Move:
    """Return the move that adds an effect that explains more than `least` to first order."""

    def move(h: Hypothesis, effort: Effort) -> Iterator[Proposal]:
        yield from _more(h, effort, itertools.chain(_views(h), _views_afar(h)), least)

    return move


def shown(h: Hypothesis, effort: Effort) -> Iterator[Proposal]:
    """Yield the hypothesis with one more effect that stands out in one-step errors."""
    yield from _more(h, effort, _views(h), NO_SIGN)


def nearest(h: Hypothesis, effort: Effort) -> Iterator[Proposal]:
    """Yield the hypothesis with one more effect that stands out with the hypothesis's own noise.

    All starts are scored in this view, since those of a longer horizon have other strengths.
    """
    yield from _more(h, effort, itertools.islice(_views(h), 1), NO_SIGN, every=True)


def _more(
    h: Hypothesis, effort: Effort, views: Iterable[View], least: float, every: bool = False
) -> Iterator[Proposal]:
    """Yield effects that explain more than `least` in views, and play that a scan finds.

    every: whether starts for a longer horizon are scored in the other views, too.
    """
    device = h.model.build(h.x)
    where = open_places(device, h.model.nominal)
    sizes = sizes_of(device, h.experiments, h.model.reads(h.x).gain)
    (near, play), (far, _) = (_apart(starts_at(where, sizes, far)) for far in (False, True))
    if every:
        near = _together(near, [start for group in far.values() for start in group])
    for seen in views:
        starts = _together(near, shown_starts(seen)) if seen.own else dict(far)
        count = effort.near if seen.own else effort.far
        order = screened(seen, starts)
        most = order[0].score if order else 0.0
        for one in order[:count]:
            if one.score > max(least, PURSUIT.rival_share * most):
                yield _with(h, seen, one)
    if effort.generations:
        yield from _played(h, h.model, h.x, play, effort)


def _apart(starts: Mapping[str, list[Start]]) -> tuple[Starts, Starts]:
    """Separate the starts of play, for which scores are meaningless."""
    play = {label: group for label, group in starts.items() if with_play((group[0].physics,))}
    return {label: group for label, group in starts.items() if label not in play}, play


def _played(
    h: Hypothesis, model: Model, x: Floats, play: Starts, effort: Effort
) -> Iterator[Proposal]:
    """Yield a model with play for each place, from a scan, fitted with its own noise.

    The results of populations (`seeking.playing`) are all fitted, and the cheapest is yielded:
    beside the bottom of its valley, a play at -131 540 in -2 ln, whose fit ends at -136 500, costs
    more than a cubic spring at -131 760; and the cheapest result before a fit may be in the wrong
    valley.
    """
    ticks = max(SCANNED_TICKS, TELLING_TICKS * len(h.experiments))
    seen = beginnings(h.experiments, ticks)
    for group in play.values():
        shown = scanned(seen, model, x, group)
        begun = arrivals(seen, shown, effort.members, effort.generations)
        asked = [partial(_arrived, h, wide, there.x) for wide, there in begun]
        found = [one for one in in_parallel(asked, threads()) if one is not None]
        if found:
            one = min(found, key=lambda one: one.cost.total)
            yield Proposal(h.experiments, one.model, one.x, h.family, None, one.ratio, h.prices)


def _arrived(h: Hypothesis, wide: Model, x: Floats) -> Hypothesis | None:
    """A richer model, fitted from the result of a population with its own noise."""
    with suppress(NoObserver):
        return settled(judged(h.experiments, wide, x, h.family, None, h.prices), turns=1)
    return None


def stepped(h: Hypothesis, _: Effort) -> Iterator[Proposal]:
    """Yield the hypothesis with steps of the command or the sensor, or with lost commands.

    A step that it has is sought again beside its other effects.
    """
    if h.slopes is None:
        return
    for trial in stepped_trials(h.problem, h.fitted, h.experiments):
        model, others = trial.fitted.model, [p for p in h.prices if p[0] != trial.label]
        prices = (*others, (trial.label, trial.price))
        seen = trial.problem.experiments
        yield Proposal(seen, model, trial.fitted.x, h.family, prices=prices)


def removed(h: Hypothesis, _: Effort) -> Iterator[Proposal]:
    """Yield the hypothesis without each effect, its strength dropped or moved to the same law.

    Friction of two masses may first be assigned to one of them, and a fit across creases does not
    move it.
    """
    under = _cut(h.problem, _glance(h.experiments))
    for i, gone in enumerate(h.model.effects_at(h.x)):
        model, x = h.model.less(h.x, i)
        for begun in (x, *_handed_over(model, x, gone)):
            yield Proposal(
                h.experiments,
                model,
                begun,
                h.family,
                under,
                h.ratio,
                h.prices,
                motions=h.noise.motions,
            )


def _handed_over(model: Model, x: Floats, gone: Physics) -> Iterator[Floats]:
    """Yield x with the removed strength added to each other effect of the same law."""
    for i, physics in enumerate(model.effects):
        if physics.effect is not gone.effect:
            continue
        more = x.copy()
        for j, p in enumerate(model.parameters):
            own = p.kind == "effect" and p.index == i
            if own and physics.effect.parameter(p.key).role == "magnitude":
                more[j] += gone.values[p.key] / p.scale
        yield model.within(more)


def simpler(h: Hypothesis, _: Effort) -> Iterator[Proposal]:
    """Yield the hypothesis with each effect replaced by one of those that it contains."""
    device = h.model.build(h.x)
    fitted = h.model.effects_at(h.x)
    sizes = sizes_of(device.bare(), h.experiments, h.model.reads(h.x).gain)
    for i, physics in enumerate(h.model.effects):
        model, x = h.model.less(h.x, i)
        bare = model.build(x)
        for effect, place in open_places(bare, h.model.nominal):
            if effect.name not in physics.effect.contains or place.acts_on != physics.place.acts_on:
                continue
            groups = starts_at([(effect, place)], sizes, far=True)
            for starts in groups.values():
                every = [*starts, *_as_strong(starts, fitted[i])]
                yield _among(h, model, x, [(start,) for start in every])


def split(h: Hypothesis, _: Effort) -> Iterator[Proposal]:
    """Yield the hypothesis with each effect replaced by two of those that it contains.

    A constant force and Coulomb friction are together a directional friction. Instead of a
    contained effect, other laws of its family that contain such effects too are also tried, such as
    friction that rises with speed; one step at a time, the search would have to pass through the
    two simple effects, which explain less. A constant force may act on any mass, since it only
    stretches the links between them.
    """
    device = h.model.build(h.x)
    fitted = h.model.effects_at(h.x)
    sizes = sizes_of(device.bare(), h.experiments, h.model.reads(h.x).gain)
    for i, physics in enumerate(h.model.effects):
        model, x = h.model.less(h.x, i)
        held = [
            (effect, place)
            for effect, place in open_places(model.build(x), h.model.nominal)
            if _shares(effect, physics.effect)
            and (place.acts_on == physics.place.acts_on or _moves_all(effect))
        ]
        for pair in combinations(held, 2):
            if pair[0][0].family == pair[1][0].family != "":  # two laws of the same thing
                continue
            if all(_moves_all(effect) for effect, _ in pair):
                continue
            each: list[list[Start]] = []
            for one in pair:
                (starts,) = starts_at([one], sizes, far=True).values()
                each.append([*starts, *_as_strong(starts, fitted[i])])
            yield replace(_among(h, model, x, list(product(*each))), akin=True)


def _moves_all(effect: Effect) -> bool:
    """Whether an effect hardly differs between the masses: constant, it stretches links once."""
    return effect.name == "constant_force"


def _shares(effect: Effect, whole: Effect) -> bool:
    """Whether `whole` contains an effect, or shares a contained effect and its family with it."""
    alike = effect is not whole and effect.family == whole.family != ""
    return effect.name in whole.contains or (alike and bool({*effect.contains} & {*whole.contains}))


def merged(h: Hypothesis, _: Effort) -> Iterator[Proposal]:
    """Yield the hypothesis with two effects at one place replaced by a law that acts like both.

    The law contains both, or one, and is mistaken for the other: a spring and a ripple together
    are a pendulum near its rest position, and neither is replaced alone as long as the other stays.
    """
    device = h.model.build(h.x)
    fitted = h.model.effects_at(h.x)
    sizes = sizes_of(device.bare(), h.experiments, h.model.reads(h.x).gain)
    for i, j in combinations(range(len(fitted)), 2):
        one, other = fitted[i], fitted[j]
        if one.place.acts_on != other.place.acts_on:
            continue
        model, x = h.model.less(h.x, i, j)
        for effect, place in open_places(model.build(x), h.model.nominal):
            if place.acts_on == one.place.acts_on and _like_both(effect, one.effect, other.effect):
                (starts,) = starts_at([(effect, place)], sizes, far=True).values()
                alike = [*_as_strong(starts, one), *_as_strong(starts, other)]
                every = [(start,) for start in (*starts, *alike)]
                yield replace(_among(h, model, x, every), akin=True)


def _like_both(law: Effect, one: Effect, other: Effect) -> bool:
    """Whether a law contains two others, or contains one and is mistaken for the other."""
    pair = {one.name, other.name}
    return law.name not in pair and bool(pair & {*law.contains}) and pair <= {
        *law.contains, *law.mistaken_for
    }  # fmt: skip


def swapped(h: Hypothesis, _: Effort) -> Iterator[Proposal]:
    """Yield the hypothesis with two of its effects exchanged.

    If two frictions at two places were exchanged one at a time, the search would have to pass
    through two laws at one place.
    """
    fitted = h.model.effects_at(h.x)
    sizes = sizes_of(h.model.build(h.x).bare(), h.experiments, h.model.reads(h.x).gain)
    for i, j in combinations(range(len(fitted)), 2):
        one, other = fitted[i], fitted[j]
        alike = one.effect is other.effect or one.place.acts_on == other.place.acts_on
        places = str(other.place) in one.effect.places and str(one.place) in other.effect.places
        if alike or not places:
            continue
        model, x = h.model.less(h.x, i, j)
        room = {
            (effect.name, place.acts_on)
            for effect, place in open_places(model.build(x), h.model.nominal)
        }
        there = ((one.effect.name, other.place.acts_on), (other.effect.name, one.place.acts_on))
        if not room.issuperset(there):
            continue
        pair = tuple(
            Start(replace(a, at=b.at), h.model.scales[k], a.effect.within(sizes, b.place))
            for a, b, k in ((one, other, i), (other, one, j))
        )
        yield replace(_among(h, model, x, [pair]), akin=True)


def replaced(index: int) -> Move:
    """Return the move that replaces one effect by another.

    An effect that neither contains the old one nor is contained in it is tried only if, to first
    order, it explains a good part of the same; others end far away. Only the first part of the
    recordings is used if the old effect is clear there.
    """

    def move(h: Hypothesis, effort: Effort) -> Iterator[Proposal]:
        model, at = h.model.less(h.x, index)
        own = h.model.effects_at(h.x)[index]
        gone, rotary = place_label(own), h.model.nominal.rotary
        richer = {label_of(e.name, at) for e, at in richer_at(own.effect.name, own.place, rotary)}
        laws = {own.effect.name, *own.effect.contains}
        device = model.build(at)
        ticks = _glance(h.experiments)
        under, x, explained = _without(h, model, at, ticks)
        if ticks is not None and explained < PURSUIT.clear_sign:
            under, x, explained = _without(h, model, at, None)
        seen = view(under, model, x, own=True)
        sizes = sizes_of(device, h.experiments, h.model.reads(h.x).gain)
        where = open_places(device, h.model.nominal)
        (near, _), (far, _) = (_apart(starts_at(where, sizes, far)) for far in (False, True))
        starts = _together(
            _together(near, shown_starts(seen)), [s for g in far.values() for s in g]
        )
        for label in richer & starts.keys():
            starts[label] += _as_strong(starts[label], own)
        others = [one for one in screened(seen, starts) if one.start.label != gone]
        base = replace(h, model=model, x=x)
        least = PURSUIT.rival_share * explained - PURSUIT.hopeless
        alike = {  # the same law elsewhere, with the same parameters, as behind a stiff link
            label_of(effect.name, place): Start(
                replace(own, effect=effect, at=str(place)), h.model.scales[index],
                effect.within(sizes, place),
            )
            for effect, place in where
            if effect is own.effect or _twins(effect, own.effect)
        }  # fmt: skip
        for rank, one in enumerate(others):
            if (moved := alike.get(one.start.label)) is not None:
                yield replace(_among(h, model, at, [(moved,), (one.start,)]), akin=True)
                continue
            # A richer effect explains at least as much, and only a fit shows how much more.
            akin = one.start.physics.effect.name in laws or one.start.label in richer
            if akin or (rank < effort.rivals and one.score > least):
                yield replace(_with(base, seen, one), akin=akin)

    return move


def _twins(one: Effect, other: Effect) -> bool:
    """Whether two laws of the same parameters are mistaken for each other.

    As a lag of the drive and of the sensor: either fits as well, however strong it is. To first
    order, from a weak one, the other explains little of the same. (On a machine of three masses no
    rival was named, and the wrong one of the two was `identified`.)
    """
    keys = ([(p.name, p.unit) for p in law.parameters] for law in (one, other))
    return one.name in other.mistaken_for and next(keys) == next(keys)


def _without(
    h: Hypothesis, model: Model, x: Floats, ticks: int | None
) -> tuple[Problem, Floats, float]:
    """The cut problem, a model's adapted x without an effect, and how much more it costs."""
    under = _cut(h.problem, ticks)
    ground = Landscape(under.experiments, under.observer, model, SCREENING)
    first = descend(ground, x, Effort.first_rounds, creased(model), first=True)
    whole = Landscape(under.experiments, under.observer, h.model, SCREENING)
    return under, first.x, first.cost - float(whole.costs([h.x])[0])


def _views(h: Hypothesis, ticks: int | None = None) -> Iterator[View]:
    """Yield a hypothesis with its own noise, and with a slower one; ticks: most, None for all.

    A noise model attributes part of the missing physics to disturbance, and its filter attributes
    the rest to coloured noise. So the second observer is a hundred times slower and assumes white
    noise.
    """
    yield view(_cut(h.problem, ticks), h.model, h.x, own=True)
    with suppress(NoObserver):
        slower = prepared_for(h.experiments, h.model, h.x, blind(SLOWER * h.ratio))
        yield view(_cut(slower, ticks), h.model, h.x, own=True)


def _views_afar(h: Hypothesis, ticks: int = FAR_TICKS) -> Iterator[View]:
    """Yield a hypothesis with an observer that hardly corrects, at its x and its device file's."""
    prior = np.array([p.prior for p in h.model.parameters])
    stretch = beginnings(h.experiments, ticks)
    bent = float(np.abs(h.x[prior]).max(initial=0.0)) > BENT
    for x in (h.x, np.where(prior, 0.0, h.x)) if bent else (h.x,):
        with suppress(NoObserver):
            yield view(prepared_for(stretch, h.model, x, blind(SLOWEST)), h.model, x, own=False)


def _together(
    starts: Mapping[str, Sequence[Start]], more: Sequence[Start]
) -> dict[str, list[Start]]:
    found = {label: list(group) for label, group in starts.items()}
    for start in more:
        if start.label in found:
            found[start.label].append(start)
    return found


def _as_strong(starts: Sequence[Start], other: Physics) -> list[Start]:
    return [s for s in (start.as_strong_as(other) for start in starts) if s is not None]


def _with(h: Hypothesis, seen: View, one: Screened) -> Proposal:
    """The hypothesis with a start, its parameters adapted if that costs less."""
    start = one.start
    model = seen.model.with_effect(start.physics, start.scales, start.bounds)
    own = [p.name for p in model.parameters[seen.model.lasting : model.lasting]]
    extra = start.beyond(own, start.scales)
    longest = float(np.abs(one.shift).max(initial=0.0))
    given = one.shift * min(1.0, GIVEN_WAY / max(longest, 1e-300))
    xs = [model.within(seen.model.beside(x, extra)) for x in (seen.x, seen.x + given)]
    costs = Landscape(seen.problem.experiments, seen.problem.observer, model, SCREENING).costs(xs)
    x = xs[int(np.argmin(np.nan_to_num(costs, nan=np.inf)))]
    near = h.ratio if seen.own else None
    return Proposal(
        h.experiments, model, x, h.family, seen.problem, near, h.prices, motions=h.noise.motions
    )


def _among(h: Hypothesis, model: Model, x: Floats, starts: Sequence[tuple[Start, ...]]) -> Proposal:
    """The best of some starts of one effect, or of several together, with the hypothesis's noise.

    It is chosen and first fitted on the first part of the recordings, if that saves much.
    """
    problem = _cut(h.problem, _glance(h.experiments))
    tried = model
    for first in starts[0]:
        names = [p.name for p in first.physics.effect.parameters]
        tried = tried.with_effect(first.physics, dict.fromkeys(names, 1.0))
    asked: list[Floats] = []
    for together in starts:
        own = model.beside(x, np.zeros(tried.lasting - model.lasting))
        for k, (start, first) in enumerate(zip(together, starts[0], strict=True)):
            index = len(model.effects) + k
            for j, p in enumerate(tried.parameters):
                if p.kind == "effect" and p.index == index:
                    own[j] = start.physics.values[p.key] - first.physics.values[p.key]
        asked.append(own)
    costs = Landscape(problem.experiments, problem.observer, tried, SCREENING).costs(asked)
    best = starts[int(np.argmin(np.nan_to_num(costs, nan=np.inf)))]
    other = model
    for start in best:
        other = other.with_effect(start.physics, start.scales, start.bounds)
    begin = other.within(model.beside(x, np.zeros(other.lasting - model.lasting)))
    return Proposal(
        h.experiments, other, begin, h.family, problem, h.ratio, h.prices, motions=h.noise.motions
    )

"""A law of no name, learned: a table over one state, or a surface over two, fitted as any effect.

Where no name is adequate, what is missing is let in through points: over position or velocity at
each mass, over what each link gives way, over the command, over what the sensor reads, over one
turn of what a ripple repeats by; and over any two states of one place as a product f(a) g(b) of two
tables, as a shift f(a + g(b)) of two, or as a grid F(a, b). `start` says where that would gain to
first order, and begins there. Whatever the form is, one loop learns it (`_learned`):

1. the points that pay are told from slopes (`fewer`) and that law is fitted;
2. names go that are not believed beside it, and changes of parameters that it explains as well:
   names come first, and under a law that none of them is they take what they can of it;
3. points are put between those that pay where slopes say that they would be believed, and those
   that pay of all of these are fitted, in turn;
4. names that follow the same state give it their part, where it is as likely without them;
5. it is believed over the names by the one criterion of `selection.evidence`, or is none; so it is
   where a straight line does as well, which is a spring, a damper, a scale or a constant.

Whether it is said, other data decide (`answer.learned`). What follows the same state at the same
place still is one law with it for whoever reads it (`steady.together`).

Limits: one or two states of one place; nothing over time, which a recording meets once and other
data never. What is steep near rest no table holds, and friction stays a name. The straight part of
a table of velocity is a damper, that of a table of position a spring: what of it is which, only the
device file says.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.forces.leftover import predicted_states
from zwidth.diagnosis.laws.fewer import (
    Known,
    as_it_is,
    cheapest,
    known_of,
    promised,
    tempered,
)
from zwidth.diagnosis.laws.forms import Form, GridForm, Site, TableForm, form_of, grid
from zwidth.diagnosis.laws.learned import Curve, Surface, as_curve, as_surface
from zwidth.diagnosis.laws.points import law_at
from zwidth.diagnosis.laws.start import (
    WORTH,
    Begun,
    axes_over,
    bare_of_law,
    beside,
    leads,
    of_nothing,
    over_one,
    over_turns,
    over_two,
    product_from,
    shift_from,
    site_at,
    states_seen,
    told_of,
)
from zwidth.diagnosis.laws.steady import along, follows
from zwidth.diagnosis.mishaps import Say, attempt
from zwidth.diagnosis.model.parameters import effect_labels
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.selection.evidence import believed
from zwidth.diagnosis.selection.hypothesis import Hypothesis, against, judged, priced, settled
from zwidth.diagnosis.selection.search import Search
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_force import SIZE, counts_at
from zwidth.sim.place import place_at

Floats = NDArray[np.float64]
Hopeful = Callable[[Hypothesis], bool]


def learn(found: Search, say: Say) -> Curve | None:
    """Return the likeliest law over one state of those believed over the names, or None."""
    return next(laws(found, say), None)


def laws(
    found: Search, say: Say, turns: bool = False, hopeful: Hopeful = lambda _: True
) -> Iterator[Curve]:
    """Yield laws over one state that are believed over the names, each of another place or state.

    In the order of what the points that pay promise. turns: only what repeats, in a ripple's place.
    hopeful: whether a law is worth the search for its points.
    """
    yield from _over_one(found, _bases(found), turns, say, hopeful)


def _bases(found: Search) -> list[Hypothesis]:
    """What a law is learned beside: the names that are believed, and none, as far as fitted."""
    bases = [found.best] + [found.plain] * bool(found.best.model.effects)
    return [base for base in bases if base.slopes is not None]


def replacing(found: Search, say: Say, hopeful: Hopeful = lambda _: True) -> Iterator[Curve]:
    """Yield laws over one state that are believed over names of which they need none or few.

    Sought only where a state leads what the names leave. Not of one name that the law is with what
    this leaves (`_is_a_name`).
    """
    many = len(found.best.model.effects)
    if many == 0 or found.best.slopes is None or not leads(found.best):
        return
    bases = _bases(found) if many > 2 else [found.plain]
    for curve in _over_one(found, bases, False, say, hopeful):
        h = curve.hypothesis
        believable = believed(h.cost, found.best.cost, against(h, found.best).phi)
        enough = len(curve.replaced) >= min(many, 2)
        if enough and believable and not _is_a_name(found, curve, say):
            yield curve


def surfaces(
    found: Search, than: Sequence[Hypothesis], say: Say, hopeful: Hopeful, places: int = 2
) -> Iterator[Surface]:
    """Yield laws over two states that are believed, all forms of the likeliest place first.

    than: what they are held against, names and laws of one state. places: that are asked.
    """
    least = min(than, key=lambda h: h.cost.total)
    each = [(base, one) for base in _bases(found) for one in _asked(partial(over_two, base))]
    each.sort(key=lambda pair: pair[1].h.cost.misfit)
    by_place: dict[tuple[str, tuple[str, ...]], list[tuple[Hypothesis, Begun]]] = {}
    for base, one in each:
        by_place.setdefault((one.site.at, one.site.over), []).append((base, one))
    for pairs in list(by_place.values())[:places]:
        say(f"learning a law over {pairs[0][1].site.name}")
        for make in (product_from, shift_from, _grid):
            likely = [
                replace(one, h=priced(h))
                for base, one in pairs
                if (h := attempt("learn", one.site.at, partial(make, base, one))) is not None
            ]
            law = _learned(found, likely, least, say, hopeful)
            if law is not None and believed(law.h.cost, least.cost, against(law.h, least).phi):
                yield as_surface(_as_the_file_counts(law), least, found)


def _grid(_: Hypothesis, one: Begun) -> Hypothesis | None:
    """A grid with all the points that it has, fitted, from one of fewer that was begun."""
    h, site, axes = one.h, one.site, axes_over(one.site, SIZE)
    few = GridForm(last(h))
    if axes is None:
        return None
    a, b = counts_at(few.rows, axes[0]), counts_at(few.columns, axes[1])
    return in_its_place(h, site, grid(site, axes[0], axes[1], a @ few.smooth(site) @ b.T))


def _asked(begin: Callable[[], Iterable[Begun]]) -> list[Begun]:
    """What begins so; nothing where that fails, which is reported as a mishap."""
    return attempt("learn", "where", lambda: list(begin())) or []


def _over_one(
    found: Search, bases: Sequence[Hypothesis], turns: bool, say: Say, hopeful: Hopeful
) -> Iterator[Curve]:
    """Yield laws over one state that are believed, beside what each of some bases has."""
    least = min((found.best, found.plain), key=lambda h: h.cost.total)
    by_place: dict[tuple[str, str, float], list[Begun]] = {}
    for base in bases:
        every = [] if turns else _asked(partial(over_one, base))
        for one in (*every, *_asked(partial(over_turns, base))):
            key = one.site.effect, one.site.at, one.site.period
            by_place.setdefault(key, []).append(one)
    order = [(min(map(promised, each)), each) for each in by_place.values()]
    for promise, each in sorted(order, key=lambda pair: pair[0]):
        if promise > least.cost.total + WORTH:
            break
        say(f"learning a law over {each[0].site.name}")
        law = _learned(found, each, least, say, hopeful)
        if law is not None and found.ahead(law.h, least) and not _is_line(law, say):
            yield as_curve(_as_the_file_counts(law), least, found)


def _learned(
    found: Search, each: Sequence[Begun], least: Hypothesis, say: Say, hopeful: Hopeful
) -> Begun | None:
    """A law at one place with the points that pay, of what was begun there; None for no hope."""
    ends: list[Begun] = []
    for one in sorted(each, key=promised):
        if promised(one) > min((end.h.cost.total for end in ends), default=math.inf):
            break
        end = attempt("learn", one.site.at, partial(first_fit, one, against(one.h, least).phi))
        if end is not None and hopeful(end.h):
            ends.append(replace(end, h=_without_changes(without_names(found, end.h))))
    if not ends:
        say("it gains too little: not sought further")
        return None
    h, site = (end := min(ends, key=lambda one: one.h.cost.total)).h, end.site
    phi = against(h, least).phi
    h = _absorbing(refined(h, site, phi), site, phi)
    fewer = without_names(found, h)  # that its own points have made needless
    return Begun(h if fewer is h else refined(fewer, site, phi), site)


def first_fit(one: Begun, phi: float) -> Begun | None:
    """Return what was begun with the points that pay, fitted; or what repeats, if that is less.

    All of its points are fitted first: a law over the command trades its straight part for the
    scale of all, c (u + f(u)), so that to second order -u is as good as any: what was told of it
    may be worth nothing once it is fitted, and then the law keeps all of its points.
    """
    h, site = settled(one.h), one.site
    own = in_its_place(h, site, _of_those_that_pay(h, site, phi) or last(h))
    if own is None or not math.isfinite(own.cost.total):  # not all of its points are told
        few = of_nothing(site, 7 if len(site.over) == 1 else 5)
        own = None if few is None else in_its_place(h, site, few)
    fits = [Begun(h, site)] + ([] if own is None else [Begun(own, site)])
    for turn, scale in turns_of(h, site):
        there = replace(site, period=turn.values["period"], scale=scale)
        if (own := in_its_place(h, there, turn)) is not None:
            fits.append(Begun(own, there))
    finite = [fit for fit in fits if math.isfinite(fit.h.cost.total)]
    return min(finite, key=promised, default=None)


def refined(h: Hypothesis, site: Site, phi: float, rounds: int = 3) -> Hypothesis:
    """Return a law with the points that pay, of its own and of those between them, in turn.

    Of points that stand where little happens some go, and their neighbours get nearer to where much
    does: a corner, or a bump that is narrower than points were at first.
    """
    for _ in range(rounds):
        law = _of_those_that_pay(h, site, phi)
        other = None if law is None else in_its_place(h, site, law)
        if other is None or not tempered(other, phi) < tempered(h, phi):
            break
        h, phi = other, against(other, h).phi
    return h


def _of_those_that_pay(h: Hypothesis, site: Site, phi: float) -> Physics | None:
    """The law of the points that pay of a priced one, and of those between where it is believed.

    None where all that it has pay, and no others are believed.
    """
    there, form = known_of(h, phi), form_of(last(h))
    best = cheapest(there, form, site)
    own = as_it_is(there)
    gained = own - best.cost
    law = best.law if gained > 0.0 else None
    if (closer := _closer(h, site, phi)) is not None:
        fine, of_more = closer
        other = cheapest(fine, of_more, site)
        if fine.stands + own - there.stands - other.cost > max(gained, 0.0) + WORTH:
            law = other.law
    return law


def _closer(h: Hypothesis, site: Site, phi: float = 1.0) -> tuple[Known, Form] | None:
    """What slopes tell of the same law with more points; None where it has all that it may."""
    more = form_of(last(h)).finer(site)
    there = None if more is None else told_of(h, *beside(*bare_of_law(h), site, more), phi)
    return None if more is None or there is None else (there, form_of(more))


def turns_of(h: Hypothesis, site: Site, most: int = 2) -> list[tuple[Physics, float]]:
    """Return tables of one turn near the table that a fit has last, each with its period's scale.

    A table holds few periods of what repeats; one turn of it holds them all. So of a table with
    twice the points, of forces f at states s and precision P, it is asked which period L makes
    c + d s + a sin(2 pi s / L) + b cos(2 pi s / L) nearest to f, of all L of which the range holds
    one turn and a half or more, down to twice the least distance of points. Where it holds half of
    what is not straight in f, tables of one turn begin there. Limit: points further apart than half
    a turn leave several L that are alike, of which the nearest few are fitted.
    """
    form = form_of(last(h))
    if not isinstance(form, TableForm) or form.odd or form.period > 0.0:
        return []
    there, form = _closer(h, site) or (known_of(h), form)
    assert isinstance(form, TableForm)
    s, own = form.states, form.told(there.names)
    span, least = float(np.ptp(s)), float(np.diff(s).min())
    root = np.linalg.cholesky(there.precision).T
    level = form.level(there.names)  # from which what is free counts where a point is held
    target = root @ (np.linalg.solve(there.precision, there.pull) - level)

    def nearest(period: float) -> tuple[float, Floats]:
        """How far the nearest sine of a period with a straight line is, and its numbers."""
        angle = 2.0 * np.pi * s / period
        columns = root @ own(np.column_stack([np.ones_like(s), s, np.sin(angle), np.cos(angle)]))
        numbers = np.asarray(np.linalg.lstsq(columns, target, rcond=1e-12)[0], dtype=np.float64)
        return float(np.sum((target - columns @ numbers) ** 2)), numbers

    turns = np.arange(1.5, max(1.5, min(60.0, 0.5 * span / least)) + 0.125, 0.125)
    fits = [nearest(span / n) for n in turns]
    off = np.array([distance for distance, _ in fits])
    padded = np.concatenate([[np.inf], off, [np.inf]])
    lowest = np.flatnonzero((off <= padded[:-2]) & (off <= padded[2:]))
    likely = lowest[off[lowest] < 0.5 * nearest(math.inf)[0]]
    found: list[tuple[Physics, float]] = []
    for k in likely[np.argsort(off[likely])][:most]:
        period, (c, _, a, b) = span / float(turns[k]), fits[k][1]
        angle = 2.0 * np.pi * np.arange(12) / 12  # six harmonics
        forces = (0.0 if site.floats else c) + a * np.sin(angle) + b * np.cos(angle)
        turn = replace(site, period=period).table(period * angle / (2.0 * np.pi), forces)
        found.append((turn, 0.25 * period**2 / span))  # a quarter of a turn more over the range
    return found


def last(h: Hypothesis) -> Physics:
    """Return the law that a hypothesis has last."""
    return h.model.effects_at(h.x)[-1]


def fitted(base: Hypothesis, site: Site, law: Physics) -> Hypothesis | None:
    """Return a law beside what a hypothesis has, fitted; None where no observer follows."""
    model, start = beside(base.model, base.x, site, law)
    with suppress(NoObserver):
        return settled(judged(base.experiments, model, model.within(start), base.family))
    return None


def in_its_place(h: Hypothesis, site: Site, law: Physics) -> Hypothesis | None:
    """Return another law in the place of the one that a hypothesis has last, fitted.

    What a grid does not see is then laid smoothly between what it does, and it is fitted again.
    """
    model, x = bare_of_law(h)
    other = fitted(replace(h, model=model, x=x), site, law)
    form = None if other is None else form_of(last(other))
    if other is None or not isinstance(form, GridForm) or form.told(site).all():
        return other
    model, x = bare_of_law(other)
    laid = grid(site, form.rows, form.columns, form.smooth(site))
    return fitted(replace(other, model=model, x=x), site, laid) or other


def without_names(found: Search, h: Hypothesis) -> Hypothesis:
    """Return the same without names that are not believed over their absence, the last first."""
    for i in reversed(range(len(h.model.effects) - 1)):
        model, x = h.model.less(h.x, i)
        with suppress(NoObserver):
            fewer = settled(judged(h.experiments, model, x, h.family))
            h = h if found.ahead(h, fewer) else fewer
    return h


def _without_changes(h: Hypothesis) -> Hypothesis:
    """The same with nothing that changes, where that is not believed over staying the same."""
    if not h.model.varies:
        return h
    model, x = h.model.constant(h.x)
    with suppress(NoObserver):
        same = settled(judged(h.experiments, model, x, h.family))
        if not believed(h.cost, same.cost, against(h, same).phi):
            return same
    return h


def _absorbing(h: Hypothesis, site: Site, phi: float) -> Hypothesis:
    """The same with those names in the curve that follow its state and are not believed beside it.

    Beside a table of all its points a name may pay for itself by making them smaller, and not any
    more beside those that pay: so the curve that has its part is given its own points.
    """
    for i, name in reversed(list(enumerate(h.model.effects_at(h.x)[:-1]))):
        model, x = h.model.less(h.x, i, len(h.model.effects) - 1)
        bare = replace(h, model=model, x=x)
        other = None
        if _is_part(name, site) and (law := _with_it(bare, site, name, last(h), 1.0, phi)):
            other = fitted(bare, site, law)
        if other is not None and not believed(h.cost, other.cost, against(h, other).phi):
            h = other
    return h


def _is_part(name: Physics, site: Site) -> bool:
    """Whether a name follows the state of a curve at its place."""
    one = len(site.over) == 1 and site.period == 0.0
    return one and follows(name, site.effect, place_at(site.at))


def _with_it(
    bare: Hypothesis, site: Site, name: Physics, law: Physics, counts: float, phi: float
) -> Physics | None:
    """The points that pay of a law with so many times what a name gives over its state."""
    axes = axes_over(site)
    given = None if axes is None else along(name, site.effect, axes[0])
    if axes is None or given is None:
        return None
    whole = site.table(axes[0], law_at(law, axes[0]) + counts * given)
    there = told_of(bare, *beside(bare.model, bare.x, site, whole), phi)
    return whole if there is None else cheapest(there, form_of(whole), site).law


def _is_a_name(found: Search, curve: Curve, say: Say) -> bool:
    """Whether one of the names beside a law of what it leaves costs less than a law without it.

    Names come first: a cubic spring that is not quite cubic is one, and what it leaves is another
    matter. Of a law that is in no library a name leaves as much to say as there was. Asked of names
    that were fitted alone, as a search begins.
    """
    h, law = curve.hypothesis, curve.physics
    for one in found.best.model.effects:
        alone = found.tried.get(frozenset(effect_labels((one,))))
        if alone is None or alone.slopes is None:
            continue
        site = site_at(
            alone, predicted_states(alone.problem, alone.fitted), law.effect.name, law.at
        )
        name, phi = last(alone), against(h, alone).phi
        if not _is_part(name, site) or curve.period > 0.0:
            continue
        rest = _with_it(alone, site, name, law, -1.0, phi)
        both = None if rest is None else fitted(alone, site, rest)
        if both is not None and refined(both, site, phi).cost.total < h.cost.total:
            say(f"{one.effect.name} with what it leaves costs less: it is that")
            return True
    return False


def _is_line(law: Begun, say: Say) -> bool:
    """Whether a straight line does as well in a law's place, which is then none.

    A spring, a damper or a scale is that, and a constant force or an origin where it is beside
    nothing. It begins where the law is: a law over the command may have taken most of its scale
    away, in a valley that no fit reaches from nothing.
    """
    h, site = law.h, law.site
    if site.period > 0.0:
        return False
    force = law_at(last(h), site.seen)
    offset, slope = np.polynomial.polynomial.polyfit(site.seen, force, 1)
    ends = np.array([float(site.seen.min()), float(site.seen.max())])
    rival = in_its_place(h, site, site.table(ends, offset + slope * ends))
    if rival is None or believed(h.cost, rival.cost, against(h, rival).phi):
        return False
    say("a straight line would do as well: that is no law, but a spring, a damper or a constant")
    return True


def _as_the_file_counts(law: Begun) -> Begun:
    """The same law as the device file counts positions, and a shift from none where it rests.

    Over q = y - d, d another origin, k the spring: -k q + f(q) = -k y + (f(y - d) + k d), so that
    over a position of the first mass the law moves by d with a constant k d, and nothing tells
    which is so. Limits: with nothing beside the law that may follow a position.
    """
    h, site = law.h, law.site
    swings, k = {e.swing for e in h.experiments}, h.model.build(h.x).chain.ground_spring
    tied = site.at == "m1" and k > 0.0 and len(h.model.effects) == 1 and len(swings) == 1
    by = h.model.reads(h.x).origin * swings.pop() if tied else 0.0
    centred = form_of(last(h)).centred(site)
    moved = form_of(centred).moved(site, by, k * by) if tied else None
    if moved is None and centred is last(h):
        return law
    counts = np.array([float(name == "position") for name in site.over])
    seen = states_seen(h, site.at, site.over) + by * counts
    model, x = bare_of_law(h)
    if moved is not None:
        x = np.where([p.kind == "origin" for p in model.parameters], 0.0, x)
    model, x = beside(model, x, replace(site, states=seen), moved or centred)
    near = h.family.near(h.ratio)
    other = judged(h.experiments, model, model.within(x), h.family, near, h.prices)
    same = abs(other.cost.misfit - h.cost.misfit) < 1.0
    return replace(law, h=priced(other)) if same else law

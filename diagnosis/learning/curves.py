"""A learned law without a name: a table over one state at one place, fitted like any effect.

If no effect of the library is adequate, the missing law is represented by a table of points
(`sim/physics/free_law`): over position or velocity at each mass, over the deflection of each link,
over the command, over the reading of the sensor, and over one period of a repeating law. A few
rounds of a fit show where such a table gains most (`where`). The best are fitted to the end,
together with observer and linear parameters, and priced like every hypothesis. Those that remain
are also fitted with twice as many points, and as periodic laws (`repeating`).

Named effects are found first. If none of them is the true law, they imitate parts of it: friction
imitates the step of a piecewise line. So the table is fitted beside the named effects and in place
of all of them, each time with all of its points. Each effect beside it is then removed as part of
the curve unless it is still believed over its absence (`selection.evidence`), and so is a change of
a parameter. Then the table keeps the points that pay (`knots`). Named effects that still depend on
the same state at the same place are reported with the law as one curve (`together`), which is known
better than either.

The band of a curve includes the uncertainty of its points, and the error of a curve through so few
points (`tables.left_out`).

Limits: one state at one place. A law of two states is found as far as one state shows it;
`surfaces` then seeks the rest. No table represents a steep part near rest, so friction stays a
named effect. The straight part of a table is a damper over velocity, a spring over position; only
the device file determines how the sum is divided.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.uncertainty import Z95, covariance, covariance_beside
from zwidth.diagnosis.forces.leftover import predicted_states
from zwidth.diagnosis.learning.knots import one_way, refined, shapes, spared, tempered
from zwidth.diagnosis.learning.repeating import OF_A_TURN, turns_of
from zwidth.diagnosis.learning.steady import along
from zwidth.diagnosis.learning.tables import is_odd, law_at, left_out, points_over, table
from zwidth.diagnosis.learning.together import Together, follows, together
from zwidth.diagnosis.learning.where import (
    Site,
    anywhere,
    begun,
    beside,
    law_over,
    site_at,
    sites,
    states_of,
)
from zwidth.diagnosis.mishaps import Say, attempt
from zwidth.diagnosis.model.parameters import Model, effect_labels
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.selection.evidence import ALPHA, believed
from zwidth.diagnosis.selection.hypothesis import (
    Hypothesis,
    against,
    judged,
    priced,
    settled,
)
from zwidth.diagnosis.selection.search import Search
from zwidth.diagnosis.settings import LAWS, PURSUIT
from zwidth.shown import Valued
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_law import AT, FORCE, KNOTS, points_of
from zwidth.sim.place import place_at

Floats = NDArray[np.float64]
FEW = 7  # points, if the recordings do not determine all of a table
SAME = 1.0  # in -2 ln: largest difference of equivalent laws with different origins
NARROWEST = 1e-6  # of a table's range: no point is put between points nearer than this
ASKED = 3  # places and states that are fitted with each set of named effects
STATES = {"spring": "position", "damper": "velocity", "amplifier": "command"}  # of a law, in words


@dataclass(frozen=True)
class Learned(Valued):
    """A learned law, and its relation to the named effects.

    states, forces, lower, upper (points,): the curve and its 95 % band, relative to the fixed point
    if a constant is equivalent to another origin; covariance (points, points) of the forces. seen
    (samples,): the states that were visited. names: effects that stay beside the law; absorbed:
    effects that became part of the curve; replaced: these, and all others that are not needed
    beside the law. together: the curve plus the named effects over the same state there, or None.
    gained: decrease of -2 ln likelihood over the named effects alone, less all penalties.
    """

    physics: Physics
    states: Floats
    forces: Floats
    lower: Floats
    upper: Floats
    covariance: Floats
    seen: Floats
    names: tuple[str, ...]
    absorbed: tuple[str, ...]
    replaced: tuple[str, ...]
    together: Together | None
    gained: float
    hypothesis: Hypothesis

    @property
    def odd(self) -> bool:
        """Whether f(-s) = -f(s); the table is then over |s|."""
        return is_odd(self.physics)

    @property
    def period(self) -> float:
        """Period of a periodic law; 0 for none."""
        return self.physics.values["period"]

    @property
    def one_way(self) -> bool:
        """Whether the law only rises, or only falls."""
        steps = np.diff(self.forces)
        return self.period == 0.0 and bool(np.all(steps >= 0.0) or np.all(steps <= 0.0))

    def named_at(self, states: Floats) -> Floats:
        """Return the sum (points,) of the named effects over the same state at the same place."""
        h = self.hypothesis
        given = [
            along(p, self.physics.effect.name, states)
            for p in h.model.effects_at(h.x)[:-1]
            if p.place.acts_on == self.physics.place.acts_on
        ]
        return np.sum([np.zeros(states.size), *(g for g in given if g is not None)], axis=0)

    @property
    def over(self) -> str:
        """The state that the law depends on, in words."""
        link = self.physics.place.kind == "link"
        name = self.physics.effect.name
        if name == "free_spring":
            return "deflection of the link" if link else "position"
        return {"free_damper": "rate of the link" if link else "velocity"}.get(name, "command")


Begun = tuple[Hypothesis, Site]
Hopeful = Callable[[Hypothesis], bool]


def always(_: Hypothesis) -> bool:
    """Accept every table, whatever its free runs."""
    return True


def learn(found: Search, say: Say) -> Learned | None:
    """Return the cheapest learned law that is believed over the named effects, or None."""
    return next(laws(found, say), None)


@dataclass(frozen=True)
class Table:
    """A law of many points beside a hypothesis, before it is fitted.

    first: initial tables of a fit; begun: the result of some rounds of a fit, if they were made.
    """

    base: Hypothesis
    site: Site
    first: tuple[Physics, ...] = ()
    begun: Hypothesis | None = None

    def after_some_rounds(self) -> Hypothesis | None:
        """Return the result of some rounds of a fit, which shows whether there may be a law."""
        if self.begun is not None:
            return self.begun
        return begun(self.base, *beside(self.base.model, self.base.x, self.site, self.first[0]))

    def fitted(self, say: Say) -> Hypothesis | None:
        """Return the result of a complete fit; None if no observer is possible."""
        site = self.site
        if self.begun is None:
            say(f"learning a law at {site.at} that repeats every {site.period:.3g}")
            fits = [h for law in self.first if (h := _fitted(self.base, site, law)) is not None]
            return min(fits, key=lambda h: h.cost.total, default=None)
        say(f"learning a law that depends on {_at_what(site)}")
        h = attempt("learn", site.at, partial(settled, self.begun))
        if h is not None and not np.isfinite(h.cost.total):  # undetermined points
            law = law_over(site, FEW, False)
            h = None if law is None else _fitted(self.base, site, law)
        return h


def promising(base: Hypothesis, say: Say, hopeful: Hopeful) -> list[Table]:
    """Return the laws of many points that are worth fitting beside a hypothesis.

    They are tried over the states of the named effects at their places. After a few rounds, such a
    table improves free runs if there is a law, and not if the named effects explain everything.
    This takes a small part of the time that learning a law takes.
    """
    say("checking whether a learned curve would improve free runs")
    names = base.model.effects_at(base.x)

    def theirs(effect: str, at: str) -> bool:
        return any(follows(p, effect, place_at(at)) for p in names)

    tables = chain(_over_states(base, theirs), _over_turns(base))
    return [t for t in tables if (h := t.after_some_rounds()) is not None and hopeful(h)]


def _fits(tables: Iterable[Table], say: Say) -> Iterator[Begun]:
    for one in tables:
        h = one.fitted(say)
        if h is not None:
            yield h, one.site


def replacing(found: Search, say: Say, hopeful: Hopeful = always) -> Iterator[Learned]:
    """Yield laws that are believed over the named effects and make two or more of them unnecessary.

    Each is fitted in place of all named effects, and also beside them if there are enough that one
    may stay. hopeful: as in `laws`.
    """
    many = len(found.best.model.effects)
    if many < LAWS.stands_for:
        return
    bases = [found.best] * (many > LAWS.stands_for) + [found.plain]
    tables = chain.from_iterable(_over_states(base) for base in bases)
    for curve in _believed_laws(found, _fits(tables, say), say, hopeful):
        h = curve.hypothesis
        less = len(curve.replaced) >= LAWS.stands_for
        believable = less and believed(h.cost, found.best.cost, against(h, found.best).phi)
        if believable and not _is_a_name(found, curve, say):
            yield curve


def _is_a_name(found: Search, curve: Learned, say: Say) -> bool:
    """Whether a named effect plus a law for its remainder costs less than a law in its place.

    Named effects have precedence: a not quite cubic spring is still a cubic spring, plus a small
    remainder. If a law is in no library, a named effect leaves a large remainder. The effects are
    tested as fitted alone, as at the start of a search.
    """
    h, law = curve.hypothesis, curve.physics
    for one in found.best.model.effects:
        alone = found.tried.get(frozenset(effect_labels((one,))))
        if alone is None or alone.slopes is None or not follows(one, law.effect.name, law.place):
            continue
        moved = predicted_states(alone.problem, alone.fitted)
        site = site_at(alone, moved, law.effect.name, law.at)
        at = points_over(site.states, LAWS.points, False)
        named = alone.model.effects_at(alone.x)[0]
        given = None if at is None else along(named, law.effect.name, at)
        if at is None or given is None or curve.period > 0.0:
            continue
        rest = table(law.effect.name, law.at, at, law_at(law, at) - given, False)
        full = _fitted(alone, site, rest)
        if full is None or not np.isfinite(full.cost.total):
            continue
        both = _shaped(full, against(full, alone).phi, site)
        if both.cost.total < h.cost.total:
            say(
                f"{one.effect.name} and a small remainder explain the motion better than a learned"
                " law alone: the law is dropped"
            )
            return True
    return False


def laws(
    found: Search, say: Say, hopeful: Hopeful = always, tables: Sequence[Table] | None = None
) -> Iterator[Learned]:
    """Yield laws that are believed over the named effects, each at another place or state.

    The laws with the lowest predicted cost come first. hopeful: whether a full table is worth the
    search for the points that pay, which takes about twenty fits. tables: those to try; by default
    all beside the named effects and all in their place.
    """
    bases = [found.best] + [found.plain] * bool(found.best.model.effects)
    if tables is None:
        every = chain.from_iterable(chain(_over_states(b), _over_turns(b)) for b in bases)
    else:
        every = iter(tables)
    yield from _believed_laws(found, _fits(every, say), say, hopeful)


def _believed_laws(
    found: Search, fitted: Iterable[Begun], say: Say, hopeful: Hopeful
) -> Iterator[Learned]:
    """Yield believed laws, from fitted laws of many points."""
    least = min((found.best, found.plain), key=lambda h: h.cost.total)
    every: dict[tuple[str, str, float], list[Begun]] = {}
    for h, site in fitted:
        every.setdefault((site.effect, site.at, site.period), []).append((h, site))
    for each in sorted(every.values(), key=_promise):
        if _promise(each) > least.cost.total + LAWS.hope:
            break
        near = [one for one in each if _promise([one]) < _promise(each) + PURSUIT.hopeless]
        likely = [one for one in near if hopeful(one[0])]
        if not likely:
            what = _at_what(each[0][1])
            say(f"a law that depends on {what} improves free runs too little: dropped")
            continue
        full = [(_without_changes(without_names(found, h)), site) for h, site in likely]
        alike = {h.labels: (h, site) for h, site in sorted(full, key=_costs, reverse=True)}
        full = [_turning(_finer(h, site), site) for h, site in alike.values()]
        phi = against(min((h for h, _ in full), key=lambda h: h.cost.total), least).phi
        shaped = [(_refined(h, site, phi), site) for h, site in full]
        best = min(shaped, key=lambda one: tempered(one[0], phi))
        best = _alone(found, _absorbing(*best, phi), best[1], phi), best[1]
        if not found.ahead(best[0], least) or _is_line(*best, say):
            continue
        law = _as_the_file_counts(one_way(best[0], phi), best[1])
        yield as_learned(law, best[1], least, found)


def _at_what(site: Site) -> str:
    kind = site.effect.removeprefix("free_")
    state = STATES.get(kind, kind.replace("_", " "))
    return f"the {state}" + ("" if site.at == state else f" at {site.at}")


def _costs(begun: Begun) -> float:
    return begun[0].cost.total


def _promise(begun: Sequence[Begun]) -> float:
    """The cost of the cheapest of some laws with only the points that pay."""
    return min(h.cost.total - spared(h, site.states) for h, site in begun)


def _is_line(h: Hypothesis, site: Site, say: Say) -> bool:
    """Whether a straight line explains as much as a law, which is then dropped."""
    rival = None if site.period > 0.0 else _in_its_place(h, site, _line(h, site))
    if rival is None or believed(h.cost, rival.cost, against(h, rival).phi):
        return False
    say("a straight line (spring, damper or constant) fits equally well: law dropped")
    return True


def _over_states(base: Hypothesis, asked: Callable[[str, str], bool] = anywhere) -> Iterator[Table]:
    """Yield laws of many points beside a hypothesis, where they would gain most."""
    where = partial(sites, base, ASKED, asked)
    for site, h in (None if base.slopes is None else attempt("learn", "where", where)) or ():
        yield Table(base, site, begun=h)


def over_turns(base: Hypothesis, say: Say) -> Iterator[Begun]:
    """Yield laws of one period in place of each ripple of a hypothesis, fitted."""
    yield from _fits(_over_turns(base), say)


def _over_turns(base: Hypothesis) -> Iterator[Table]:
    """Yield laws of one period in place of each ripple of a hypothesis.

    A ripple is one sine; a periodic law may have any shape. The fit starts from that sine, and from
    zero.
    """
    for i, p in enumerate(base.model.effects_at(base.x)):
        if base.slopes is None or p.effect.name != "force_ripple" or p.place.kind != "mass":
            continue
        moved = predicted_states(base.problem, base.fitted)
        scale = base.model.scales[i].get("period", 0.0)
        there = site_at(base, moved, "free_spring", p.at)
        site = replace(there, period=p.values["period"], scale=scale)
        model, x = base.model.less(base.x, i)
        at = points_over(site.states, OF_A_TURN, False, site.period)
        sine = None if at is None else along(p, site.effect, at)
        if at is None or sine is None:
            continue
        first = (table(site.effect, site.at, at, f, False, site.period) for f in (sine, 0.0 * sine))
        yield Table(replace(base, model=model, x=x), site, tuple(first))


def _line(h: Hypothesis, site: Site) -> Physics:
    """The straight line nearest to the last law of a hypothesis.

    Such a law is only a spring, a damper or a scale, with a constant force or an origin. A fit of
    the line starts here and not at zero: a law over the command may have absorbed most of the
    scale, which no fit from zero recovers.
    """
    force = law_at(h.model.effects_at(h.x)[-1], site.states)
    offset, slope = np.polynomial.polynomial.polyfit(site.states, force, 1)
    ends = np.array([float(site.states.min()), float(site.states.max())])
    return table(site.effect, site.at, ends, offset + slope * ends, False)


def _fitted(
    base: Hypothesis, site: Site, law: Physics, x: Floats | None = None
) -> Hypothesis | None:
    """A law added to a hypothesis and fitted, from x if given; None without an observer."""
    model, start = beside(base.model, base.x if x is None else x, site, law)
    try:
        begun = judged(base.experiments, model, model.within(start), base.family)
        return settled(begun)
    except NoObserver:
        return None


def _in_its_place(h: Hypothesis, site: Site, law: Physics) -> Hypothesis | None:
    """Another law in place of the last one of a hypothesis, fitted."""
    model, own = h.model.less(h.x, len(h.model.effects) - 1)
    return _fitted(replace(h, model=model, x=own), site, law, own)


def without_names(found: Search, h: Hypothesis) -> Hypothesis:
    """Return the hypothesis without effects that are not believed, removed one after the other."""
    while len(h.model.effects) > 1:
        fewer: list[Hypothesis] = []
        for i in range(len(h.model.effects) - 1):
            model, x = h.model.less(h.x, i)
            with suppress(NoObserver):
                fewer.append(settled(judged(h.experiments, model, x, h.family)))
        cheapest = min(fewer, key=lambda other: other.cost.total, default=h)
        if cheapest is h or found.ahead(h, cheapest):
            break
        h = cheapest
    return h


def _absorbing(h: Hypothesis, site: Site, phi: float) -> Hypothesis:
    """The hypothesis, with effects that are not believed beside the curve merged into it.

    Beside a full table an effect may pay for itself by making the points smaller, but not beside
    the points that pay. So a curve that has absorbed an effect gets points of its own.
    """
    for i, p in reversed(list(enumerate(h.model.effects_at(h.x)[:-1]))):
        if not follows(p, site.effect, h.model.effects[-1].place) or site.period > 0.0:
            continue
        model, x = h.model.less(h.x, i)
        bare, own = model.less(x, len(model.effects) - 1)
        at = points_over(site.states, LAWS.points, False)
        given = None if at is None else along(p, site.effect, at)
        if at is None or given is None:
            continue
        force = law_at(h.model.effects_at(h.x)[-1], at) + given
        law = table(site.effect, site.at, at, force, False)
        whole = _fitted(replace(h, model=bare, x=own), site, law, own)
        other = None if whole is None else _shaped(whole, phi, site)
        if other is not None and not believed(h.cost, other.cost, against(h, other).phi):
            h = other
    return h


def _alone(found: Search, h: Hypothesis, site: Site, phi: float) -> Hypothesis:
    """The hypothesis without effects that the law's own points have made unnecessary.

    Beside a table that is too coarse for a law, an effect over any state may pay by imitating what
    the table cannot represent: a corner over velocity looks like a gain that differs by direction.
    """
    fewer = without_names(found, h)
    return h if fewer is h else _refined(fewer, site, phi)


def _finer(h: Hypothesis, site: Site) -> Hypothesis:
    """The law with a point between each two, if those that pay are believed."""
    law = h.model.effects_at(h.x)[-1]
    s = np.array(points_of(law.values))[:, 0]
    ends = np.append(s, s[0] + site.period) if site.period > 0.0 else s
    wide = np.diff(ends) > NARROWEST * (ends[-1] - ends[0])
    at = np.sort(np.concatenate([s, (0.5 * (ends[1:] + ends[:-1]))[wide]]))
    if at.size > KNOTS or at.size == s.size:
        return h
    more = table(site.effect, site.at, at, law_at(law, at), is_odd(law), site.period)
    other = _in_its_place(h, site, more)
    if other is None or not np.isfinite(other.cost.total):
        return h
    gained = _promise([(h, site)]) - _promise([(other, site)])
    return other if gained > 2.0 * against(other, h).phi * math.log(1.0 / ALPHA) else h


def _without_changes(h: Hypothesis) -> Hypothesis:
    """The hypothesis without its changes, unless these are believed over constancy."""
    if not h.model.varies:
        return h
    model, x = h.model.constant(h.x)
    with suppress(NoObserver):
        same = settled(judged(h.experiments, model, x, h.family))
        if not believed(h.cost, same.cost, against(h, same).phi):
            return same
    return h


def _turning(h: Hypothesis, site: Site) -> Begun:
    """The law as a periodic one, if one period with the points that pay costs less."""
    best = h, site
    for law, scale in turns_of(h):
        there = replace(site, period=law.values["period"], scale=scale)
        other = _in_its_place(h, there, law)
        if other is not None and _promise([(other, there)]) < _promise([best]):
            best = other, there
    return best


def _refined(h: Hypothesis, site: Site, phi: float) -> Hypothesis:
    return refined(h, phi, partial(_shaped, site=site), partial(_finer, site=site))


def _as_the_file_counts(h: Hypothesis, site: Site) -> Hypothesis:
    """The same law over the position of a mass on a spring, with the device file's origin.

    With q = y - d, d another origin and k the spring, -k q + f(q) = -k y + (f(y - d) + k d). So the
    curve shifted by d plus a constant k d is equivalent, and the data do not decide. Limits: only
    for the first mass, and if no other effect is present.
    """
    law, swings = h.model.effects_at(h.x)[-1], {e.swing for e in h.experiments}
    k = h.model.build(h.x).chain.ground_spring
    moves = site.effect == "free_spring" and site.at == "m1" and k > 0.0 and not is_odd(law)
    if not moves or len(h.model.effects) > 1 or len(swings) > 1:
        return h
    by = h.model.reads(h.x).origin * swings.pop()
    s, f = np.array(points_of(law.values)).T
    moved = table(site.effect, site.at, s + by, f + k * by, False, law.values["period"])
    model, x = h.model.less(h.x, len(h.model.effects) - 1)
    return said_as(h, *beside(model, from_nothing(model, x), site, moved))


def from_nothing(model: Model, x: Floats) -> Floats:
    """Return x with the origin of positions of the device file."""
    return np.where([p.kind == "origin" for p in model.parameters], 0.0, x)


def said_as(h: Hypothesis, model: Model, x: Floats) -> Hypothesis:
    """Return the model at x in place of a hypothesis if it is equivalent, else the hypothesis."""
    near = h.family.near(h.ratio)
    other = judged(h.experiments, model, model.within(x), h.family, near, h.prices)
    return priced(other) if abs(other.cost.misfit - h.cost.misfit) < SAME else h


def _shaped(h: Hypothesis, phi: float, site: Site) -> Hypothesis:
    """The same law with the points that pay, odd if that costs less."""
    best = h
    for shape in shapes(h, site.states, phi):
        other = _in_its_place(h, site, shape.law)
        if other is not None and tempered(other, phi) < tempered(best, phi):
            best = other
    return best


def as_learned(h: Hypothesis, site: Site, without: Hypothesis, found: Search) -> Learned:
    """Return the last law of a hypothesis in the form of the answer."""
    law = h.model.effects_at(h.x)[-1]
    seen = states_of(h, predicted_states(h.problem, h.fitted), site.effect, site.at)
    count = len(points_of(law.values))
    index = len(h.model.effects) - 1
    own = [
        (j, FORCE.index(p.key), p.scale)
        for j, p in enumerate(h.model.parameters)
        if p.kind == "effect" and p.index == index and p.key in FORCE
    ]
    which, points, scales = (np.array(column) for column in zip(*own, strict=True))
    states = np.array([law.values[key] for key in AT[:count]])
    spread = _spread(h, site, which, scales, states[points])
    known = np.zeros((count, count))
    known[np.ix_(points, points)] = spread
    known += np.diag(left_out(law) ** 2)
    half = Z95 * np.sqrt(np.diag(known))
    forces = np.array([law.values[key] for key in FORCE[:count]])
    if site.floats and not is_odd(law):  # any constant is equivalent
        known += float(np.ptp(forces)) ** 2
    beside = {f"{p.effect.name} at {p.at}" for p in h.model.effects[:-1]}
    names = tuple(sorted(beside))
    gone = [p for p in found.best.model.effects if f"{p.effect.name} at {p.at}" not in beside]
    absorbed = tuple(
        f"{p.effect.name} at {p.at}" for p in gone if follows(p, law.effect.name, law.place)
    )
    return Learned(
        law, states, forces, forces - half, forces + half, known, seen, names, absorbed,
        tuple(f"{p.effect.name} at {p.at}" for p in gone),
        _together(h, law, seen), without.cost.total - h.cost.total, h,
    )  # fmt: skip


def _spread(
    h: Hypothesis, site: Site, which: NDArray[np.int64], scales: Floats, s: Floats
) -> Floats:
    """Covariance (points, points) of the free part of a law, at states s (points,).

    A law u + f(u) over the command is known up to a scale c, since c u + c f(u) = u + g(u). The
    shape is given for the fitted m1; c only adds a straight line.
    """
    told = covariance(h.fitted)[np.ix_(which, which)] * np.outer(scales, scales)
    if site.effect != "free_amplifier":
        return told
    own = covariance_beside(h.fitted, [0])[np.ix_(which, which)] * np.outer(scales, scales)
    slope = float(s @ told @ s) / float(s @ s) ** 2
    return own + slope * np.outer(s, s)


def _together(h: Hypothesis, law: Physics, seen: Floats) -> Together | None:
    """The sum of a table and the named effects over the same state at the same place."""
    at = points_over(seen, LAWS.points, False)
    if at is None or law.values["period"] > 0.0:
        return None
    return together(h.fitted, law.effect.name, law.place, at[at != 0.0])

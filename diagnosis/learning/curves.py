"""A law of no name, learned: a table over one state at one place, fitted like any effect.

Where no name is adequate, what is missing is let in as a table of points (`sim/physics/free_law`):
over position or velocity at each mass, over what each link gives way, over the command, and over
one turn of what a ripple repeats by. Which of these explains most is told by least squares off the
refit's span (`forces.unknown`), under the likeliest observer and under a slower one that takes less
for disturbance. The best are fitted to their end, observer and linear parameters with them, and
cost what every hypothesis costs.

Names come first, and under a law that none of them is they take what they can of it: friction the
step of a piecewise line. So the table is fitted beside the names and in the place of all of them,
each with as many points as a table has; and of the names beside it each is asked, by the one
criterion of `selection.evidence`, whether it is believed over its absence now that the table may
take its part. What is not goes: it was part of the curve. Then the table keeps the points that pay
(`knots`). What follows the same state at the same place still, is one law with it for whoever reads
it (`together`): the curve of both is known better than either.

Limits: one state at one place; a law of two, or of time, is found as far as one shows it. What is
steep near rest no table holds, and friction stays a name. The straight part of a table of velocity
is a damper, that of a table of position a spring: what of it is which, only the device file says.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.uncertainty import Z95, covariance
from zwidth.diagnosis.forces.leftover import predicted_states
from zwidth.diagnosis.forces.unknown import views_of, weigh
from zwidth.diagnosis.learning.knots import one_way, shapes, tempered
from zwidth.diagnosis.learning.steady import along
from zwidth.diagnosis.learning.tables import is_odd, law_at, points_over, table
from zwidth.diagnosis.learning.together import Together, follows, together
from zwidth.diagnosis.mishaps import Say, attempt
from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.seeking.sizes import sizes_of
from zwidth.diagnosis.selection.evidence import believed
from zwidth.diagnosis.selection.hypothesis import Hypothesis, against, judged, settled
from zwidth.diagnosis.selection.search import Search
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_law import AT, FORCE, KNOTS, points_of
from zwidth.sim.place import place_at

Floats = NDArray[np.float64]
LAWS = {"position": "free_spring", "velocity": "free_damper", "command": "free_amplifier"}
FIRST, FIRST_ODD = 7, 5  # points of a first fit
OF_A_TURN = 12  # points of what repeats: a ripple of six periods a turn
ASKED = 3  # places and states that are fitted, beside each set of names
SHARE = 0.1  # of the force that moves a recording: scale of a point
HOPE = 20.0  # -2 ln, that few points may cost more than names where many are tried
BEHIND = 200.0  # the same, that a law without names may cost more than beside them, of few points
TELLING = KNOTS  # states at which what acts together is worked out: more tell no more


@dataclass(frozen=True)
class Site:
    """Where a law may stand: effect and place, the states seen there (samples,), its period.

    scale: of the period as a parameter, 0 for one that is known.
    """

    effect: str
    at: str
    states: Floats
    period: float = 0.0
    scale: float = 0.0


@dataclass(frozen=True)
class Learned:
    """A law that was learned, with what it is beside the names.

    states, forces, lower, upper (points,): the curve and its 95 % band; covariance (points, points)
    of the forces. seen (samples,): the states that were visited. names: that stay beside it;
    absorbed: that were part of the curve, as it turned out. together: the curve with the names that
    follow the same state there, None where none does. one_way: whether it is held to rise or fall.
    gained: over the names alone, in -2 ln, all paid.
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
    together: Together | None
    gained: float
    hypothesis: Hypothesis

    @property
    def odd(self) -> bool:
        """Whether f(-s) = -f(s): then the table is of |s|."""
        return is_odd(self.physics)

    @property
    def period(self) -> float:
        """Of a law that repeats; 0 for none."""
        return self.physics.values["period"]

    @property
    def one_way(self) -> bool:
        """Whether it only rises, or only falls."""
        steps = np.diff(self.forces)
        return self.period == 0.0 and bool(np.all(steps >= 0.0) or np.all(steps <= 0.0))

    def named_at(self, states: Floats) -> Floats:
        """Return what the names that follow its state at its place give at states (points,)."""
        h = self.hypothesis
        given = [
            along(p, self.physics.effect.name, states)
            for p in h.model.effects_at(h.x)[:-1]
            if p.place.acts_on == self.physics.place.acts_on
        ]
        return np.sum([np.zeros(states.size), *(g for g in given if g is not None)], axis=0)

    @property
    def over(self) -> str:
        """What the law follows, in words."""
        link = self.physics.place.kind == "link"
        name = self.physics.effect.name
        if name == "free_spring":
            return "what the link gives way" if link else "position"
        return {"free_damper": "rate of the link" if link else "velocity"}.get(name, "command")


Begun = tuple[Hypothesis, Site]


def learn(found: Search, say: Say) -> Learned | None:
    """Return the law of no name that costs least of those believed over the names, or None."""
    return next(laws(found, say), None)


def laws(found: Search, say: Say, turns: bool = False) -> Iterator[Learned]:
    """Yield laws of no name that are believed over the names, each of another place or state.

    The order is that of what few points promise. turns: only what repeats, in a ripple's place.
    """
    bases = [found.best] + [found.plain] * bool(found.best.model.effects)
    least = min(bases, key=lambda h: h.cost.total)
    begun: dict[tuple[str, str, float], list[Begun]] = {}
    for base in bases:
        for h, site in [] if turns else _over_states(base, say):
            begun.setdefault((site.effect, site.at, 0.0), []).append((h, site))
        for h, site in _over_turns(base, say):
            begun.setdefault((site.effect, site.at, site.period), []).append((h, site))
    for each in sorted(begun.values(), key=lambda each: min(h.cost.total for h, _ in each)):
        first = min(h.cost.total for h, _ in each)
        if first > least.cost.total + HOPE:  # more points cost more, and gain as much seldom
            break
        likely = [(h, site) for h, site in each if h.cost.total < first + BEHIND]
        full = [(_without_names(found, _full(h, site)), site) for h, site in likely]
        phi = against(min((h for h, _ in full), key=lambda h: h.cost.total), least).phi
        shaped = [(_shaped(h, site, phi), site) for h, site in full]
        best = min(shaped, key=lambda one: tempered(one[0], phi))
        if not found.ahead(best[0], least) or _is_line(*best, say):
            continue
        yield _learned(one_way(best[0], phi), best[1], least, found)


def _is_line(h: Hypothesis, site: Site, say: Say) -> bool:
    """Whether a straight line does as well in a law's place, which is then none."""
    rival = None if site.period > 0.0 else _in_its_place(h, site, _line(h, site))
    if rival is None or believed(h.cost, rival.cost, against(h, rival).phi):
        return False
    say("a straight line would do as well: that is no law, but a spring, a damper or a scale")
    return True


def _over_states(base: Hypothesis, say: Say) -> Iterator[Begun]:
    """Yield laws of few points beside what a hypothesis has, where they would gain most."""
    sites = None if base.slopes is None else attempt("learn", "where", partial(_sites, base))
    for site in sites or ():
        say(f"learning a law over {site.effect.removeprefix('free_')} at {site.at}")
        shaped = [_law(site, FIRST, False), _law(site, FIRST_ODD, True)]
        fitted = [_fitted(base, site, law) for law in shaped if law is not None]
        told = [h for h in fitted if h is not None]
        if told:
            yield min(told, key=lambda h: h.cost.total), site


def _over_turns(base: Hypothesis, say: Say) -> Iterator[Begun]:
    """Yield laws of one turn in the place of each ripple of a hypothesis.

    A ripple is one sine of what repeats; what repeats may have any shape.
    """
    for i, p in enumerate(base.model.effects_at(base.x)):
        if base.slopes is None or p.effect.name != "force_ripple" or p.place.kind != "mass":
            continue
        moved = predicted_states(base.problem, base.fitted)
        scale = base.model.scales[i].get("period", 0.0)
        states = _states(base, moved, "free_spring", p.at)
        site = Site("free_spring", p.at, states, p.values["period"], scale)
        say(f"learning what repeats every {site.period:.3g} at {site.at}")
        model, x = base.model.less(base.x, i)
        law = _law(site, OF_A_TURN, False)
        h = None if law is None else _fitted(replace(base, model=model, x=x), site, law)
        if h is not None:
            yield h, site


def _sites(base: Hypothesis) -> list[Site]:
    """Where a law would gain most, to first order, under two observers."""
    problem, fitted = base.problem, base.fitted
    gained: dict[tuple[str, str], float] = {}
    for view, there in views_of(problem, fitted):
        for place, state, surplus in weigh(view, there):
            if state in LAWS:
                at = "command" if state == "command" else place
                key = LAWS[state], at
                gained[key] = max(gained.get(key, 0.0), surplus)
    moved = predicted_states(problem, fitted)
    present = {(p.effect.name, p.at) for p in base.model.effects}
    order = sorted((k for k in gained if k not in present), key=lambda k: -gained[k])
    every = [Site(effect, at, _states(base, moved, effect, at)) for effect, at in order[:ASKED]]
    return [site for site in every if np.ptp(site.states) > 0.0]


def _states(base: Hypothesis, moved: Sequence[Floats], effect: str, at: str) -> Floats:
    """The states (samples,) that a law would follow, as the model predicts them."""
    n = base.model.build(base.x).chain.masses.size
    if effect == "free_amplifier":
        return np.concatenate([e.command[SETTLING:] for e in base.experiments])
    i, j = place_at(at).ends
    first = n if effect == "free_damper" else 0
    own = [x[SETTLING:, first + i] - (x[SETTLING:, first + j] if j >= 0 else 0.0) for x in moved]
    return np.concatenate(own)


def _law(site: Site, count: int, odd: bool, like: Physics | None = None) -> Physics | None:
    """A law of so many points, of nothing or as another is; None where an odd one has no sense."""
    at = points_over(site.states, count, odd, site.period)
    if at is None:
        return None
    force = np.zeros(count) if like is None else law_at(like, at)
    if odd:
        force[0] = 0.0
    return table(site.effect, site.at, at, force, odd, site.period)


def _line(h: Hypothesis, site: Site) -> Physics:
    """The line through the origin that is nearest to the law that a hypothesis has last.

    A spring, a damper or a scale is that. It begins where the law is: a law over the command may
    have taken most of its scale away, in a valley that no fit reaches from nothing.
    """
    force, most = law_at(h.model.effects_at(h.x)[-1], site.states), np.abs(site.states).max()
    slope = float(force @ site.states) / float(site.states @ site.states)
    ends = np.array([0.0, float(most)])
    return table(site.effect, site.at, ends, slope * ends, True)


def _fitted(
    base: Hypothesis, site: Site, law: Physics, x: Floats | None = None
) -> Hypothesis | None:
    """A law beside what a hypothesis has, fitted; None where no observer follows.

    x: where its other parameters begin, those of the hypothesis without.
    """
    gain = base.model.reads(base.x).gain
    sizes = sizes_of(base.model.build(base.x), base.experiments, gain)
    scale = SHARE * sizes.force
    if scale == 0.0:  # nothing drives: there is no force to measure a law by
        return None
    count = len(points_of(law.values))
    scales = dict.fromkeys(FORCE[int(is_odd(law)) : count], scale)
    scales |= {"period": site.scale} if site.scale > 0.0 and law.values["period"] > 0.0 else {}
    model = base.model.with_effect(law, scales)
    start = np.concatenate([base.x if x is None else x, np.zeros(len(scales))])
    try:
        begun = judged(base.experiments, model, model.within(start), base.family)
        return settled(begun)
    except NoObserver:
        return None


def _in_its_place(h: Hypothesis, site: Site, law: Physics) -> Hypothesis | None:
    """Another law in the place of the one that a hypothesis has last, fitted."""
    model, own = h.model.less(h.x, len(h.model.effects) - 1)
    return _fitted(replace(h, model=model, x=own), site, law, own)


def _full(h: Hypothesis, site: Site) -> Hypothesis:
    """The same law with as many points as a table has."""
    law = h.model.effects_at(h.x)[-1]
    count = OF_A_TURN if site.period > 0.0 else KNOTS
    more = _law(site, count, False, law) if count > len(points_of(law.values)) else None
    other = None if more is None else _in_its_place(h, site, more)
    told = other is not None and np.isfinite(other.cost.total)
    return other if other is not None and told else h


def _without_names(found: Search, h: Hypothesis) -> Hypothesis:
    """The same without names that are not believed over their absence, one after the other."""
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


def _shaped(h: Hypothesis, site: Site, phi: float) -> Hypothesis:
    """The same law with the points that pay, odd where that is likelier."""
    best = h
    for shape in shapes(h, site.states, phi):
        other = _in_its_place(h, site, shape.law)
        if other is not None and tempered(other, phi) < tempered(best, phi):
            best = other
    return best


def _learned(h: Hypothesis, site: Site, without: Hypothesis, found: Search) -> Learned:
    law = h.model.effects_at(h.x)[-1]
    seen = _states(h, predicted_states(h.problem, h.fitted), site.effect, site.at)
    count = len(points_of(law.values))
    index = len(h.model.effects) - 1
    own = [
        (j, FORCE.index(p.key), p.scale)
        for j, p in enumerate(h.model.parameters)
        if p.kind == "effect" and p.index == index and p.key in FORCE
    ]
    which, points, scales = (np.array(column) for column in zip(*own, strict=True))
    spread = covariance(h.fitted)[np.ix_(which, which)] * np.outer(scales, scales)
    known = np.zeros((count, count))
    known[np.ix_(points, points)] = spread
    half = Z95 * np.sqrt(np.diag(known))
    states = np.array([law.values[key] for key in AT[:count]])
    forces = np.array([law.values[key] for key in FORCE[:count]])
    beside = {f"{p.effect.name} at {p.at}" for p in h.model.effects[:-1]}
    names = tuple(sorted(beside))
    gone = [p for p in found.best.model.effects if f"{p.effect.name} at {p.at}" not in beside]
    absorbed = tuple(
        f"{p.effect.name} at {p.at}" for p in gone if follows(p, law.effect.name, law.place)
    )
    return Learned(
        law, states, forces, forces - half, forces + half, known, seen, names, absorbed,
        _together(h, law, seen), without.cost.total - h.cost.total, h,
    )  # fmt: skip


def _together(h: Hypothesis, law: Physics, seen: Floats) -> Together | None:
    """What a table and the names that follow its state at its place give together."""
    at = points_over(seen, TELLING, False)
    if at is None or law.values["period"] > 0.0:
        return None
    return together(h.fitted, law.effect.name, law.place, at[at != 0.0])

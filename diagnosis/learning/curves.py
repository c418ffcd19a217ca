"""A law of no name, learned: a table over one state at one place, fitted like any effect.

Where no name is adequate, what is missing is let in as a table of points (`sim/physics/free_law`):
over position or velocity at each mass, over what each link gives way, over the command. Which of
these explains most is told by least squares off the refit's span (`forces.unknown`), under the
likeliest observer and under a slower one that takes less for disturbance. The best are fitted to
their end, observer and linear parameters with them, and cost what every hypothesis costs: so many
points as they pay for, one half of them where the law may be odd.

It is fitted beside the names that are believed and in the place of all of them, since a name that
came near a law of none stands in its way. What a table absorbs of names (a table of velocity holds
friction) is said by that: names come first, and stay where both together cost less.

Limits: one state at one place; a law of two, or of time, is found as far as one shows it. A law
that is steep near rest (friction) is one of the names. The straight part of a table of velocity is
a damper, that of a table of position a spring: what of it is which, only the device file says.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from zwidth.diagnosis.fitting.uncertainty import Z95, covariance
from zwidth.diagnosis.forces.leftover import predicted_states
from zwidth.diagnosis.forces.unknown import views_of, weigh
from zwidth.diagnosis.mishaps import Say, attempt
from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.seeking.sizes import sizes_of
from zwidth.diagnosis.selection.evidence import believed
from zwidth.diagnosis.selection.hypothesis import Hypothesis, against, judged, settled
from zwidth.diagnosis.selection.search import Search
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_law import AT, FORCE, KNOTS, points_of, table_values
from zwidth.sim.place import place_at

Floats = NDArray[np.float64]
LAWS = {"position": "free_spring", "velocity": "free_damper", "command": "free_amplifier"}
FIRST = 7  # points of a first fit
COUNTS = (4, 5, 10, KNOTS)  # points of those after it
ODD_COUNTS = (3, 5, 8, 12)
ASKED = 3  # places and states that are fitted, beside each set of names
SHARE = 0.1  # of the force that moves a recording: scale of a point
BOTH_WAYS = 0.3  # of the largest state on one side, that the other must reach for an odd law
AKIN = 10.0  # -2 ln, within which the shape with fewer points is preferred


@dataclass(frozen=True)
class Site:
    """Where a law may stand: effect and place, and the states seen there, (samples,)."""

    effect: str
    at: str
    states: Floats


@dataclass(frozen=True)
class Learned:
    """A law that was learned, with what it is beside the names.

    states, forces, lower, upper (points,): the curve and its 95 % band; covariance (points, points)
    of the forces. seen (samples,): the states that were visited. names: that stay beside it.
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
    gained: float
    hypothesis: Hypothesis

    @property
    def odd(self) -> bool:
        """Whether f(-s) = -f(s): then the table is of |s|."""
        return self.physics.values["odd"] > 0.5

    @property
    def over(self) -> str:
        """What the law follows, in words."""
        link = self.physics.place.kind == "link"
        name = self.physics.effect.name
        if name == "free_spring":
            return "what the link gives way" if link else "position"
        return {"free_damper": "rate of the link" if link else "velocity"}.get(name, "command")


def learn(found: Search, say: Say) -> Learned | None:
    """Return the law of no name that is believed over the names, None where none is."""
    bases = [found.best] + [found.plain] * bool(found.best.model.effects)
    least = min(bases, key=lambda h: h.cost.total)
    best: tuple[Hypothesis, Site] | None = None
    for base in bases:
        if base.slopes is None:
            continue
        for site in attempt("learn", "where", partial(_sites, base)) or ():
            say(f"learning a law over {site.effect.removeprefix('free_')} at {site.at}")
            for odd in (False, True):
                law = _law(site, FIRST if not odd else ODD_COUNTS[1], odd)
                h = None if law is None else _fitted(base, site, law)
                if h is not None and (best is None or h.cost.total < best[0].cost.total):
                    best = h, site
    if best is None:
        return None
    best = _shaped(*best), best[1]
    if not found.ahead(best[0], least):
        return None
    rival = _in_its_place(*best, _line(*best))
    if rival is not None and not believed(best[0].cost, rival.cost, against(best[0], rival).phi):
        say("a straight line would do as well: that is no law, but a spring, a damper or a scale")
        return None
    return _learned(*best, least)


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
    s = site.states
    low, high = float(s.min()), float(s.max())
    if odd and min(-low, high) < BOTH_WAYS * max(-low, high):
        return None
    seen = np.abs(s) if odd else s
    share = np.linspace(0.0, 1.0, count)
    # Half by where it was, half evenly: the ends are where a law shows, and are seldom visited.
    even = (0.0 if odd else low) + share * (max(-low, high) if odd else high - low)
    at = 0.5 * (np.quantile(seen, share) + even)
    at[0], at[-1] = even[0], even[-1]
    force = np.zeros(count) if like is None else law_at(like, at)
    if odd:
        force[0] = 0.0
    if np.any(np.diff(at) <= 0.0):
        return None
    points = list(zip(at.tolist(), force.tolist(), strict=True))
    return make_physics(site.effect, site.at, **table_values(points, odd))


def _line(h: Hypothesis, site: Site) -> Physics:
    """The line through the origin that is nearest to the law that a hypothesis has last.

    A spring, a damper or a scale is that. It begins where the law is: a law over the command may
    have taken most of its scale away, in a valley that no fit reaches from nothing.
    """
    force, most = law_at(h.model.effects_at(h.x)[-1], site.states), np.abs(site.states).max()
    slope = float(force @ site.states) / float(site.states @ site.states)
    points = [(0.0, 0.0), (float(most), slope * float(most))]
    return make_physics(site.effect, site.at, **table_values(points, odd=True))


def law_at(law: Physics, states: Floats) -> Floats:
    """Return a law of no name at some states (...,)."""
    s, f = np.array(points_of(law.values)).T
    if law.values["odd"] > 0.5:
        s, f = np.concatenate([-s[:0:-1], s]), np.concatenate([-f[:0:-1], f])
    smooth = CubicHermiteSpline(s, f, np.gradient(f, s, edge_order=1 if s.size == 2 else 2))
    return np.asarray(smooth(np.clip(states, s[0], s[-1])))


def _fitted(
    base: Hypothesis, site: Site, law: Physics, x: Floats | None = None
) -> Hypothesis | None:
    """A law beside what a hypothesis has, fitted; None where no observer follows.

    x: where its other parameters begin, those of the hypothesis without.
    """
    sizes = sizes_of(base.model.build(base.x), base.experiments)
    scale = SHARE * sizes.force
    count = len(points_of(law.values))
    free = FORCE[1:count] if law.values["odd"] > 0.5 else FORCE[:count]
    model = base.model.with_effect(law, dict.fromkeys(free, scale))
    start = np.concatenate([base.x if x is None else x, np.zeros(len(free))])
    try:
        begun = judged(base.experiments, model, model.within(start), base.family)
        return settled(begun)
    except NoObserver:
        return None


def _in_its_place(h: Hypothesis, site: Site, law: Physics) -> Hypothesis | None:
    """Another law in the place of the one that a hypothesis has last, fitted."""
    model, own = h.model.less(h.x, len(h.model.effects) - 1)
    return _fitted(replace(h, model=model, x=own), site, law, own)


def _shaped(h: Hypothesis, site: Site) -> Hypothesis:
    """The same law with as many points as pay, odd where that is likelier."""
    law = h.model.effects_at(h.x)[-1]
    best = h
    for count, odd in [*((c, False) for c in COUNTS), *((c, True) for c in ODD_COUNTS)]:
        shape = _law(site, count, odd, law)
        if shape is None or (len(points_of(law.values)), law.values["odd"] > 0.5) == (count, odd):
            continue
        other = _in_its_place(h, site, shape)
        if other is not None and other.cost.total < best.cost.total:
            best = other
    return _without_names(best)


def _without_names(h: Hypothesis) -> Hypothesis:
    """The same without names that the law makes too dear, one after the other."""
    while len(h.model.effects) > 1:
        fewer: list[Hypothesis] = []
        for i in range(len(h.model.effects) - 1):
            model, x = h.model.less(h.x, i)
            with suppress(NoObserver):
                fewer.append(settled(judged(h.experiments, model, x, h.family)))
        cheapest = min(fewer, key=lambda other: other.cost.total, default=h)
        if cheapest.cost.total >= h.cost.total:
            break
        h = cheapest
    return h


def _learned(h: Hypothesis, site: Site, without: Hypothesis) -> Learned:
    law = h.model.effects_at(h.x)[-1]
    count = len(points_of(law.values))
    index = len(h.model.effects) - 1
    own = [
        (j, FORCE.index(p.key), p.scale)
        for j, p in enumerate(h.model.parameters)
        if p.kind == "effect" and p.index == index
    ]
    which, points, scales = (np.array(column) for column in zip(*own, strict=True))
    spread = covariance(h.fitted)[np.ix_(which, which)] * np.outer(scales, scales)
    known = np.zeros((count, count))
    known[np.ix_(points, points)] = spread
    half = Z95 * np.sqrt(np.diag(known))
    states = np.array([law.values[key] for key in AT[:count]])
    forces = np.array([law.values[key] for key in FORCE[:count]])
    names = tuple(f"{p.effect.name} at {p.at}" for p in h.model.effects[:-1])
    return Learned(
        law, states, forces, forces - half, forces + half, known, site.states, names,
        without.cost.total - h.cost.total, h,
    )  # fmt: skip

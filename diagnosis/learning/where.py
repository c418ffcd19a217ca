"""Where a learned law would improve the fit most: tries a table of many points at each place.

To each hypothesis a table of zeros is added, at every place over every state that it may depend on,
with `LAWS.points` points, and fitted for a few rounds: with the noise of the hypothesis, and with a
slower observer, which attributes less of a law to disturbance. The resulting likelihoods, each with
its own most likely noise, show where a law may be. A first-order test would not: if much is
missing, the residual is far from white, its slow part also depends on the initial state, and every
state seems to explain it.

A law over a state that never returns (the position of a motor that turns one way) would also be a
law over time and everything that changes with it. So only periodic laws are sought there.

Limits: a law that changes the motion completely is not found in so few rounds.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.descend import descend
from zwidth.diagnosis.forces.leftover import predicted_states
from zwidth.diagnosis.learning.tables import is_odd, points_over, table
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.seeking.sizes import sizes_of
from zwidth.diagnosis.selection.hypothesis import Hypothesis, judged
from zwidth.diagnosis.settings import LAWS
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_law import FORCE, points_of
from zwidth.sim.physics.sizes import WAVES
from zwidth.sim.place import masses_and_links, place_at

Floats = NDArray[np.float64]
SHARE = 0.1  # scale of a point, over the force that moves a recording, or the motion
RATIOS = (1.0, 1e-3)  # ratios of observers in first fits of laws, over the most likely one
ROUNDS = 4
CLOSES = 1e-3  # of a period: its least distance beyond the last point


def anywhere(effect: str, at: str) -> bool:
    """Accept every law at every place."""
    return bool(effect and at)


@dataclass(frozen=True)
class Site:
    """A candidate for a law: effect and place, the visited states (samples,), and the period.

    scale: of the period as a parameter, 0 if it is fixed. makes: prior size of a point of the
    table. floats: whether a constant is equivalent to another origin of positions; one point is
    then fixed.
    """

    effect: str
    at: str
    states: Floats
    period: float = 0.0
    scale: float = 0.0
    makes: float = 1.0
    floats: bool = False


def sites(
    base: Hypothesis, most: int, asked: Callable[[str, str], bool] = anywhere
) -> list[tuple[Site, Hypothesis]]:
    """Return the wanted (`asked`) sites where a law gains most, each with its start, best first."""
    found: list[tuple[Site, Hypothesis]] = []
    for site in _every(base):
        if not asked(site.effect, site.at):
            continue
        law = law_over(site, LAWS.points, False)
        h = None if law is None else begun(base, *beside(base.model, base.x, site, law))
        if h is not None and h.cost.misfit < base.cost.misfit:
            found.append((site, h))
    return sorted(found, key=lambda one: one[1].cost.misfit)[:most]


def begun(base: Hypothesis, model: Model, x: Floats) -> Hypothesis | None:
    """Return a model after some rounds of a fit with the better of two observers, or None."""
    with suppress(NoObserver):
        own = base.family.of(base.ratio)
        first = judged(base.experiments, model, model.within(x), base.family, own)
        found = [first]
        for share in RATIOS if base.family.whitening else RATIOS[:1]:
            with suppress(NoObserver):
                there = first.under(share * first.ratio)
                ended = descend(there.far_ground, first.x, ROUNDS, first.creased, first=True)
                found.append(there.moved(ended.x))
        return min(found, key=lambda h: h.cost.misfit)
    return None


def site_at(base: Hypothesis, moved: Sequence[Floats], effect: str, at: str) -> Site:
    """Return the site of a law; moved: predicted positions and velocities (ticks, 2n)."""
    gain = base.model.reads(base.x).gain
    sizes = sizes_of(base.model.build(base.x), base.experiments, gain)
    made = max(e.swing for e in base.experiments) if effect == "free_sensor" else sizes.force
    states = states_of(base, moved, effect, at)
    return Site(effect, at, states, makes=SHARE * made, floats=_floats(base, effect, at))


def _floats(base: Hypothesis, effect: str, at: str) -> bool:
    """Whether a constant in a law is equivalent to another origin.

    With a spring to the ground, a constant force is equivalent to another origin on the first mass,
    and on others if only one position is measured. So is a constant in the command or the reading.
    For a law over a position, another origin also shifts the states, so no point is fixed.
    """
    tied = base.model.build(base.x).chain.ground_spring > 0.0
    if not tied or effect == "free_spring":
        return False
    if effect in ("free_sensor", "free_amplifier"):
        return True
    place = place_at(at)
    alone = sum(o.tells_position for o in base.experiments[0].outputs) == 1
    return place.kind == "mass" and (place.index == 0 or alone)


def held(count: int) -> int:
    """Return which point of a table is fixed if a constant is equivalent to another origin."""
    return count // 2


def states_of(base: Hypothesis, moved: Sequence[Floats], effect: str, at: str) -> Floats:
    """Return the states (samples,) that a law would depend on, as the model predicts them."""
    return np.concatenate(_states_in(base, moved, effect, at))


def _states_in(base: Hypothesis, moved: Sequence[Floats], effect: str, at: str) -> list[Floats]:
    """The same states in each recording."""
    n = base.model.build(base.x).chain.masses.size
    if effect == "free_amplifier":
        return [e.command[SETTLING:] for e in base.experiments]
    i, j = (0, -1) if effect == "free_sensor" else place_at(at).ends
    first = n if effect == "free_damper" else 0
    return [x[SETTLING:, first + i] - (x[SETTLING:, first + j] if j >= 0 else 0.0) for x in moved]


def comes_back(each: Sequence[Floats]) -> bool:
    """Whether the states of recordings are visited again, so that they do not only measure time."""
    way = sum(float(np.abs(np.diff(states)).sum()) for states in each)
    return way > LAWS.comes_back * float(np.ptp(np.concatenate(each)))


def law_over(site: Site, count: int, odd: bool) -> Physics | None:
    """Return a zero law with at most `count` points; None if the samples do not suffice."""
    at = points_over(site.states, count, odd, site.period)
    if at is None:
        return None
    return table(site.effect, site.at, at, np.zeros(at.size), odd, site.period)


def beside(base: Model, x: Floats, site: Site, law: Physics) -> tuple[Model, Floats]:
    """Return a model with a law, and its x."""
    count = len(points_of(law.values))
    free = FORCE[int(is_odd(law)) : count]
    scales = dict.fromkeys(free, site.makes)
    if site.floats and not is_odd(law):
        scales.pop(FORCE[held(count)])
    bounds: dict[str, tuple[float, float]] = {}
    if site.scale > 0.0 and law.values["period"] > 0.0:
        states = [s for s, _ in points_of(law.values)]
        least = states[-1] - states[0]  # the table covers one period only
        scales["period"] = site.scale
        most = max(float(np.ptp(site.states)) / WAVES, law.values["period"])
        bounds["period"] = ((1.0 + CLOSES) * least, most)
    return with_law(base, x, law, scales, bounds)


def with_law(
    base: Model,
    x: Floats,
    law: Physics,
    scales: Mapping[str, float],
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> tuple[Model, Floats]:
    """Return a model with a law of which some numbers are free, and its x."""
    return base.with_effect(law, scales, bounds or {}), base.beside(x, np.zeros(len(scales)))


def _every(base: Hypothesis) -> list[Site]:
    """All places and states of a law of one state where there is none yet."""
    chain = base.model.build(base.x).chain
    asked = [(effect, str(place)) for place in masses_and_links(chain.masses.size)
             for effect in ("free_spring", "free_damper")]  # fmt: skip
    asked.append(("free_amplifier", "command"))
    first = base.experiments[0].outputs[0]
    if first.tells_position and first.mass == 0:
        asked.append(("free_sensor", "sensor"))
    present = {(p.effect.name, p.at) for p in base.model.effects}
    moved = predicted_states(base.problem, base.fitted)
    every = [
        site_at(base, moved, *one)
        for one in asked
        if one not in present and comes_back(_states_in(base, moved, *one))
    ]
    # Without a drive, no force gives the size of a law.
    return [site for site in every if np.ptp(site.states) > 0.0 and site.makes > 0.0]

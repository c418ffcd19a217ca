"""Where a law of no name may stand, whether it would gain there, and where its fit begins.

A law of nothing is let in at every place over every state that one may follow there (over two, a
small grid over every pair), and the slopes of all its numbers are asked in one call. Points that
pay are told from them (`fewer`): where not even these are believed to first order, under the noise
of a hypothesis or under a slower one, which takes less of a law for disturbance, no law is sought.
That is a few dozen predictions of the recordings for each place, where a fit takes a thousand.

To first order it is told that something leads, and not what: where much is missing a residual is
far from white, and any state seems to lead it. So what is left goes downhill for a few rounds under
both noises; what is likelier then tells where a law may be. Limits: a law that turns the motion
over is not reached in so few rounds.

Of a state that never comes back (the position of a motor that turns one way) a law over it is one
of time, and of anything else that happens in that order: no law is sought there, but for what
repeats.

Of two states a product is begun at the first singular vectors of a grid that went downhill, and a
law of one state that the other shifts along the likeliest straight line of both.
"""

import math
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.descend import CREASED, SMOOTH, descend, slopes_at
from zwidth.diagnosis.fitting.landscape import Landscape
from zwidth.diagnosis.forces.leftover import predicted_states
from zwidth.diagnosis.laws.fewer import Begun, Known, cheapest, known
from zwidth.diagnosis.laws.forms import (
    TABLES,
    Form,
    GridForm,
    ProductForm,
    ShiftForm,
    Site,
    form_of,
    grid,
)
from zwidth.diagnosis.laws.points import points_over
from zwidth.diagnosis.laws.steady import along
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.predictor import SCREENING, SETTLING
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.seeking.sizes import sizes_of
from zwidth.diagnosis.selection.hypothesis import Hypothesis, priced
from zwidth.diagnosis.settings import EVIDENCE, LAWS
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_force import counts_at
from zwidth.sim.physics.two_tables import LAW_FIRST
from zwidth.sim.place import masses_and_links, place_at

Floats = NDArray[np.float64]
PAIRS = (("position", "velocity"), ("position", "command"), ("velocity", "command"))
WORTH = 2.0 * math.log(1.0 / EVIDENCE.alpha)  # -2 ln, from which one is believed over another


def sites(base: Hypothesis, two: bool = False) -> list[Site]:
    """Return all places and states that a law may follow: one state each, or two."""
    masses = base.model.build(base.x).chain.masses.size
    places = [str(place) for place in masses_and_links(masses)]
    if two:
        asked = [("free_force", at, over) for at in places for over in PAIRS]
    else:
        asked = [(name, at, (TABLES[name],)) for at in places
                 for name in ("free_spring", "free_damper")]  # fmt: skip
        asked.append(("free_amplifier", "command", ("command",)))
        first = base.experiments[0].outputs[0]
        if first.tells_position and first.mass == 0:
            asked.append(("free_sensor", "sensor", ("position",)))
    present = {(p.effect.name, p.at) for p in base.model.effects}
    moved = predicted_states(base.problem, base.fitted)
    force = _force(base)
    return [
        site_at(base, moved, *one, force)
        for one in asked
        if (one[0], one[1]) not in present and _comes_back(base, moved, *one[1:]) and force > 0.0
    ]  # where nothing drives there is no force to measure a law by


def _force(base: Hypothesis) -> float:
    gain = base.model.reads(base.x).gain
    return sizes_of(base.model.build(base.x), base.experiments, gain).force


def site_at(
    base: Hypothesis,
    moved: Sequence[Floats],
    effect: str,
    at: str,
    over: Sequence[str] = (),
    force: float | None = None,
) -> Site:
    """Return a place for a law, as a hypothesis predicts it.

    moved: of each recording positions and velocities (ticks, 2n); over: its states, of a table the
    one that it follows; force: that moves the recordings, worked out where it is not given.
    """
    over = tuple(over) or (TABLES[effect],)
    force = _force(base) if force is None else force
    made = max(e.swing for e in base.experiments) if effect == "free_sensor" else force
    states = states_seen(base, at, over, moved)
    return Site(effect, at, over, states, 0.1 * made, _floats(base, effect, at, over))


def _floats(base: Hypothesis, effect: str, at: str, over: Sequence[str]) -> bool:
    """Whether a constant in a law is the same as another origin.

    A constant force on a mass that a spring ties to the ground is, as far as positions show: on
    the first mass, and on others where one position alone is measured. So is one in the command,
    which acts on the first mass, and one in the reading. Of a law over a position another origin
    moves the states as well: no point of it is held.
    """
    if not base.model.build(base.x).chain.ground_spring > 0.0:
        return False
    if effect == "free_sensor":
        return True
    place = place_at("m1" if at == "command" else at)
    alone = sum(o.tells_position for o in base.experiments[0].outputs) == 1
    return "position" not in over and place.kind == "mass" and (place.index == 0 or alone)


def _parts(
    base: Hypothesis, moved: Sequence[Floats], at: str, over: Sequence[str]
) -> list[list[Floats]]:
    """Each of some states in each recording (samples,), as a hypothesis predicts them."""
    n = moved[0].shape[1] // 2
    i, j = (0, -1) if at in ("command", "sensor") else place_at(at).ends

    def part(name: str, x: Floats, command: Floats) -> Floats:
        if name == "command":
            return command[SETTLING:]
        first = n if name == "velocity" else 0
        return x[SETTLING:, first + i] - (x[SETTLING:, first + j] if j >= 0 else 0.0)

    both = list(zip(moved, base.experiments, strict=True))
    return [[part(name, x, e.command) for x, e in both] for name in over]


def states_seen(
    base: Hypothesis, at: str, over: Sequence[str], moved: Sequence[Floats] | None = None
) -> Floats:
    """Return the states at a place (samples, over) as a hypothesis predicts them."""
    moved = predicted_states(base.problem, base.fitted) if moved is None else moved
    return np.column_stack([np.concatenate(one) for one in _parts(base, moved, at, over)])


def _comes_back(base: Hypothesis, moved: Sequence[Floats], at: str, over: Sequence[str]) -> bool:
    return all(comes_back(each) for each in _parts(base, moved, at, over))


def comes_back(each: Sequence[Floats]) -> bool:
    """Whether the states of recordings (samples,) are met again, and do not only tell time."""
    way = sum(float(np.abs(np.diff(states)).sum()) for states in each)
    return way > LAWS.comes_back * float(np.ptp(np.concatenate(each)))


def axes_over(site: Site, count: int = 0) -> tuple[Floats, ...] | None:
    """Return so many states along each, or as many as are met; None where one has no range.

    0: as many as a table begins with, of one turn for six harmonics.
    """
    count = count or (12 if site.period > 0.0 else 16)
    found = [points_over(seen, count, False, site.period) for seen in site.states.T]
    axes = tuple(at for at in found if at is not None)
    return axes if len(axes) == len(found) else None


def of_nothing(site: Site, count: int = 0) -> Physics | None:
    """Return a law of points as `axes_over` has them, all nothing; None for no range."""
    axes = axes_over(site, count)
    if axes is None:
        return None
    if len(axes) == 1:
        return site.table(axes[0], np.zeros(axes[0].size))
    rows, columns = axes
    return grid(site, rows, columns, np.zeros((rows.size, columns.size)))


def beside(
    base: Model, x: Floats, site: Site, law: Physics, only: Collection[str] = ()
) -> tuple[Model, Floats]:
    """Return a model with a law, and its x where the law is as given; only: which may move."""
    form = form_of(law)
    scales = {k: v for k, v in form.scales(site).items() if not only or k in only}
    lasting = sum(not base.is_found(p) for p in base.parameters)  # changes come last
    start = np.concatenate([x[:lasting], np.zeros(len(scales)), x[lasting:]])
    return base.with_effect(law, scales, form.bounds(site)), start


def bare_of_law(h: Hypothesis) -> tuple[Model, Floats]:
    """Return the model of a hypothesis without the law that it has last, and its x."""
    return h.model.less(h.x, len(h.model.effects) - 1)


def told_of(under: Hypothesis, model: Model, x: Floats, phi: float = 1.0) -> Known | None:
    """Return what slopes alone tell of the last law of a model under a hypothesis' noise.

    One call for all of its numbers; None where the model runs away.
    """
    problem = under.problem
    ground = Landscape(problem.experiments, problem.observer, model, SCREENING)
    creased = any(p.effect.creased for p in model.effects)
    widths = np.full(x.size, CREASED if creased else SMOOTH)
    at = slopes_at(ground, model.within(x), widths, creased)
    if not np.all(np.isfinite(at.slopes)) or not np.all(np.isfinite(at.residual)):
        return None
    return known(model, x, at.residual, at.slopes, phi)


def noises(base: Hypothesis, slower: float = 1e-3) -> Iterator[Hypothesis]:
    """Yield a hypothesis under its own noise and under slower noise, as far as it is followed."""
    for share in (1.0, slower) if base.family.whitening else (1.0,):
        with suppress(NoObserver):
            yield base.under(share * base.ratio)


def begun(base: Hypothesis, site: Site, law: Physics) -> Hypothesis | None:
    """Return a hypothesis with a law of nothing some rounds downhill, the likelier of two noises.

    None where nothing is believed to lead there to first order, or no observer follows.
    """
    return downhill(list(_shown(base, site, law)), *beside(base.model, base.x, site, law))


def _shown(base: Hypothesis, site: Site, law: Physics) -> Iterator[Hypothesis]:
    """Yield a hypothesis under the noises under which a law would be believed to first order."""
    model, x = beside(base.model, base.x, site, law)
    for under in noises(base):
        there = told_of(under, model, x)
        if there is not None and cheapest(there, form_of(law), site).cost < -WORTH:
            yield under


def leads(base: Hypothesis) -> bool:
    """Return whether a state leads what a hypothesis leaves, to first order."""
    nothing = [(site, of_nothing(site)) for site in sites(base)]
    return any(law and any(_shown(base, site, law)) for site, law in nothing)


def downhill(
    under: Sequence[Hypothesis], model: Model, x: Floats, rounds: int = 4
) -> Hypothesis | None:
    """Return a model some rounds downhill under the noises of hypotheses: the likelier end."""
    found: list[Hypothesis] = []
    for one in under:
        with suppress(NoObserver):
            there = replace(one, model=model, x=model.within(x))
            found.append(there.anew(descend(there.far_ground, there.x, rounds, there.creased).x))
    return min(found, key=lambda h: h.cost.misfit, default=None)


def over_one(base: Hypothesis) -> list[Begun]:
    """Return tables of many points where to first order something leads, begun and priced."""
    found: list[Begun] = []
    for site in sites(base):
        law = of_nothing(site)
        h = None if law is None else begun(base, site, law)
        if h is not None and h.cost.misfit < base.cost.misfit:
            found.append(Begun(priced(h), site))
    return found


def over_turns(base: Hypothesis) -> Iterator[Begun]:
    """Yield tables of one turn in the place of each ripple of a hypothesis, begun and priced.

    A ripple is one sine of what repeats; what repeats may have any shape. So each begins at that
    sine and at nothing: where others took what the sine misses, downhill from it ends beside it.
    """
    for i, p in enumerate(base.model.effects_at(base.x)):
        if p.effect.name != "force_ripple" or p.place.kind != "mass":
            continue
        moved = predicted_states(base.problem, base.fitted)
        scale = base.model.scales[i].get("period", 0.0)
        there = site_at(base, moved, "free_spring", p.at)
        site = replace(there, period=p.values["period"], scale=scale)
        axes = axes_over(site)
        sine = None if axes is None else along(p, site.effect, axes[0])
        if axes is None or sine is None:
            continue
        model, x = base.model.less(base.x, i)
        for forces in (sine, 0.0 * sine):
            law = site.table(axes[0], forces)
            h = downhill(list(noises(base)), *beside(model, x, site, law))
            if h is not None:
                yield Begun(priced(h), site)


def over_two(base: Hypothesis) -> list[Begun]:
    """Return small grids where to first order two states lead, begun; the likeliest first."""
    found: list[Begun] = []
    for site in sites(base, two=True):
        law = of_nothing(site, 5)
        h = None if law is None else begun(base, site, law)
        if h is not None and h.cost.misfit < base.cost.misfit:
            found.append(Begun(h, site))
    return sorted(found, key=lambda one: one.h.cost.misfit)


def product_from(_: Hypothesis, one: Begun) -> Hypothesis | None:
    """Return a product of many points, some rounds downhill from a grid that was begun.

    Of the grid less its plane, which is a spring's, a damper's and a scale's, or of it as it is.
    """
    h, site, axes = one.h, one.site, axes_over(one.site)
    if axes is None:
        return None
    few = GridForm(h.model.effects_at(h.x)[-1])
    forces = few.smooth(site)
    flat = np.column_stack([
        np.ones(forces.size), np.repeat(few.rows, few.columns.size),
        np.tile(few.columns, few.rows.size),
    ])  # fmt: skip
    plane = flat @ np.linalg.lstsq(flat, forces.ravel(), rcond=None)[0]
    each: list[Hypothesis | None] = []
    for surface in (forces, forces - plane.reshape(forces.shape)):
        left, values, right = np.linalg.svd(surface)
        f = counts_at(few.rows, axes[0]) @ left[:, 0] * float(values[0])
        g = counts_at(few.columns, axes[1]) @ right[0]
        top = float(g[np.argmax(np.abs(g))])
        if top != 0.0:
            law = ProductForm.of(site.at, (site.over[0], site.over[1]), axes, (top * f, g / top))
            each.append(downhill(list(noises(h)), *beside(*bare_of_law(h), site, law)))
    known = [other for other in each if other is not None]
    return min(known, key=lambda other: other.cost.misfit, default=None)


def shift_from(base: Hypothesis, one: Begun) -> Hypothesis | None:
    """Return a shift of many points, some rounds downhill: either state by the other.

    Along any straight line of its states, a + d b, a shift is a table of one state, of which the
    slopes tell what it would gain; from the line that gains most under each of two noises both
    tables go on.
    """
    each: list[Hypothesis | None] = []
    site = one.site
    for under in noises(base):
        promises: list[tuple[float, Physics]] = []
        for line in _lines(site):
            there = told_of(under, *beside(under.model, under.x, site, line, LAW_FIRST))
            if there is not None:
                promises.append(_at_its_best(there, form_of(line), line))
        if promises:
            law = min(promises, key=lambda promise: promise[0])[1]
            each.append(downhill([under], *beside(under.model, under.x, site, law)))
    known = [h for h in each if h is not None]
    return min(known, key=lambda h: h.cost.misfit, default=None)


def _at_its_best(there: Known, form: Form, law: Physics) -> tuple[float, Physics]:
    """What the numbers of a law gain at their best to first order, and the law there."""
    z = np.linalg.solve(there.precision, there.pull)
    own = dict(law.values) | dict(zip(there.names, z.tolist(), strict=True))
    return -float(there.pull @ z), replace(law, values=own)


def _lines(site: Site) -> Iterator[Physics]:
    """Yield shifts of nothing, in proportion to the other state."""
    ways = np.array([0.0625, 0.125, 0.25, 0.5, 1.0])  # of one range over the other
    a, b = site.over
    for over in ((a, b), (b, a)):
        first, second = site.along(over)
        points, middle = points_over(second), float(np.median(second))
        if points is None:
            continue
        for way in (0.0, *ways, *-ways):
            per = way * float(np.ptp(first)) / float(np.ptp(second))
            at = points_over(first + per * (second - middle))
            if at is not None:
                laws = np.zeros(at.size), per * (points - middle)
                yield ShiftForm.of(site.at, over, (at, points), laws)

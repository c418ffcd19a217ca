"""A learned law over two states at one place: a surface, fitted like any effect.

If a law of one state leaves much unexplained, the missing force may depend on two: friction that
varies with position, a motor whose torque falls with speed, a detent that grows with the command.
So a small grid of forces (`sim/physics/free_force`) is added at every place over every pair of
position, velocity and command there (in a link: deflection, its rate, and the command), beside the
effects of the hypotheses, and fitted for some rounds like laws of one state (`where`). So are a
product, started at the first singular vectors of that grid, and a shift, started along the most
likely straight line of both states. The most likely are fitted to the end in three forms
(`surface_forms`),

    a product f(a) g(b) of two tables (`free_product`), with more points where these pay,
    a shift f(a + g(b)) of two tables (`free_shift`), likewise,
    a grid F(a, b) of as many points as it has,

each with the points that pay: with the precision P of the numbers z of a fitted law, a law of fewer
numbers y, z = c + B y, costs to second order

    (z - c - B y)' P (z - c - B y) + the price of y (`knots`),

so points of the tables, or rows and columns of the grid, are removed one at a time, always the one
that costs least, and the cheapest law is fitted. A form replaces named effects, and any law of one
of its states, only if it is believed over them (`selection.evidence`). Held-out data decide which
form is reported (`answer.learned`).

Its band includes the uncertainty of its numbers, and the error of so few points, as for tables
(`tables.left_out_of`). A plane is not a law: it is a spring, a damper and a scale of the command.
Limits: two states of one place, `POINTS` points a table and `SIZE` rows and columns; no law over
time, since no time recurs in held-out data.
"""

import itertools
import math
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.descend import descend
from zwidth.diagnosis.fitting.landscape import Landscape
from zwidth.diagnosis.fitting.uncertainty import Z95, covariance
from zwidth.diagnosis.forces.leftover import predicted_states
from zwidth.diagnosis.learning.curves import from_nothing, said_as, without_names
from zwidth.diagnosis.learning.knots import nearest, precision_of, refined, tempered
from zwidth.diagnosis.learning.surface_forms import (
    Field,
    Form,
    GridForm,
    Places,
    ShiftForm,
    TablesForm,
    form_of,
    grid,
    in_words,
    product,
    shift,
)
from zwidth.diagnosis.learning.tables import between, points_over
from zwidth.diagnosis.learning.where import RATIOS, SHARE, begun, comes_back, with_law
from zwidth.diagnosis.mishaps import Say, attempt
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.predictor import SCREENING, SETTLING
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.seeking.sizes import sizes_of
from zwidth.diagnosis.selection.evidence import ALPHA, believed
from zwidth.diagnosis.selection.hypothesis import (
    Hypothesis,
    against,
    judged,
    settled,
)
from zwidth.diagnosis.selection.search import Search
from zwidth.diagnosis.settings import LAWS
from zwidth.shown import Valued
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_force import SIZE, counts_at, states_over
from zwidth.sim.physics.two_tables import LAW_FIRST, POINTS
from zwidth.sim.place import masses_and_links, place_at

Floats = NDArray[np.float64]
PAIRS = (("position", "velocity"), ("position", "command"), ("velocity", "command"))
FEW = 5  # rows and columns that a surface begins with
SEEN = 0.05  # of a law's variation: points are added where the error is larger
# Slopes of initial straight shifts: in ranges of the shifted state per range of the other one.
DRIFTS = (0.0, -1.0, -0.5, -0.25, -0.125, -0.0625, 0.0625, 0.125, 0.25, 0.5, 1.0)
LINES, SAMPLES = 5, 3000  # straight shifts that are tried; visited states that choose them
BEGUN = 4  # places and pairs with an initial product and shift
ASKED = 2  # number of these that are fitted to the end
Hopeful = Callable[[Hypothesis], bool]


@dataclass(frozen=True)
class Begun:
    """All forms of a surface after some rounds of a fit; None if one of them fails."""

    field: Field
    grid: Hypothesis
    product: Hypothesis | None
    shift: Hypothesis | None

    @property
    def misfit(self) -> float:
        """The misfit of the most likely form."""
        known = (self.grid, self.product, self.shift)
        return min(h.cost.misfit for h in known if h is not None)


@dataclass(frozen=True)
class Surface(Valued):
    """A learned surface, and its relation to the named effects.

    physics: a grid, product or shift. free (numbers,): the parameters that the recordings
    determine, with their covariance (numbers, numbers). seen (samples, 2): the visited states.
    names: effects that stay beside the surface; replaced: effects not needed beside it. gained:
    decrease of -2 ln likelihood over the best without it, less all penalties.
    """

    physics: Physics
    free: tuple[str, ...]
    covariance: Floats
    seen: Floats
    names: tuple[str, ...]
    replaced: tuple[str, ...]
    gained: float
    hypothesis: Hypothesis

    @property
    def form(self) -> Form:
        """The form of the surface."""
        return form_of(self.physics)

    @property
    def shifts(self) -> bool:
        """Whether the surface is a law of one state, shifted by the other."""
        return isinstance(self.form, ShiftForm)

    @property
    def states(self) -> tuple[str, str]:
        """The two states by their names in a device file."""
        first, second = states_over(self.physics.values)
        return first, second

    @property
    def over(self) -> tuple[str, str]:
        """The two states in words."""
        first, second = in_words(self.states, self.physics.at)
        return first, second

    def at(self, first: Floats, second: Floats) -> Floats:
        """Return the force at states (...,)."""
        return self.form.at(first, second)

    def half(self, first: Floats, second: Floats) -> Floats:
        """Return the half width of its 95 % band at states (...,)."""
        form = self.form
        slopes = form.slopes(first, second)[..., [form.names.index(name) for name in self.free]]
        variance = np.einsum("...i,ij,...j->...", slopes, self.covariance, slopes)
        return Z95 * np.sqrt(np.maximum(variance, 0.0))

    def of(self, names: Sequence[str]) -> Floats:
        """Return the covariance of some parameters; zero for fixed ones."""
        places = [self.free.index(name) if name in self.free else -1 for name in names]
        padded = np.pad(self.covariance, ((0, 1), (0, 1)))
        return padded[np.ix_(places, places)]


def surfaces(
    found: Search, than: Sequence[Hypothesis], say: Say, hopeful: Hopeful
) -> Iterator[Iterator[Surface]]:
    """Yield, for the most likely places and pairs of states, the surfaces that are believed.

    There is at most one of each form, computed on demand. than: hypotheses that a surface is
    compared with, with the named effects and with laws of one state. hopeful: whether a form with
    all its points is worth the search for those that pay.
    """
    bases = [found.best] + [found.plain] * bool(found.best.model.effects)
    everywhere: list[Begun] = []
    for base in bases:
        asked = partial(_begun_everywhere, base)
        everywhere += attempt("learn", "where two states lead", asked) or []
    everywhere.sort(key=lambda one: one.misfit)
    likeliest: dict[tuple[str, tuple[str, str]], list[Begun]] = {}
    for one in everywhere:
        likeliest.setdefault((one.field.at, one.field.over), []).append(one)
    least = min(than, key=lambda h: h.cost.total)
    for each in itertools.islice(likeliest.values(), ASKED):
        say(f"learning a law that depends on {each[0].field.name}")
        yield _of_each_form(found, each, least, hopeful)


def _of_each_form(
    found: Search, each: Sequence[Begun], least: Hypothesis, hopeful: Hopeful
) -> Iterator[Surface]:
    """Yield a believed product, shift and grid, beside the named effects or in place of all.

    Named effects that were found first have imitated parts of the law, so the law beside them may
    look different; the more likely of both is yielded.
    """
    for make in (_as_product, _as_shift, _as_grid):
        ends: list[Hypothesis] = []
        for one in each:
            h = attempt("learn", one.field.at, partial(_shaped, make, one, least, hopeful))
            ends += [] if h is None else [_as_the_file_counts(without_names(found, h), one.field)]
        h = min(ends, key=lambda end: end.cost.total, default=None)
        if h is not None and believed(h.cost, least.cost, against(h, least).phi):
            yield _as_learned(h, least, found)


def _as_the_file_counts(h: Hypothesis, field: Field) -> Hypothesis:
    """The same law with the device file's origin, and a shift that is zero at rest.

    As in `curves`, a law over the position of the first mass on a spring k, shifted to another
    origin d plus a constant k d, is equivalent, and the data do not decide. Limits: only if no
    other effect is present.
    """
    swings, k = {e.swing for e in h.experiments}, h.model.build(h.x).chain.ground_spring
    tied = field.at == "m1" and k > 0.0 and len(h.model.effects) == 1 and len(swings) == 1
    by = h.model.reads(h.x).origin * swings.pop() if tied else 0.0
    law = _last(h)
    centred = form_of(law).centred(field)
    moved = form_of(centred).moved(field, by, k * by) if tied else None
    if moved is None and centred is law:
        return h
    there = replace(field, states=_states_seen(h, field.at, field.over) + by * _counts(field.over))
    model, x = _exchanged(h, there, moved or centred)
    return said_as(h, model, from_nothing(model, x) if moved is not None else x)


def _counts(over: tuple[str, str]) -> Floats:
    """Return 1.0 for a state with an origin, which is a position, and 0.0 for others."""
    return np.array([float(name == "position") for name in over])


def _shaped(
    make: Callable[[Begun], Hypothesis | None], one: Begun, least: Hypothesis, hopeful: Hopeful
) -> Hypothesis | None:
    """A form with the points that pay; None if free runs with all points are not hopeful."""
    full = make(one)
    if full is None or not hopeful(full):
        return None
    pays = partial(_of_those_that_pay, field=one.field)
    return refined(full, against(full, least).phi, pays, partial(_finer, field=one.field))


def _finer(h: Hypothesis, field: Field) -> Hypothesis:
    """The law with a point between each two of its coarser table, if these are believed."""
    form = form_of(_last(h))
    if not isinstance(form, TablesForm):
        return h
    axes = [form.states, form.beside]
    k, misses = form.coarser()
    more = between(axes[k], form.seen(field)[k])
    if misses < SEEN or not axes[k].size < more.size <= POINTS:
        return h
    axes[k] = more
    other = _in_its_place(h, field, form.on(field, *axes))
    if other is None:
        return h
    gained = h.cost.total - other.cost.total + _spared(other, field) - _spared(h, field)
    return other if gained > 2.0 * against(other, h).phi * math.log(1.0 / ALPHA) else h


def _begun_everywhere(base: Hypothesis) -> list[Begun]:
    """The most likely of small surfaces at every place and pair, after some rounds of a fit."""
    if base.slopes is None:
        return []
    grids: list[tuple[Field, Hypothesis]] = []
    for field in _fields(base):
        axes = _axes(field, FEW)
        law = None if axes is None else grid(field, *axes, np.zeros([axis.size for axis in axes]))
        h = None if law is None else begun(base, *_beside(base.model, base.x, field, law))
        if h is not None and h.cost.misfit < base.cost.misfit:
            grids.append((field, h))
    grids.sort(key=lambda one: one[1].cost.misfit)
    return [
        Begun(field, h, _product_begun(h, field), _shift_begun(base, h, field))
        for field, h in grids[:BEGUN]
    ]


def _fields(base: Hypothesis) -> Iterator[Field]:
    """Every place and pair of states that are visited again, as a hypothesis predicts them."""
    device = base.model.build(base.x)
    chain = device.chain
    gain = base.model.reads(base.x).gain
    makes = SHARE * sizes_of(device, base.experiments, gain).force
    moved = predicted_states(base.problem, base.fitted)
    commands = [e.command[SETTLING:] for e in base.experiments]
    for place in masses_and_links(chain.masses.size):
        each = _states_at(moved, commands, str(place))
        met = {name for name, parts in each.items() if comes_back(parts)}
        for over in PAIRS:
            if not met.issuperset(over) or makes <= 0.0:
                continue
            states = np.column_stack([np.concatenate(each[name]) for name in over])
            tied = chain.ground_spring > 0.0 and "position" not in over and place.kind == "mass"
            yield Field(str(place), over, states, makes, tied and place.index == 0)


def _states_at(moved: Sequence[Floats], commands: list[Floats], at: str) -> dict[str, list[Floats]]:
    """The states on which a law at a place may depend, by name, in each recording (samples,)."""
    n = moved[0].shape[1] // 2
    i, j = place_at(at).ends

    def across(first: int) -> list[Floats]:
        return [
            x[SETTLING:, first + i] - (x[SETTLING:, first + j] if j >= 0 else 0.0) for x in moved
        ]

    return {"position": across(0), "velocity": across(n), "command": commands}


def _states_seen(h: Hypothesis, at: str, over: Sequence[str]) -> Floats:
    """Return the states at a place (samples, 2) as a fitted hypothesis predicts them."""
    moved = predicted_states(h.problem, h.fitted)
    each = _states_at(moved, [e.command[SETTLING:] for e in h.experiments], at)
    return np.column_stack([np.concatenate(each[name]) for name in over])


def _axes(field: Field, count: int) -> tuple[Floats, Floats] | None:
    """Points of either state, fewer if it has few values; None if one has no range."""
    first, second = (points_over(seen, count, False) for seen in field.states.T)
    return None if first is None or second is None else (first, second)


def _beside(
    base: Model, x: Floats, field: Field, law: Physics, only: Collection[str] = ()
) -> tuple[Model, Floats]:
    """Return a model with a surface, and its x; only: numbers that are free, all by default."""
    scales = form_of(law).scales(field)
    scales = {name: scales[name] for name in scales if not only or name in only}
    return with_law(base, x, law, scales)


def _exchanged(h: Hypothesis, field: Field, law: Physics) -> tuple[Model, Floats]:
    """The model with another surface in place of its last one, and its x."""
    return _beside(*h.model.less(h.x, len(h.model.effects) - 1), field, law)


def _in_its_place(h: Hypothesis, field: Field, law: Physics) -> Hypothesis | None:
    """Another surface in place of the last one of a hypothesis, fitted."""
    model, start = _exchanged(h, field, law)
    with suppress(NoObserver):
        return _finite(settled(judged(h.experiments, model, model.within(start), h.family)))
    return None


def _finite(h: Hypothesis) -> Hypothesis | None:
    """A hypothesis; None if the recordings do not determine all of its parameters."""
    return h if np.isfinite(h.cost.total) else None


def _last(h: Hypothesis) -> Physics:
    return h.model.effects_at(h.x)[-1]


def _product_begun(h: Hypothesis, field: Field) -> Hypothesis | None:
    """A product of many points, after some rounds of a fit that starts from a grid.

    Tries the grid as it is, and without its plane, which belongs to a spring, damper and scale.
    """
    few, axes = GridForm(_last(h)), _axes(field, LAWS.points)
    if axes is None:
        return None
    forces = few.smooth(field)
    flat = np.column_stack([
        np.ones(forces.size), np.repeat(few.rows, few.columns.size),
        np.tile(few.columns, few.rows.size),
    ])  # fmt: skip
    plane = flat @ np.linalg.lstsq(flat, forces.ravel(), rcond=None)[0]
    each: list[Hypothesis] = []
    for surface in (forces, forces - plane.reshape(forces.shape)):
        left, values, right = np.linalg.svd(surface)
        f = counts_at(few.rows, axes[0]) @ left[:, 0] * float(values[0])
        g = counts_at(few.columns, axes[1]) @ right[0]
        top = float(g[np.argmax(np.abs(g))])
        if top == 0.0:
            continue
        law = product(field, axes[0], top * f, axes[1], g / top)
        other = begun(h, *_exchanged(h, field, law))
        each += [] if other is None else [other]
    return min(each, key=lambda one: one.cost.misfit, default=None)


def _shift_begun(base: Hypothesis, small: Hypothesis, field: Field) -> Hypothesis | None:
    """A shift of many points, of either state by the other, after some rounds of a fit.

    A straight shift is a table over a + d b. Of those nearest to a small grid, one round of a fit
    from zero, under two observers, shows how likely each is; the fit starts from the most likely.
    """
    near, each = _near_lines(small, field), list[Hypothesis]()
    for share in RATIOS if base.family.whitening else RATIOS[:1]:
        with suppress(NoObserver):
            law = _likeliest(base.under(share * base.ratio), field, near)
            h = None if law is None else begun(base, *_beside(base.model, base.x, field, law))
            each += [] if h is None else [h]
    return min(each, key=lambda one: one.cost.misfit, default=None)


def _near_lines(h: Hypothesis, field: Field) -> list[Physics]:
    """Return the straight shifts of a zero law that can come nearest to the grid of h.

    Nearest in least squares over the visited states, with a plane beside the law, which belongs to
    a spring, damper and scale. Of 21 fields of three recordings, the likeliest of the first five of
    22 gained as much as that of all, or 2 to 11 % less.
    """
    seen = replace(field, states=field.states[:: 1 + len(field.states) // SAMPLES])
    force = GridForm(_last(h)).at(*seen.states.T)

    def left(law: Physics) -> float:
        form = ShiftForm(law)
        table = form.slopes(*seen.along(form.tables.over))[:, : form.states.size]
        columns = np.column_stack([table, seen.states])
        return float(np.linalg.norm(force - columns @ np.linalg.lstsq(columns, force)[0]))

    return sorted(_lines(field), key=left)[:LINES]


def _likeliest(under: Hypothesis, field: Field, lines: Sequence[Physics]) -> Physics | None:
    """The straight shift with which one round of a fit gains most."""
    problem, least, likeliest = under.problem, math.inf, None
    for line in lines:
        model, x = _beside(under.model, under.x, field, line, LAW_FIRST)
        ground = Landscape(problem.experiments, problem.observer, model, SCREENING)
        end = descend(ground, x, 1, under.creased, first=True)
        if end.cost < least:
            least, likeliest = end.cost, model.effects_at(end.x)[-1]
    return likeliest


def _lines(field: Field) -> Iterator[Physics]:
    """Yield straight shifts of a zero law."""
    a, b = field.over
    for over in ((a, b), (b, a)):
        first, second = field.along(over)
        beside, middle = points_over(second, LAWS.points, False), float(np.median(second))
        if beside is None:
            continue
        for drift in DRIFTS:
            per = drift * float(np.ptp(first)) / float(np.ptp(second))
            along = points_over(first + per * (second - middle), LAWS.points, False)
            if along is not None:
                shifts = per * (beside - middle)
                yield shift(field, over, along, np.zeros(along.size), beside, shifts)


def _as_shift(one: Begun) -> Hypothesis | None:
    """A shift with the initial number of points, fitted."""
    return None if one.shift is None else _finite(settled(one.shift))


def _as_product(one: Begun) -> Hypothesis | None:
    """A product with the initial number of points, fitted."""
    return None if one.product is None else _finite(settled(one.product))


def _as_grid(one: Begun) -> Hypothesis | None:
    """A grid with all of its points, fitted from a smaller one."""
    h, field = one.grid, one.field
    few, axes = GridForm(_last(h)), _axes(field, SIZE)
    if axes is None:
        return None
    a, b = counts_at(few.rows, axes[0]), counts_at(few.columns, axes[1])
    fitted = _in_its_place(h, field, grid(field, *axes, a @ few.smooth(field) @ b.T))
    return None if fitted is None else _smoothed(fitted, field)


def _smoothed(h: Hypothesis, field: Field) -> Hypothesis:
    """The hypothesis with the undetermined part of a grid interpolated, fitted again."""
    form = form_of(_last(h))
    if not isinstance(form, GridForm) or form.told(field).all():
        return h
    laid = grid(field, form.rows, form.columns, form.smooth(field))
    return _in_its_place(h, field, laid) or h


@dataclass(frozen=True)
class _Known:
    """Names, values and precision of the numbers of a fitted surface."""

    names: tuple[str, ...]
    numbers: Floats
    precision: Floats


def _own(h: Hypothesis) -> list[tuple[int, str, float]]:
    """Index in x, name and scale of each number of the last surface of a hypothesis."""
    last = len(h.model.effects) - 1
    return [
        (j, p.key, p.scale)
        for j, p in enumerate(h.model.parameters)
        if p.kind == "effect" and p.index == last
    ]


def _known(h: Hypothesis, phi: float) -> _Known:
    places, names, scales = (list(column) for column in zip(*_own(h), strict=True))
    p, _, _ = precision_of(h, np.array(places), np.array(scales), phi)
    law = _last(h)
    return _Known(tuple(names), np.array([law.values[n] for n in names]), p)


@dataclass(frozen=True)
class _Fewer:
    """A law with some of the points of another along either state, and its relative cost."""

    first: Places
    second: Places
    law: Physics | None
    cost: float


def _priced(there: _Known, form: Form, field: Field, first: Places, second: Places) -> _Fewer:
    """A law with some points along either state, as near as possible to the known one."""
    basis, offset, law = form.fewer(field, there.names, first, second)
    if basis.shape[1] == 0:
        return _Fewer(first, second, None, np.inf)
    y, cost = nearest(basis, there.numbers - offset, there.precision)
    return _Fewer(first, second, law(y), cost)


def _cheapest(h: Hypothesis, field: Field, phi: float) -> tuple[_Fewer, float]:
    """The law with the points that pay (ends and fixed ones stay), and how much less it costs."""
    there, form = _known(h, phi), form_of(_last(h))
    kept = form.kept(field, there.names)
    priced = partial(_priced, there, form, field)
    full = best = cheapest = priced(*(np.arange(size) for size in form.sizes))
    while True:
        both = best.first, best.second
        go = [[k for k in range(1, b.size - 1) if b[k] != kept[i]] for i, b in enumerate(both)]
        fewer = [(np.delete(best.first, k), best.second) for k in go[0]]
        fewer += [(best.first, np.delete(best.second, k)) for k in go[1]]
        if not fewer:
            break
        best = min(itertools.starmap(priced, fewer), key=lambda one: one.cost)
        cheapest = best if best.cost < cheapest.cost else cheapest
    return cheapest, full.cost - cheapest.cost


def _spared(h: Hypothesis, field: Field) -> float:
    """How much less a law with only the points that pay costs, to second order; 0.0 if unknown."""
    _, spared = _cheapest(h, field, 1.0)
    return spared if math.isfinite(spared) else 0.0


def _of_those_that_pay(h: Hypothesis, phi: float, field: Field) -> Hypothesis:
    """The same law with the points that pay along either state, if that costs less."""
    cheapest, _ = _cheapest(h, field, phi)
    sizes = cheapest.first.size, cheapest.second.size
    if cheapest.law is None or sizes == form_of(_last(h)).sizes:
        return h
    other = _in_its_place(h, field, cheapest.law)
    if other is None:
        return h
    other = _smoothed(other, field)
    return other if tempered(other, phi) < tempered(h, phi) else h


def _as_learned(h: Hypothesis, without: Hypothesis, found: Search) -> Surface:
    law = _last(h)
    places, keys, scales = (list(column) for column in zip(*_own(h), strict=True))
    known = covariance(h.fitted)[np.ix_(places, places)] * np.outer(scales, scales)
    form = form_of(law)
    few = dict(zip(form.names, form.left_out().tolist(), strict=True))
    known += np.diag([few[key] ** 2 for key in keys])
    names = tuple(sorted(f"{p.effect.name} at {p.at}" for p in h.model.effects[:-1]))
    gone = tuple(
        n for p in found.best.model.effects if (n := f"{p.effect.name} at {p.at}") not in names
    )
    seen = _states_seen(h, law.at, states_over(law.values))
    return Surface(law, tuple(keys), known, seen, names, gone, without.cost.total - h.cost.total, h)

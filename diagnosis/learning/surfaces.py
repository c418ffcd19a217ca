"""A law of no name over two states at one place, learned: a surface, fitted like any effect.

Where a law of one state leaves much, what is missing may follow two: friction that a position
shapes, a motor whose torque falls with speed, a detent that grows with the command. So a small grid
of forces (`sim/physics/free_force`) is let in at every place over every pair of position, velocity
and command there (in a link, of how far it gives way, how fast, and the command), beside what
hypotheses have, and goes some rounds downhill as laws of one state do (`where`). The likeliest are
fitted to their end in two forms,

    a product f(a) g(b) of two tables (`free_product`), begun at the first singular vectors,
    a grid F(a, b) of as many points as it has,

each with the points that pay: of the precision P with which a fit knows the numbers z of a law, any
law of fewer numbers y, z = c + B y with B what its points count at those of the first, costs to
second order

    (z - c - B y)' P (z - c - B y) + what y costs (`knots`),

so that points of the tables, rows and columns of the grid, go one at a time, that which costs least
by going, and what was cheapest is fitted. The cheaper form is said. It stands over names and over
any law of one of its states only where it is believed over them by the one criterion of
`selection.evidence`.

A recording does not see all of a grid: of two states that swing, the corners are seldom met. Only
forces that samples lie nearest to are free; the others are laid smoothly between and beyond them
(the discrete Laplace equation, `filled`), and say nothing.

Its band is what the fit does not know of its numbers, and what so few points cannot be, as of
tables (`tables.left_out`). Of a surface a plane is no law: it is a spring, a damper and a scale of
the command. Limits: two states of one place, `POINTS` points a table and `SIZE` rows and columns;
nothing over time, which a recording meets once and held-out data never.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.descend import descend
from zwidth.diagnosis.fitting.uncertainty import Z95, covariance
from zwidth.diagnosis.forces.leftover import predicted_states
from zwidth.diagnosis.learning.curves import without_names
from zwidth.diagnosis.learning.knots import JUDGED, tempered
from zwidth.diagnosis.learning.tables import left_out_of
from zwidth.diagnosis.learning.where import RATIOS, ROUNDS, SHARE, comes_back
from zwidth.diagnosis.mishaps import Say, attempt
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.seeking.sizes import sizes_of
from zwidth.diagnosis.selection.evidence import believed, freedom
from zwidth.diagnosis.selection.hypothesis import (
    SWEEP,
    Hypothesis,
    against,
    judged,
    settled,
)
from zwidth.diagnosis.selection.search import Search
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_force import (
    SIZE,
    counts_at,
    force_at,
    grid_of,
    grid_values,
    states_over,
)
from zwidth.sim.physics.free_product import (
    FORCE_FIRST,
    POINTS,
    SHARE_SECOND,
    held,
    is_product,
    product_at,
    product_of,
    product_values,
)
from zwidth.sim.place import masses_and_links, place_at

Floats = NDArray[np.float64]
Seen = NDArray[np.bool_]
GRID, PRODUCT = "free_force", "free_product"
OF_A_SHARE = 0.3  # scale of a number that a force is taken times
PAIRS = (("position", "velocity"), ("position", "command"), ("velocity", "command"))
FEW = 5  # rows and columns that a surface begins with
MET = 10  # samples nearest to a point of a grid, of which fewer say nothing of the force there
ASKED = 2  # places and pairs that are fitted to their end
Hopeful = Callable[[Hypothesis], bool]


@dataclass(frozen=True)
class Field:
    """Where a surface may stand: place, two states, what was seen of them (samples, 2).

    makes: how much a force of its grid is likely to be. floats: whether another origin of positions
    does the same as a constant, so that one force is held.
    """

    at: str
    over: tuple[str, str]
    states: Floats
    makes: float
    floats: bool

    @property
    def name(self) -> str:
        """The pair and the place, as people read them."""
        return f"{' and '.join(in_words(self.over, self.at))} at {self.at}"


@dataclass(frozen=True)
class Surface:
    """A surface that was learned, with what it is beside the names.

    physics: a grid or a product. free (numbers,): the parameters that the recordings tell, with
    their covariance (numbers, numbers). seen (samples, 2): the states that were visited. names:
    that stay beside it; replaced: those that are not needed beside it. gained: over the best
    without it, in -2 ln.
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
    def is_product(self) -> bool:
        """Whether it is a law of one state times one of the other."""
        return is_product(self.physics.effect.parameters)

    @property
    def states(self) -> tuple[str, str]:
        """Its two states by their names in a device file."""
        first, second = states_over(self.physics.values)
        return first, second

    @property
    def over(self) -> tuple[str, str]:
        """Its two states in words."""
        first, second = in_words(self.states, self.physics.at)
        return first, second

    def at(self, first: Floats, second: Floats) -> Floats:
        """Return the force at states (...,)."""
        return law_at(self.physics, first, second)

    def half(self, first: Floats, second: Floats) -> Floats:
        """Return the half width of its 95 % band at states (...,)."""
        slopes = _slopes(self.physics, self.free, first, second)
        variance = np.einsum("...i,ij,...j->...", slopes, self.covariance, slopes)
        return Z95 * np.sqrt(np.maximum(variance, 0.0))

    def of(self, names: Sequence[str]) -> Floats:
        """Return the covariance of some parameters; nothing is known to err of what was held."""
        places = [self.free.index(name) if name in self.free else -1 for name in names]
        padded = np.pad(self.covariance, ((0, 1), (0, 1)))
        return padded[np.ix_(places, places)]


def law_at(law: Physics, first: Floats, second: Floats) -> Floats:
    """Return the force of a grid or a product at states (...,)."""
    if is_product(law.effect.parameters):
        return product_at(product_of(law.values), first, second)
    return force_at(grid_of(law.values), first, second)


def _slopes(law: Physics, free: Sequence[str], first: Floats, second: Floats) -> Floats:
    """Slopes (..., numbers) of a force over its free numbers."""
    if not is_product(law.effect.parameters):
        grid = grid_of(law.values)
        a, b = counts_at(grid.rows, first), counts_at(grid.columns, second)
        every = np.einsum("...i,...j->...ij", a, b)
        names = np.array(grid.names)
        return np.stack([every[..., names == name][..., 0] for name in free], axis=-1)
    product = product_of(law.values)
    (s, f), (r, g) = (np.array(table).T for table in (product.first, product.second))
    a, b = counts_at(s, first), counts_at(r, second)
    of_first = a * (b @ g)[..., None]
    of_second = b * (a @ f)[..., None]
    both = np.concatenate([of_first, of_second], axis=-1)
    names = [*FORCE_FIRST[: s.size], *SHARE_SECOND[: r.size]]
    return both[..., [names.index(name) for name in free]]


def in_words(over: Sequence[str], at: str) -> tuple[str, ...]:
    """Return states as people name them at a place."""
    if place_at(at).kind != "link":
        return tuple(over)
    link = {"position": "what the link gives way", "velocity": "rate of the link"}
    return tuple(link.get(state, state) for state in over)


def surfaces(
    found: Search, than: Sequence[Hypothesis], say: Say, hopeful: Hopeful
) -> Iterator[Iterator[Surface]]:
    """Yield, of each place and pair of states, surfaces that are believed, the likeliest first.

    Over names, and over what else was learned: of either form one, worked out when it is asked for.
    than: what a surface is held against, the names and laws of one state. hopeful: whether all the
    points of a form are worth the search for those that pay.
    """
    bases = [found.best] + [found.plain] * bool(found.best.model.effects)
    begun: list[tuple[Field, Hypothesis]] = []
    for base in bases:
        asked = partial(_begun_everywhere, base)
        begun += attempt("learn", "where two states lead", asked) or []
    begun.sort(key=lambda one: one[1].cost.misfit)
    likeliest: dict[tuple[str, tuple[str, str]], tuple[Field, Hypothesis]] = {}
    for field, first in begun:
        likeliest.setdefault((field.at, field.over), (field, first))
    least = min(than, key=lambda h: h.cost.total)
    for field, first in itertools.islice(likeliest.values(), ASKED):
        say(f"learning a law over {field.name}")
        yield _of_either_form(found, field, first, least, hopeful)


def _of_either_form(
    found: Search, field: Field, first: Hypothesis, least: Hypothesis, hopeful: Hopeful
) -> Iterator[Surface]:
    """Yield a product and a grid that are believed."""
    for make in (_as_product, _as_grid):
        shaping = partial(_shaped, make, first, field, least, hopeful)
        h = attempt("learn", field.at, shaping)
        h = None if h is None else without_names(found, h)
        if h is not None and believed(h.cost, least.cost, against(h, least).phi):
            yield _as_learned(h, least, found)


def _shaped(
    make: Callable[[Hypothesis, Field], Hypothesis | None],
    first: Hypothesis,
    field: Field,
    least: Hypothesis,
    hopeful: Hopeful,
) -> Hypothesis | None:
    """A form with the points that pay; None where free runs of all its points give no hope."""
    full = make(first, field)
    if full is None or not hopeful(full):
        return None
    return _of_those_that_pay(full, field, against(full, least).phi)


def _begun_everywhere(base: Hypothesis) -> list[tuple[Field, Hypothesis]]:
    """Small surfaces of nothing at every place and pair, some rounds downhill."""
    if base.slopes is None:
        return []
    found: list[tuple[Field, Hypothesis]] = []
    for field in _fields(base):
        law = surface_over(field, FEW, FEW)
        h = None if law is None else _begun(base, field, law)
        if h is not None and h.cost.misfit < base.cost.misfit:
            found.append((field, h))
    return found


def _fields(base: Hypothesis) -> Iterator[Field]:
    """Every place and pair of states, as a hypothesis predicts them."""
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
    """What a law at a place may follow, in each recording (samples,), by name."""
    n = moved[0].shape[1] // 2
    i, j = place_at(at).ends

    def across(first: int) -> list[Floats]:
        return [
            x[SETTLING:, first + i] - (x[SETTLING:, first + j] if j >= 0 else 0.0) for x in moved
        ]

    return {"position": across(0), "velocity": across(n), "command": commands}


def axis_over(seen: Floats, count: int) -> Floats | None:
    """Return so many states for an axis: half by where it was, half evenly; None for no range."""
    share = np.linspace(0.0, 1.0, count)
    low, high = float(seen.min()), float(seen.max())
    at = 0.5 * (np.quantile(seen, share) + low + share * (high - low))
    at[0], at[-1] = low, high
    return None if np.any(np.diff(at) <= 0.0) else at


def surface_over(field: Field, rows: int, columns: int) -> Physics | None:
    """Return a surface of nothing over what was seen; None where a state has no range."""
    a, b = axis_over(field.states[:, 0], rows), axis_over(field.states[:, 1], columns)
    return None if a is None or b is None else _surface(field, a, b, np.zeros((rows, columns)))


def _surface(field: Field, rows: Floats, columns: Floats, forces: Floats) -> Physics:
    values = grid_values(field.over, rows.tolist(), columns.tolist(), forces)
    return make_physics(GRID, field.at, **values)


def told(states: Floats, rows: Floats, columns: Floats) -> Seen:
    """Return of which points of a grid (rows, columns) samples say something: enough are nearest.

    states (samples, 2).
    """
    edges = [0.5 * (axis[1:] + axis[:-1]) for axis in (rows, columns)]
    i, j = (np.searchsorted(edge, s) for edge, s in zip(edges, states.T, strict=True))
    count = np.bincount(i * columns.size + j, minlength=rows.size * columns.size)
    return count.reshape(rows.size, columns.size) >= MET


def filled(forces: Floats, known: Seen) -> Floats:
    """Return a grid (rows, columns) whose unknown forces are laid smoothly.

    Each is its neighbours' mean, those that are known as they are.
    """
    if known.all() or not known.any():
        return forces
    rows, columns = forces.shape
    places = np.arange(forces.size).reshape(rows, columns)
    system, right = np.eye(forces.size), np.where(known, forces, 0.0).ravel()
    for k in places[~known]:
        i, j = divmod(int(k), columns)
        near = [
            (i + a, j + b)
            for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1))
            if 0 <= i + a < rows and 0 <= j + b < columns
        ]
        for one in near:
            system[k, places[one]] = -1.0 / len(near)
    laid = np.linalg.solve(system, right).reshape(rows, columns)
    return np.asarray(laid, dtype=np.float64)


def _free(field: Field, law: Physics) -> Seen:
    """Which forces of a surface a fit may move."""
    grid = grid_of(law.values)
    free = told(field.states, np.array(grid.rows), np.array(grid.columns))
    if field.floats:
        most = _middle(free)
        free[most] = False
    return free


def _middle(free: Seen) -> tuple[int, int]:
    """The point that is told nearest to the middle of a grid."""
    i, j = np.nonzero(free)
    middle = (np.array(free.shape) - 1) / 2.0
    k = int(np.argmin((i - middle[0]) ** 2 + (j - middle[1]) ** 2))
    return int(i[k]), int(j[k])


def _beside(base: Model, x: Floats, field: Field, law: Physics) -> tuple[Model, Floats]:
    """Return a model with a surface, and its x where it is as given."""
    if is_product(law.effect.parameters):
        product = product_of(law.values)
        laws = [g for _, g in product.second]
        scales = dict.fromkeys(FORCE_FIRST[: len(product.first)], field.makes)
        scales |= dict.fromkeys(SHARE_SECOND[: len(laws)], OF_A_SHARE)
        scales.pop(SHARE_SECOND[held(laws)])
    else:
        names = np.array(grid_of(law.values).names)
        scales = dict.fromkeys(names[_free(field, law)].tolist(), field.makes)
    lasting = sum(not base.is_found(p) for p in base.parameters)  # changes come last
    start = np.concatenate([x[:lasting], np.zeros(len(scales)), x[lasting:]])
    return base.with_effect(law, scales), start


def _begun(base: Hypothesis, field: Field, law: Physics) -> Hypothesis | None:
    """A surface of nothing, some rounds downhill under two observers; the likelier of both ends."""
    model, x = _beside(base.model, base.x, field, law)
    with suppress(NoObserver):
        first = judged(base.experiments, model, model.within(x), base.family)
        found = [first]
        for share in RATIOS if base.family.whitening else RATIOS[:1]:
            with suppress(NoObserver):
                there = first.under(share * first.ratio).far_ground
                found.append(first.anew(descend(there, first.x, ROUNDS, first.creased).x))
        return min(found, key=lambda h: h.cost.misfit)
    return None


def _in_its_place(h: Hypothesis, field: Field, law: Physics) -> Hypothesis | None:
    """Another surface in the place of the one that a hypothesis has last, fitted."""
    model, own = h.model.less(h.x, len(h.model.effects) - 1)
    model, start = _beside(model, own, field, law)
    with suppress(NoObserver):
        other = settled(judged(h.experiments, model, model.within(start), h.family))
        return other if np.isfinite(other.cost.total) else None
    return None


def _known_of(h: Hypothesis, field: Field) -> tuple[Floats, Floats, Floats]:
    """Rows, columns and forces of a grid that was begun, what it does not see laid smoothly."""
    law = _last(h)
    grid = grid_of(law.values)
    rows, columns = np.array(grid.rows), np.array(grid.columns)
    return rows, columns, filled(grid.values, _free(field, law))


def _as_product(h: Hypothesis, field: Field) -> Hypothesis | None:
    """A product with all the points that its tables have, fitted, from a grid that was begun.

    Of the grid less its plane, which is a spring's, a damper's and a scale's, and of it as it is.
    """
    rows, columns, forces = _known_of(h, field)
    a, b = (axis_over(s, POINTS) for s in field.states.T)
    if a is None or b is None:
        return None
    flat = np.column_stack([
        np.ones(forces.size), np.repeat(rows, columns.size), np.tile(columns, rows.size)
    ])  # fmt: skip
    plane = flat @ np.linalg.lstsq(flat, forces.ravel(), rcond=None)[0]
    begun: list[Hypothesis] = []
    for surface in (forces, forces - plane.reshape(forces.shape)):
        left, values, right = np.linalg.svd(surface)
        f = counts_at(rows, a) @ left[:, 0] * float(values[0])
        g = counts_at(columns, b) @ right[0]
        top = float(g[np.argmax(np.abs(g))])
        if top == 0.0:
            continue
        model, own = h.model.less(h.x, len(h.model.effects) - 1)
        product = _product(field, a, top * f, b, g / top)
        other = _begun(replace(h, model=model, x=own), field, product)
        begun += [] if other is None else [other]
    likeliest = min(begun, key=lambda one: one.cost.misfit, default=None)
    other = None if likeliest is None else settled(likeliest)
    return other if other is not None and np.isfinite(other.cost.total) else None


def _product(field: Field, a: Floats, f: Floats, b: Floats, g: Floats) -> Physics:
    tables = (np.column_stack(pair).tolist() for pair in ((a, f), (b, g)))
    return make_physics(PRODUCT, field.at, **product_values(field.over, *tables))


def _as_grid(h: Hypothesis, field: Field) -> Hypothesis | None:
    """A grid with all the points that it has, fitted, from one of fewer that was begun."""
    rows, columns, forces = _known_of(h, field)
    a, b = (axis_over(s, SIZE) for s in field.states.T)
    if a is None or b is None:
        return None
    begun = counts_at(rows, a) @ forces @ counts_at(columns, b).T
    fitted = _in_its_place(h, field, _surface(field, a, b, begun))
    return None if fitted is None else _smoothed(fitted, field)


def _smoothed(h: Hypothesis, field: Field) -> Hypothesis:
    """The same with what a grid does not see laid smoothly between what it does, fitted again."""
    law = _last(h)
    if is_product(law.effect.parameters):
        return h
    free = _free(field, law)
    if free.sum() >= free.size - int(field.floats):
        return h
    other = _in_its_place(h, field, _surface(field, *_known_of(h, field)))
    return h if other is None else other


def _last(h: Hypothesis) -> Physics:
    return h.model.effects_at(h.x)[-1]


@dataclass(frozen=True)
class _Known:
    """What a fit knows of the numbers of its surface: their names, values and precision."""

    names: tuple[str, ...]
    numbers: Floats
    precision: Floats


def _own(h: Hypothesis) -> list[tuple[int, str, float]]:
    """Place in x, name and scale of each number of the surface that a hypothesis has last."""
    last = len(h.model.effects) - 1
    return [
        (j, p.key, p.scale)
        for j, p in enumerate(h.model.parameters)
        if p.kind == "effect" and p.index == last
    ]


def _known(h: Hypothesis, phi: float) -> _Known:
    assert h.slopes is not None
    places, names, scales = (list(column) for column in zip(*_own(h), strict=True))
    others = np.setdiff1d(np.arange(h.x.size), places)
    a = h.slopes.T @ h.slopes
    across = a[np.ix_(places, others)]
    inverse = np.linalg.pinv(a[np.ix_(others, others)], hermitian=True)
    p = a[np.ix_(places, places)] - across @ inverse @ across.T
    p = 0.5 * (p + p.T)
    p = (p + JUDGED * float(np.diag(p).max()) * np.eye(len(places))) / np.outer(scales, scales)
    law = _last(h)
    return _Known(tuple(names), np.array([law.values[n] for n in names]), p / phi)


@dataclass(frozen=True)
class _Fewer:
    """A law of some of the points of another along either axis, and what it costs beside it."""

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    law: Physics | None
    cost: float


Axes = tuple[Floats, Floats]


def _priced(
    there: _Known, field: Field, law: Physics, first: NDArray[np.int64], second: NDArray[np.int64]
) -> _Fewer:
    """A law of some points along either axis, as near to what is known as it can be."""
    of = _grid_of_some if not is_product(law.effect.parameters) else _product_of_some
    basis, offset, make = of(there, field, law, first, second)
    if basis.shape[1] == 0:
        return _Fewer(first, second, None, np.inf)
    target = there.numbers - offset
    square = basis.T @ there.precision @ basis
    pull = basis.T @ there.precision @ target
    y = np.asarray(np.linalg.lstsq(square, pull, rcond=1e-12)[0], dtype=np.float64)
    off = target - basis @ y
    deviation = np.sqrt(np.maximum(np.diag(np.linalg.pinv(square, hermitian=True)), 0.0))
    ranges = SWEEP * np.maximum(np.abs(y), deviation)
    cost = float(off @ there.precision @ off)
    cost += freedom(square, ranges.tolist()) if np.all(ranges > 0.0) else np.inf
    return _Fewer(first, second, make(y), cost)


Some = tuple[Floats, Floats, Callable[[Floats], Physics]]


def _grid_of_some(
    there: _Known, field: Field, law: Physics, first: NDArray[np.int64], second: NDArray[np.int64]
) -> Some:
    """Basis (numbers, fewer) and offset of a grid of some rows and columns, and its law."""
    grid = grid_of(law.values)
    rows, columns, names = np.array(grid.rows), np.array(grid.columns), np.array(grid.names)
    free = np.isin(names, there.names)
    own = free[np.ix_(first, second)]
    a, b = counts_at(rows[first], rows), counts_at(columns[second], columns)
    every = np.einsum("ik,jl->ijkl", a, b)[free]
    # What the grid does not see follows what it does, as `filled` lays it.
    units = np.zeros((int(own.sum()), *own.shape))
    units[np.arange(len(units)), *np.nonzero(own)] = 1.0
    laid = np.array([filled(units[k], own) for k in range(len(units))]).reshape(units.shape)
    basis = np.einsum("nkl,ukl->nu", every, laid)

    def make(y: Floats) -> Physics:
        return _surface(field, rows[first], columns[second], np.einsum("u,ukl->kl", y, laid))

    return basis, np.zeros(len(there.names)), make


def _product_of_some(
    there: _Known, field: Field, law: Physics, first: NDArray[np.int64], second: NDArray[np.int64]
) -> Some:
    """The same of a product of some points of either table."""
    product = product_of(law.values)
    (s, _), (r, g) = (np.array(table).T for table in (product.first, product.second))
    a, b = counts_at(s[first], s), counts_at(r[second], r)
    fixed = held(g.tolist())
    known = np.delete(np.arange(g.size), fixed)
    place = int(np.flatnonzero(second == fixed)[0])
    moved = np.delete(np.arange(second.size), place)
    basis = np.zeros((len(there.names), first.size + moved.size))
    basis[: s.size, : first.size] = a
    basis[s.size :, first.size :] = b[np.ix_(known, moved)]
    offset = np.concatenate([np.zeros(s.size), b[known, place] * g[fixed]])

    def make(y: Floats) -> Physics:
        shares = np.insert(y[first.size :], place, g[fixed])
        return _product(field, s[first], y[: first.size], r[second], shares)

    return basis, offset, make


def _of_those_that_pay(h: Hypothesis, field: Field, phi: float) -> Hypothesis:
    """The same law with the points that pay along either axis, where that costs less."""
    there, law = _known(h, phi), _last(h)
    if is_product(law.effect.parameters):
        product = product_of(law.values)
        sizes = len(product.first), len(product.second)
        fixed = held([g for _, g in product.second])
    else:
        grid = grid_of(law.values)
        sizes, fixed = (len(grid.rows), len(grid.columns)), 0
    priced = partial(_priced, there, field, law)
    best = cheapest = priced(*(np.arange(size) for size in sizes))
    while True:
        fewer = [(np.delete(best.first, k), best.second) for k in range(1, best.first.size - 1)]
        fewer += [
            (best.first, np.delete(best.second, k))
            for k in range(1, best.second.size - 1)
            if best.second[k] != fixed
        ]
        if not fewer:
            break
        best = min(itertools.starmap(priced, fewer), key=lambda one: one.cost)
        cheapest = best if best.cost < cheapest.cost else cheapest
    if cheapest.law is None or cheapest.first.size + cheapest.second.size == sum(sizes):
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
    known += np.diag([_left_out(law)[key] ** 2 for key in keys])
    names = tuple(sorted(f"{p.effect.name} at {p.at}" for p in h.model.effects[:-1]))
    gone = tuple(
        n for p in found.best.model.effects if (n := f"{p.effect.name} at {p.at}") not in names
    )
    seen = _seen(h, law.at, states_over(law.values))
    return Surface(law, tuple(keys), known, seen, names, gone, without.cost.total - h.cost.total, h)


def _left_out(law: Physics) -> dict[str, float]:
    """By how much a surface through so few points is likely to err at each (`tables.left_out`)."""
    if is_product(law.effect.parameters):
        product = product_of(law.values)
        found: dict[str, float] = {}
        for table, names in ((product.first, FORCE_FIRST), (product.second, SHARE_SECOND)):
            states, laws = np.array(table).T
            found |= dict(zip(names, left_out_of(states, laws).tolist(), strict=False))
        return found
    grid = grid_of(law.values)
    along = left_out_of(np.array(grid.rows), grid.values)
    across = left_out_of(np.array(grid.columns), grid.values.T).T
    names = np.array(grid.names).ravel().tolist()
    return dict(zip(names, np.hypot(along, across).ravel().tolist(), strict=True))


def _seen(h: Hypothesis, at: str, over: Sequence[str]) -> Floats:
    """The states (samples, 2) that a hypothesis predicts at a place."""
    moved = predicted_states(h.problem, h.fitted)
    each = _states_at(moved, [e.command[SETTLING:] for e in h.experiments], at)
    return np.column_stack([np.concatenate(each[name]) for name in over])

"""The forms of a law of no name: a table over one state, and over two a grid, a product, a shift.

A law is begun, fitted, spared points and drawn in the same way, whichever it is; what differs
stands here: which of its numbers are free, what each adds to the force, and what a law of fewer or
of more points makes of them. A law of fewer points has numbers y of which the first one's are
z = offset + basis y.

Where another origin of positions does the same as a constant, one force is held. A recording does
not see all of a grid: of two states that swing, the corners are seldom met. Only forces that
samples lie nearest to are free; the others are laid smoothly between and beyond them (the discrete
Laplace equation, `filled`), and say nothing. Of a product only the product is known, so that one
number of its second table is held; of a shift another origin of what is shifted is the same, so
that one shift is held.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from zwidth.diagnosis.laws.points import (
    basis,
    between,
    is_odd,
    law_at,
    left_out_of,
    points_over,
    table,
)
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_force import counts_at, force_at, grid_of, grid_values
from zwidth.sim.physics.free_law import FORCE, KNOTS, points_of
from zwidth.sim.physics.free_product import held, product_at
from zwidth.sim.physics.free_shift import shifted_at, unshifted
from zwidth.sim.physics.two_tables import (
    LAW_FIRST,
    LAW_SECOND,
    POINTS,
    TwoTables,
    table_at,
    two_tables_of,
    two_tables_values,
)
from zwidth.sim.place import place_at

Floats = NDArray[np.float64]
Seen = NDArray[np.bool_]
TABLES = {
    "free_spring": "position", "free_damper": "velocity", "free_amplifier": "command",
    "free_sensor": "position",
}  # fmt: skip


@dataclass(frozen=True)
class Site:
    """Where a law may stand: its place, the states it follows, what was seen of them.

    effect: of its table, "free_force" for two states. over: the states by name; states (samples,
    over). makes: how much a force of it is likely to be. floats: whether another origin of
    positions does the same as a constant. period: of a law that repeats, 0 for none; scale: of that
    as a parameter, 0 where it is known.
    """

    effect: str
    at: str
    over: tuple[str, ...]
    states: Floats
    makes: float = 1.0
    floats: bool = False
    period: float = 0.0
    scale: float = 0.0

    @property
    def name(self) -> str:
        """The states and the place, as people read them."""
        what = {"free_amplifier": ("command",), "free_sensor": ("what is read",)}
        return f"{' and '.join(what.get(self.effect, in_words(self.over, self.at)))} at {self.at}"

    @property
    def seen(self) -> Floats:
        """The first state (samples,)."""
        return self.states[:, 0]

    def along(self, over: Sequence[str]) -> tuple[Floats, ...]:
        """Return the states that were seen (samples,) in the order of some names."""
        return tuple(self.states[:, self.over.index(name)] for name in over)

    def table(self, states: Floats, forces: Floats, odd: bool = False) -> Physics:
        """Return a table over its state, each (points,)."""
        return table(self.effect, self.at, states, forces, odd, self.period)


def in_words(over: Sequence[str], at: str) -> tuple[str, ...]:
    """Return states as people name them at a place."""
    if at in ("command", "sensor") or place_at(at).kind != "link":
        return tuple(over)
    link = {"position": "what the link gives way", "velocity": "rate of the link"}
    return tuple(link.get(state, state) for state in over)


class Shape(NamedTuple):
    """A law of other points: where they stand along each state, and whether it is odd."""

    axes: tuple[Floats, ...]
    odd: bool = False


class Fewer(NamedTuple):
    """A law of other points: of its numbers y the first one's are offset + basis y.

    basis (numbers, fewer), offset (numbers,): of those that are free; law: the law of numbers y.
    """

    basis: Floats
    offset: Floats
    law: Callable[[Floats], Physics]


class Form(ABC):
    """A law of no name. names: of all its numbers; axes: where its points stand, by state."""

    names: tuple[str, ...]
    axes: tuple[Floats, ...]

    def __init__(self, law: Physics) -> None:
        self.law = law

    @abstractmethod
    def left_out(self) -> Floats:
        """Return by how much it is likely to err at each number (numbers,), its points few."""

    @abstractmethod
    def scales(self, site: Site) -> dict[str, float]:
        """Return the numbers that a fit may move, each with its scale."""

    @abstractmethod
    def fewer(self, site: Site, free: Collection[str], shape: Shape) -> Fewer:
        """Return a law of some other points, what `kept` names among them."""

    @abstractmethod
    def finer(self, site: Site) -> Physics | None:
        """Return the same law with more points; None where it has all that it may."""

    def bounds(self, site: Site) -> dict[str, tuple[float, float]]:
        """Return bounds of what a fit may move, where these are less than the effect allows."""
        return {}

    def kept(self, site: Site, free: Collection[str]) -> tuple[float, ...]:
        """Return the state of the number that is held, along each axis; NaN for none."""
        return (math.nan,) * len(self.axes)

    def shapes(self, site: Site) -> list[Shape]:
        """Return the laws of which points may go: the same law, and what else it may be."""
        return [Shape(self.axes)]

    def centred(self, site: Site) -> Physics:
        """Return the same law, what nothing tells of it as people would say it."""
        return self.law

    def moved(self, site: Site, by: float, more: float) -> Physics | None:
        """Return it where positions are counted from `by` below, with a constant force more.

        None where it is over no position, or has no place for a constant.
        """
        return None


class TableForm(Form):
    """A table over one state: odd, repeating, or neither."""

    def __init__(self, law: Physics) -> None:
        super().__init__(law)
        self.states, self.forces = np.array(points_of(law.values)).T
        self.odd, self.period = is_odd(law), law.values["period"]
        self.axes, self.names = (self.states,), FORCE[: self.states.size]

    def left_out(self) -> Floats:
        """Return by how much it is likely to err at each point (points,)."""
        return left_out_of(self.states, self.forces, self.odd, self.period)

    def scales(self, site: Site) -> dict[str, float]:
        """Return the forces that a fit may move, and the period where that is not known."""
        found = dict.fromkeys(self.names[int(self.odd) :], site.makes)
        if site.floats and not self.odd:  # the one that is nothing, the nearest to the middle
            middle = abs(np.arange(self.states.size) - self.states.size // 2)
            found.pop(self.names[np.lexsort((middle, np.abs(self.forces)))[0]])
        return found | ({"period": site.scale} if self._turns(site) else {})

    def bounds(self, site: Site) -> dict[str, tuple[float, float]]:
        """Return bounds of the period: the table is of one turn, and none of its points of two."""
        least = 1.001 * float(self.states[-1] - self.states[0])
        return {"period": (least, 2.0 * self.period)} if self._turns(site) else {}

    def _turns(self, site: Site) -> bool:
        return site.scale > 0.0 and self.period > 0.0

    def shapes(self, site: Site) -> list[Shape]:
        """Return the table itself and one that is odd, which has points of its own."""
        own = Shape(self.axes, self.odd)
        if self.odd or self.period > 0.0:
            return [own]
        odd = points_over(site.seen, max(12, self.states.size // 2 + 1), True)
        return [own] if odd is None else [own, Shape((odd,), True)]

    def fewer(self, site: Site, free: Collection[str], shape: Shape) -> Fewer:
        """Return a table of other points, of which another is held where one is."""
        (at,), odd = shape
        period = 0.0 if odd else self.period
        counts = self.told(free)(basis(at, odd, period, self.states))
        numbers = np.arange(int(odd), at.size)
        if not odd and len(free) < self.states.size - int(self.odd):
            numbers = np.delete(numbers, at.size // 2)
            counts = np.delete(counts, at.size // 2, axis=1)

        def law(y: Floats) -> Physics:
            forces = np.zeros(at.size)
            forces[numbers] = y
            return table(site.effect, site.at, at, forces, odd, period)

        return Fewer(counts, np.full(len(counts), self.level(free)), law)

    def told(self, free: Collection[str]) -> Callable[[Floats], Floats]:
        """Return what takes forces at its points (points, ...) to what is free of them.

        Forces count from that of the point that is held, where one is.
        """
        own, still = np.isin(self.names, list(free)), self._still(free)
        return lambda forces: forces[own] - (forces[still] if still.size else 0.0)

    def _still(self, free: Collection[str]) -> NDArray[np.int64]:
        """Which point is held; none where a constant is told."""
        own = np.isin(self.names, list(free))
        return np.flatnonzero(~own[int(self.odd) :]) + int(self.odd)

    def level(self, free: Collection[str]) -> float:
        """The force of the point that is held, from which those that are free count."""
        return float(self.forces[self._still(free)].sum())

    def finer(self, site: Site) -> Physics | None:
        """Return the same table with a point between each two."""
        s = self.states
        ends = np.append(s, s[0] + self.period) if self.period > 0.0 else s
        wide = np.diff(ends) > 1e-6 * (ends[-1] - ends[0])
        at = np.sort(np.concatenate([s, (0.5 * (ends[1:] + ends[:-1]))[wide]]))
        if not s.size < at.size <= KNOTS:
            return None
        forces = law_at(self.law, at)
        return table(site.effect, site.at, at, forces, self.odd, self.period)

    def moved(self, site: Site, by: float, more: float) -> Physics | None:
        """Return it where positions are counted from `by` below, with a constant force more."""
        if site.effect != "free_spring" or self.odd:
            return None
        states, forces = self.states + by, self.forces + more
        return table(site.effect, site.at, states, forces, False, self.period)


def told(states: Floats, rows: Floats, columns: Floats, enough: int = 10) -> Seen:
    """Return of which points of a grid (rows, columns) samples say something: enough are nearest.

    states (samples, 2).
    """
    edges = [0.5 * (axis[1:] + axis[:-1]) for axis in (rows, columns)]
    i, j = (np.searchsorted(edge, s) for edge, s in zip(edges, states.T, strict=True))
    count = np.bincount(i * columns.size + j, minlength=rows.size * columns.size)
    return count.reshape(rows.size, columns.size) >= enough


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


def grid(site: Site, rows: Floats, columns: Floats, forces: Floats) -> Physics:
    """Return a grid of forces (rows, columns)."""
    values = grid_values(site.over, rows.tolist(), columns.tolist(), forces)
    return make_physics("free_force", site.at, **values)


class GridForm(Form):
    """A grid of forces at rows and columns."""

    def __init__(self, law: Physics) -> None:
        super().__init__(law)
        self.grid = grid_of(law.values)
        self.rows, self.columns = np.array(self.grid.rows), np.array(self.grid.columns)
        self.cells = np.array(self.grid.names)
        self.names = tuple(self.cells.ravel().tolist())
        self.axes = self.rows, self.columns

    def at(self, first: Floats, second: Floats) -> Floats:
        """Return the force at states (...,)."""
        return force_at(self.grid, first, second)

    def slopes(self, first: Floats, second: Floats) -> Floats:
        """Return what each number adds to the force at states (...,): (..., numbers)."""
        a, b = counts_at(self.rows, first), counts_at(self.columns, second)
        each = np.einsum("...i,...j->...ij", a, b)
        return each.reshape(*each.shape[:-2], len(self.names))

    def left_out(self) -> Floats:
        """Return by how much it is likely to err at each number, along either state."""
        along = left_out_of(self.rows, self.grid.values)
        across = left_out_of(self.columns, self.grid.values.T).T
        return np.hypot(along, across).ravel()

    def finer(self, site: Site) -> Physics | None:
        """None: it begins with all the points that a grid may have."""
        return None

    def moved(self, site: Site, by: float, more: float) -> Physics | None:
        """Return it where positions are counted from `by` below, with a constant force more."""
        if "position" not in self.grid.over:
            return None
        rows, columns = _counted_from(self.axes, self.grid.over, by)
        return grid(site, rows, columns, self.grid.values + more)

    def told(self, site: Site) -> Seen:
        """Return of which of its forces the recordings say something."""
        return told(site.states, self.rows, self.columns)

    def smooth(self, site: Site) -> Floats:
        """Return its forces, those that the recordings do not tell laid smoothly."""
        return filled(self.grid.values, self.told(site))

    def scales(self, site: Site) -> dict[str, float]:
        """Return the forces that a fit may move: what is told, but for one where it floats."""
        free = self.told(site)
        if site.floats and free.any():  # the one that is nearest to the middle
            i, j = np.nonzero(free)
            middle = (np.array(free.shape) - 1) / 2.0
            k = int(np.argmin((i - middle[0]) ** 2 + (j - middle[1]) ** 2))
            free[i[k], j[k]] = False
        return dict.fromkeys(self.cells[free].tolist(), site.makes)

    def kept(self, site: Site, free: Collection[str]) -> tuple[float, ...]:
        """Return row and column of the force that is held; NaN for none."""
        still = self._held(site, free)
        if not still.any():
            return super().kept(site, free)
        (i,), (j,) = np.nonzero(still)
        return float(self.rows[i]), float(self.columns[j])

    def _held(self, site: Site, free: Collection[str]) -> Seen:
        return self.told(site) & ~np.isin(self.cells, list(free))

    def fewer(self, site: Site, free: Collection[str], shape: Shape) -> Fewer:
        """Return a grid of some rows and columns; what it does not see follows what it does."""
        rows, columns = shape.axes
        some = np.ix_(np.searchsorted(self.rows, rows), np.searchsorted(self.columns, columns))
        known, still = self.told(site)[some], self._held(site, free)[some]
        moves = known & ~still
        units = np.zeros((int(moves.sum()), *moves.shape))
        units[np.arange(len(units)), *np.nonzero(moves)] = 1.0
        laid = np.array([filled(units[k], known) for k in range(len(units))]).reshape(units.shape)
        fixed = filled(np.where(still, self.grid.values[some], 0.0), known)
        fixed = fixed if known.any() else np.zeros(known.shape)
        a, b = counts_at(rows, self.rows), counts_at(columns, self.columns)
        each = np.einsum("ik,jl->ijkl", a, b)[np.isin(self.cells, list(free))]

        def law(y: Floats) -> Physics:
            return grid(site, rows, columns, fixed + np.einsum("u,ukl->kl", y, laid))

        return Fewer(np.einsum("nkl,ukl->nu", each, laid), np.einsum("nkl,kl->n", each, fixed), law)


def _counted_from(axes: Sequence[Floats], over: Sequence[str], by: float) -> list[Floats]:
    """Points along either state, positions counted from `by` below."""
    return [axis + by * (name == "position") for axis, name in zip(axes, over, strict=True)]


class TablesForm(Form):
    """Two tables: of a force over one state, and of what the other state makes of it."""

    effect: str

    def __init__(self, law: Physics) -> None:
        super().__init__(law)
        self.tables = two_tables_of(law.values)
        self.states, self.forces = np.array(self.tables.first).T
        self.beside, self.others = np.array(self.tables.second).T
        self.axes, self.laws = (self.states, self.beside), (self.forces, self.others)
        self.both = LAW_FIRST[: self.states.size], LAW_SECOND[: self.beside.size]
        self.names = (*self.both[0], *self.both[1])

    @classmethod
    def of(
        cls, at: str, over: tuple[str, str], axes: Sequence[Floats], laws: Sequence[Floats]
    ) -> Physics:
        """Return a law of this form: two tables over two states, points and laws (points,)."""
        a, b = (
            tuple(zip(s.tolist(), f.tolist(), strict=True)) for s, f in zip(axes, laws, strict=True)
        )
        return make_physics(cls.effect, at, **two_tables_values(*TwoTables(over, a, b)))

    def _other(self, axes: Sequence[Floats], laws: Sequence[Floats]) -> Physics:
        return self.of(self.law.at, self.tables.over, axes, laws)

    @abstractmethod
    def seen(self, site: Site) -> tuple[Floats, Floats]:
        """Return where samples are along either table (samples,)."""

    @abstractmethod
    def varies(self) -> tuple[float, float]:
        """Return by how much either table's law varies, in its own unit."""

    def left_out(self) -> Floats:
        """Return by how much either table is likely to err at each number."""
        return np.concatenate(list(map(left_out_of, self.axes, self.laws)))

    def _held(self, free: Collection[str]) -> list[int]:
        """Which number of either table is held; -1 for none.

        Of a product it was the largest when the fit began, and need not be at its end.
        """
        return [next((k for k, n in enumerate(names) if n not in free), -1) for names in self.both]

    def kept(self, site: Site, free: Collection[str]) -> tuple[float, ...]:
        """Return the state of the number that is held along either table; NaN for none."""
        each = zip(self.axes, self._held(free), strict=True)
        return tuple(float(at[k]) if k >= 0 else math.nan for at, k in each)

    def finer(self, site: Site, misses: float = 0.05) -> Physics | None:
        """Return the same law with a point between each two of the table that holds its law least.

        None where both hold it: points miss less than a share of what the law varies by.
        """
        missing = [
            float(np.sqrt(np.mean(left_out_of(at, law) ** 2))) / max(varies, 1e-300)
            for at, law, varies in zip(self.axes, self.laws, self.varies(), strict=True)
        ]
        k, axes = int(np.argmax(missing)), list(self.axes)
        axes[k] = between(axes[k], self.seen(site)[k])
        if max(missing) < misses or not self.axes[k].size < axes[k].size <= POINTS:
            return None
        laws = [
            counts_at(at, there) @ law
            for at, there, law in zip(self.axes, axes, self.laws, strict=True)
        ]
        return self._other(axes, laws)

    def fewer(self, site: Site, free: Collection[str], shape: Shape) -> Fewer:
        """Return a law of some points of either table."""
        parts: list[tuple[Floats, Floats, Callable[[Floats], Floats]]] = [
            _fewer_of(at, laws, np.searchsorted(at, some), fixed)
            for at, laws, some, fixed in zip(
                self.axes, self.laws, shape.axes, self._held(free), strict=True
            )
        ]
        split = parts[0][0].shape[1]

        def law(y: Floats) -> Physics:
            each = zip(parts, (y[:split], y[split:]), strict=True)
            return self._other(shape.axes, [whole(own) for (_, _, whole), own in each])

        offset = np.concatenate([one for _, one, _ in parts])
        return Fewer(block_diag(*(one for one, _, _ in parts)), offset, law)


def _fewer_of(
    at: Floats, laws: Floats, some: NDArray[np.int64], fixed: int
) -> tuple[Floats, Floats, Callable[[Floats], Floats]]:
    """What numbers y of fewer points make of the free ones of a table: basis, offset, all laws."""
    still, free = some == fixed, np.arange(at.size) != fixed
    counts = counts_at(at[some], at)[free]

    def whole(y: Floats) -> Floats:
        found = laws[some]
        found[~still] = y
        return found

    return counts[:, ~still], counts[:, still] @ laws[some][still], whole


class ProductForm(TablesForm):
    """A force over one state, taken times a number over the other."""

    effect = "free_product"

    def seen(self, site: Site) -> tuple[Floats, Floats]:
        """Return where samples are along either table (samples,)."""
        first, second = site.along(self.tables.over)
        return first, second

    def varies(self) -> tuple[float, float]:
        """Return the rms of either law: a product is nothing where either is."""
        return float(np.sqrt(np.mean(self.forces**2))), float(np.sqrt(np.mean(self.others**2)))

    def at(self, first: Floats, second: Floats) -> Floats:
        """Return the force at states (...,)."""
        return product_at(self.tables, first, second)

    def slopes(self, first: Floats, second: Floats) -> Floats:
        """Return what each number adds to the force at states (...,): (..., numbers)."""
        a, b = counts_at(self.states, first), counts_at(self.beside, second)
        of_laws, of_others = a * (b @ self.others)[..., None], b * (a @ self.forces)[..., None]
        return np.concatenate([of_laws, of_others], axis=-1)

    def scales(self, site: Site) -> dict[str, float]:
        """Return the numbers that a fit may move: all but the largest of the second table."""
        found = dict.fromkeys(self.both[0], site.makes) | dict.fromkeys(self.both[1], 0.3)
        found.pop(LAW_SECOND[held(self.others.tolist())])
        return found


class ShiftForm(TablesForm):
    """A force over one state, which the other shifts along it."""

    effect = "free_shift"

    def centred(self, site: Site) -> Physics:
        """Return the same law with no shift where the other state is nothing, or in its middle."""
        _, second = site.along(self.tables.over)
        rest = 0.0 if second.min() < 0.0 < second.max() else float(np.median(second))
        none = float(table_at(self.tables.second, rest))
        return self._other((self.states - none, self.beside), (self.forces, self.others - none))

    def seen(self, site: Site) -> tuple[Floats, Floats]:
        """Return where samples are along either table (samples,): the first one's are shifted."""
        first, second = site.along(self.tables.over)
        return first + table_at(self.tables.second, second), second

    def varies(self) -> tuple[float, float]:
        """Return the scatter of either law: a constant in either is another origin."""
        return float(np.std(self.forces)), float(np.std(self.others))

    def moved(self, site: Site, by: float, more: float) -> Physics | None:
        """Return it where positions are counted from `by` below, with a constant force more."""
        if "position" not in self.tables.over:
            return None
        axes = _counted_from(self.axes, self.tables.over, by)
        return self._other(axes, (self.forces + more, self.others))

    def at(self, first: Floats, second: Floats) -> Floats:
        """Return the force at states (...,)."""
        return shifted_at(self.tables, first, second)

    def slopes(self, first: Floats, second: Floats) -> Floats:
        """Return what each number adds to the force at states (...,): (..., numbers)."""
        b = counts_at(self.beside, second)
        along, law = first + b @ self.others, partial(table_at, self.tables.first)
        step = 1e-4 * float(np.ptp(self.states))
        rise = (law(along + step) - law(along - step)) / (2.0 * step)
        return np.concatenate([counts_at(self.states, along), rise[..., None] * b], axis=-1)

    def scales(self, site: Site) -> dict[str, float]:
        """Return the numbers that a fit may move: all but one shift, and one force if it floats."""
        along = 0.1 * float(np.ptp(site.along(self.tables.over)[0]))
        found = dict.fromkeys(self.both[0], site.makes) | dict.fromkeys(self.both[1], along)
        found.pop(LAW_SECOND[unshifted(self.others.tolist())])
        if site.floats:
            found.pop(LAW_FIRST[self.states.size // 2])
        return found


FormOfTwo = GridForm | ProductForm | ShiftForm


def form_of_two(law: Physics) -> FormOfTwo:
    """Return the form of a law over two states."""
    forms = {"free_force": GridForm, "free_product": ProductForm, "free_shift": ShiftForm}
    return forms[law.effect.name](law)


def form_of(law: Physics) -> Form:
    """Return the form of a law of no name."""
    return TableForm(law) if law.effect.name in TABLES else form_of_two(law)

"""The forms of a law over two states: a grid of forces, and two tables, as product or as shift.

All surfaces are started, fitted, reduced and drawn in the same way. The forms differ in which
numbers are free, how each changes the force, and how fewer numbers y give those of the full law, z
= offset + basis y.

A recording does not visit all of a grid: of two oscillating states, the corners are seldom reached.
Only forces that are nearest to some sample are free; the others interpolate and extrapolate them
smoothly (the discrete Laplace equation, `filled`), and carry no information. If another origin of
positions is equivalent to a constant, one force is fixed. One number of the second table of a
product is fixed, since only the product is known. One shift is fixed, since another origin of the
shifted state is equivalent.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from zwidth.diagnosis.learning.tables import MET, left_out_of
from zwidth.shown import Valued
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_force import counts_at, force_at, grid_of, grid_values
from zwidth.sim.physics.free_product import held, product_at
from zwidth.sim.physics.free_shift import shifted_at, unshifted
from zwidth.sim.physics.two_tables import (
    LAW_FIRST,
    LAW_SECOND,
    TwoTables,
    table_at,
    two_tables_of,
    two_tables_values,
)
from zwidth.sim.place import place_at

Floats = NDArray[np.float64]
Places = NDArray[np.int64]
Seen = NDArray[np.bool_]
OF_A_SHARE = 0.3  # scale of a factor of a force; the largest factor is 1
OF_A_RANGE = 0.1  # scale of a shift, over the range of the shifted state
NARROW = 1e-4  # width of the differences for slopes, over the range of a table


@dataclass(frozen=True)
class Field:
    """A candidate for a surface: place, two states, and their samples (samples, 2).

    makes: prior size of its forces. floats: whether a constant is equivalent to another origin of
    positions.
    """

    at: str
    over: tuple[str, str]
    states: Floats
    makes: float
    floats: bool

    @property
    def name(self) -> str:
        """The states and the place in words."""
        return f"{' and '.join(in_words(self.over, self.at))} at {self.at}"

    def along(self, over: tuple[str, str]) -> tuple[Floats, Floats]:
        """Return the states that were seen (samples,) in the order of two names."""
        first, second = (self.states[:, self.over.index(name)] for name in over)
        return first, second


def in_words(over: Sequence[str], at: str) -> tuple[str, ...]:
    """Return the usual names of states at a place."""
    if place_at(at).kind != "link":
        return tuple(over)
    link = {"position": "deflection of the link", "velocity": "rate of the link"}
    return tuple(link.get(state, state) for state in over)


class Fewer(NamedTuple):
    """A law of fewer points, whose numbers y give the full ones as offset + basis y.

    basis (numbers, fewer), offset (numbers,): for the free numbers; law: returns the law of y.
    """

    basis: Floats
    offset: Floats
    law: Callable[[Floats], Physics]


class Form(ABC, Valued):
    """A law over two states; names: of its numbers; sizes: numbers of points along each state."""

    names: tuple[str, ...]
    sizes: tuple[int, int]

    def __init__(self, law: Physics) -> None:
        self.law = law

    @abstractmethod
    def at(self, first: Floats, second: Floats) -> Floats:
        """Return the force at states (...,)."""

    @abstractmethod
    def slopes(self, first: Floats, second: Floats) -> Floats:
        """Return what each number adds to the force at states (...,): (..., numbers)."""

    @abstractmethod
    def left_out(self) -> Floats:
        """Return the likely error at each number (numbers,) because points are few."""

    @abstractmethod
    def scales(self, field: Field) -> dict[str, float]:
        """Return the numbers that a fit may move, each with its scale."""

    @abstractmethod
    def kept(self, field: Field, free: Collection[str]) -> tuple[int, int]:
        """Return the point along each state whose value is fixed; -1 for none."""

    @abstractmethod
    def fewer(self, field: Field, free: Collection[str], first: Places, second: Places) -> Fewer:
        """Return the law with some of its points along each state, including those in `kept`."""

    def centred(self, field: Field) -> Physics:
        """Return an equivalent law with a conventional choice of its arbitrary constants."""
        return self.law

    @abstractmethod
    def moved(self, field: Field, by: float, more: float) -> Physics | None:
        """Return the law with position points shifted up by `by`, plus a constant force `more`.

        None if the law depends on no position, or cannot contain a constant.
        """


def form_of(law: Physics) -> Form:
    """Return the form of a law over two states."""
    return FORMS[law.effect.name](law)


def grid(field: Field, rows: Floats, columns: Floats, forces: Floats) -> Physics:
    """Return a grid of forces (rows, columns)."""
    values = grid_values(field.over, rows.tolist(), columns.tolist(), forces)
    return make_physics("free_force", field.at, **values)


def product(field: Field, a: Floats, f: Floats, b: Floats, g: Floats) -> Physics:
    """Return a product of laws f at states a and numbers g at states b."""
    tables = tables_of(field.over, a, f, b, g)
    return make_physics("free_product", field.at, **two_tables_values(*tables))


def shift(
    field: Field, over: tuple[str, str], a: Floats, f: Floats, b: Floats, g: Floats
) -> Physics:
    """Return laws f at states a, shifted along them by g at states b; over: which is which."""
    tables = tables_of(over, a, f, b, g)
    return make_physics("free_shift", field.at, **two_tables_values(*tables))


def tables_of(over: tuple[str, str], a: Floats, f: Floats, b: Floats, g: Floats) -> TwoTables:
    """Return two tables over two states."""
    first = tuple(zip(a.tolist(), f.tolist(), strict=True))
    return TwoTables(over, first, tuple(zip(b.tolist(), g.tolist(), strict=True)))


def told(states: Floats, rows: Floats, columns: Floats) -> Seen:
    """Return which points of a grid (rows, columns) are nearest to enough samples (samples, 2)."""
    edges = [0.5 * (axis[1:] + axis[:-1]) for axis in (rows, columns)]
    i, j = (np.searchsorted(edge, s) for edge, s in zip(edges, states.T, strict=True))
    count = np.bincount(i * columns.size + j, minlength=rows.size * columns.size)
    return count.reshape(rows.size, columns.size) >= MET


def filled(forces: Floats, known: Seen) -> Floats:
    """Return a grid with unknown forces interpolated: each is the mean of its neighbours."""
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


class GridForm(Form):
    """A grid of forces at rows and columns."""

    def __init__(self, law: Physics) -> None:
        super().__init__(law)
        self.grid = grid_of(law.values)
        self.rows, self.columns = np.array(self.grid.rows), np.array(self.grid.columns)
        self.cells = np.array(self.grid.names)
        self.names = tuple(self.cells.ravel().tolist())
        self.sizes = self.rows.size, self.columns.size

    def at(self, first: Floats, second: Floats) -> Floats:
        """Return the force at states (...,)."""
        return force_at(self.grid, first, second)

    def slopes(self, first: Floats, second: Floats) -> Floats:
        """Return what each number adds to the force at states (...,): (..., numbers)."""
        a, b = counts_at(self.rows, first), counts_at(self.columns, second)
        each = np.einsum("...i,...j->...ij", a, b)
        return each.reshape(*each.shape[:-2], len(self.names))

    def left_out(self) -> Floats:
        """Return the likely error at each number, along each state."""
        along = left_out_of(self.rows, self.grid.values)
        across = left_out_of(self.columns, self.grid.values.T).T
        return np.hypot(along, across).ravel()

    def moved(self, field: Field, by: float, more: float) -> Physics | None:
        """Return the law with position points shifted up by `by`, plus a constant force `more`."""
        if "position" not in self.grid.over:
            return None
        rows, columns = (
            axis + by * (name == "position")
            for axis, name in zip((self.rows, self.columns), self.grid.over, strict=True)
        )
        return grid(field, rows, columns, self.grid.values + more)

    def told(self, field: Field) -> Seen:
        """Return which forces the recordings determine."""
        return told(field.states, self.rows, self.columns)

    def smooth(self, field: Field) -> Floats:
        """Return the forces, with undetermined ones interpolated smoothly."""
        return filled(self.grid.values, self.told(field))

    def scales(self, field: Field) -> dict[str, float]:
        """Return the forces that a fit may change: those determined, except one if it floats."""
        free = self.told(field)
        if field.floats and free.any():  # the one nearest to the middle
            i, j = np.nonzero(free)
            middle = (np.array(free.shape) - 1) / 2.0
            k = int(np.argmin((i - middle[0]) ** 2 + (j - middle[1]) ** 2))
            free[i[k], j[k]] = False
        return dict.fromkeys(self.cells[free].tolist(), field.makes)

    def kept(self, field: Field, free: Collection[str]) -> tuple[int, int]:
        """Return row and column of the fixed force; -1 for none."""
        still = self._held(field, free)
        if not still.any():
            return -1, -1
        (i,), (j,) = np.nonzero(still)
        return int(i), int(j)

    def _held(self, field: Field, free: Collection[str]) -> Seen:
        return self.told(field) & ~np.isin(self.cells, list(free))

    def fewer(self, field: Field, free: Collection[str], first: Places, second: Places) -> Fewer:
        """Return a grid of some rows and columns; undetermined forces are interpolated."""
        some = np.ix_(first, second)
        known, still = self.told(field)[some], self._held(field, free)[some]
        moves = known & ~still
        units = np.zeros((int(moves.sum()), *moves.shape))
        units[np.arange(len(units)), *np.nonzero(moves)] = 1.0
        laid = np.array([filled(units[k], known) for k in range(len(units))]).reshape(units.shape)
        fixed = filled(np.where(still, self.grid.values[some], 0.0), known)
        fixed = fixed if known.any() else np.zeros(known.shape)
        a = counts_at(self.rows[first], self.rows)
        b = counts_at(self.columns[second], self.columns)
        each = np.einsum("ik,jl->ijkl", a, b)[np.isin(self.cells, list(free))]

        def law(y: Floats) -> Physics:
            forces = fixed + np.einsum("u,ukl->kl", y, laid)
            return grid(field, self.rows[first], self.columns[second], forces)

        return Fewer(np.einsum("nkl,ukl->nu", each, laid), np.einsum("nkl,kl->n", each, fixed), law)


class TablesForm(Form):
    """Two tables: a force over one state, and a factor or shift over the other."""

    def __init__(self, law: Physics) -> None:
        super().__init__(law)
        self.tables = two_tables_of(law.values)
        self.states, self.laws = np.array(self.tables.first).T
        self.beside, self.others = np.array(self.tables.second).T
        self.sizes = self.states.size, self.beside.size
        self.names = (*LAW_FIRST[: self.states.size], *LAW_SECOND[: self.beside.size])

    def of(self, field: Field, tables: TwoTables) -> Physics:
        """Return a law of this form with other tables."""
        return make_physics(self.law.effect.name, field.at, **two_tables_values(*tables))

    @abstractmethod
    def seen(self, field: Field) -> tuple[Floats, Floats]:
        """Return the positions of samples along each table (samples,)."""

    def left_out(self) -> Floats:
        """Return the likely error of each table at each number."""
        both = ((self.states, self.laws), (self.beside, self.others))
        return np.concatenate([left_out_of(states, laws) for states, laws in both])

    def kept(self, field: Field, free: Collection[str]) -> tuple[int, int]:
        """Return which number of each table is fixed; -1 for none.

        The fixed number of a product was the largest at the start of the fit, not necessarily at
        its end.
        """
        both = (LAW_FIRST[: self.states.size], LAW_SECOND[: self.beside.size])
        each = [next((k for k, n in enumerate(names) if n not in free), -1) for names in both]
        return each[0], each[1]

    @abstractmethod
    def varies(self) -> tuple[float, float]:
        """Return the variation of each table's law, in its own unit."""

    def coarser(self) -> tuple[int, float]:
        """Return which table, 0 or 1, has the larger error over its variation, and this ratio."""
        both = ((self.states, self.laws), (self.beside, self.others))
        misses = [
            float(np.sqrt(np.mean(left_out_of(at, laws) ** 2))) / max(varies, 1e-300)
            for (at, laws), varies in zip(both, self.varies(), strict=True)
        ]
        return int(np.argmax(misses)), max(misses)

    def on(self, field: Field, first: Floats, second: Floats) -> Physics:
        """Return the same law with tables at other states, each (points,)."""
        f = counts_at(self.states, first) @ self.laws
        g = counts_at(self.beside, second) @ self.others
        return self.of(field, tables_of(self.tables.over, first, f, second, g))

    def fewer(self, field: Field, free: Collection[str], first: Places, second: Places) -> Fewer:
        """Return a law with some of the points of each table."""
        parts = [
            _fewer_of(at, laws, some, fixed)
            for at, laws, some, fixed in zip(
                (self.states, self.beside), (self.laws, self.others), (first, second),
                self.kept(field, free), strict=True,
            )
        ]  # fmt: skip
        split = parts[0].basis.shape[1]

        def law(y: Floats) -> Physics:
            f, g = parts[0].whole(y[:split]), parts[1].whole(y[split:])
            tables = tables_of(self.tables.over, self.states[first], f, self.beside[second], g)
            return self.of(field, tables)

        offset = np.concatenate([one.offset for one in parts])
        return Fewer(block_diag(*(one.basis for one in parts)), offset, law)


class _Table(NamedTuple):
    """A table by numbers y of fewer points: its free numbers are offset + basis y."""

    basis: Floats
    offset: Floats
    whole: Callable[[Floats], Floats]


def _fewer_of(at: Floats, laws: Floats, some: Places, fixed: int) -> _Table:
    still, free = some == fixed, np.arange(at.size) != fixed
    counts = counts_at(at[some], at)[free]

    def whole(y: Floats) -> Floats:
        found = laws[some]
        found[~still] = y
        return found

    return _Table(counts[:, ~still], counts[:, still] @ laws[some][still], whole)


class ProductForm(TablesForm):
    """A force over one state, times a number over the other."""

    def seen(self, field: Field) -> tuple[Floats, Floats]:
        """Return the positions of samples along each table (samples,)."""
        return field.along(self.tables.over)

    def varies(self) -> tuple[float, float]:
        """Return the rms of both laws, since a product is zero if one of them is."""
        return float(np.sqrt(np.mean(self.laws**2))), float(np.sqrt(np.mean(self.others**2)))

    def moved(self, field: Field, by: float, more: float) -> Physics | None:
        """Return None: a product contains no constant, so the origin of positions is determined."""
        return None

    def at(self, first: Floats, second: Floats) -> Floats:
        """Return the force at states (...,)."""
        return product_at(self.tables, first, second)

    def slopes(self, first: Floats, second: Floats) -> Floats:
        """Return what each number adds to the force at states (...,): (..., numbers)."""
        a, b = counts_at(self.states, first), counts_at(self.beside, second)
        of_laws, of_others = a * (b @ self.others)[..., None], b * (a @ self.laws)[..., None]
        return np.concatenate([of_laws, of_others], axis=-1)

    def scales(self, field: Field) -> dict[str, float]:
        """Return the numbers that a fit may change: all but the largest of the second table."""
        found = dict.fromkeys(LAW_FIRST[: self.states.size], field.makes)
        found |= dict.fromkeys(LAW_SECOND[: self.beside.size], OF_A_SHARE)
        found.pop(LAW_SECOND[held(self.others.tolist())])
        return found


class ShiftForm(TablesForm):
    """A force over one state, shifted along it by the other."""

    def centred(self, field: Field) -> Physics:
        """Return an equivalent law whose shift is zero at zero of the other state or its median."""
        _, second = field.along(self.tables.over)
        rest = 0.0 if second.min() < 0.0 < second.max() else float(np.median(second))
        none = float(table_at(self.tables.second, rest))
        return shift(
            field, self.tables.over, self.states - none, self.laws, self.beside, self.others - none
        )

    def seen(self, field: Field) -> tuple[Floats, Floats]:
        """Return the positions of samples along each table (samples,), shifted along the first."""
        first, second = field.along(self.tables.over)
        return first + table_at(self.tables.second, second), second

    def varies(self) -> tuple[float, float]:
        """Return the scatter of both laws, since a constant in one is only another origin."""
        return float(np.std(self.laws)), float(np.std(self.others))

    def moved(self, field: Field, by: float, more: float) -> Physics | None:
        """Return the law with position points shifted up by `by`, plus a constant force `more`."""
        if "position" not in self.tables.over:
            return None
        a, b = (
            states + by * (name == "position")
            for states, name in zip((self.states, self.beside), self.tables.over, strict=True)
        )
        return shift(field, self.tables.over, a, self.laws + more, b, self.others)

    def at(self, first: Floats, second: Floats) -> Floats:
        """Return the force at states (...,)."""
        return shifted_at(self.tables, first, second)

    def slopes(self, first: Floats, second: Floats) -> Floats:
        """Return what each number adds to the force at states (...,): (..., numbers)."""
        b = counts_at(self.beside, second)
        along = first + b @ self.others
        step = NARROW * float(np.ptp(self.states))
        rise = table_at(self.tables.first, along + step)
        rise = (rise - table_at(self.tables.first, along - step)) / (2.0 * step)
        return np.concatenate([counts_at(self.states, along), rise[..., None] * b], axis=-1)

    def scales(self, field: Field) -> dict[str, float]:
        """Return the numbers that a fit may change: not one shift, nor one force if it floats."""
        along = OF_A_RANGE * float(np.ptp(field.along(self.tables.over)[0]))
        found = dict.fromkeys(LAW_FIRST[: self.states.size], field.makes)
        found |= dict.fromkeys(LAW_SECOND[: self.beside.size], along)
        found.pop(LAW_SECOND[unshifted(self.others.tolist())])
        if field.floats:
            found.pop(LAW_FIRST[self.states.size // 2])
        return found


FORMS: dict[str, type[GridForm] | type[ProductForm] | type[ShiftForm]] = {
    "free_force": GridForm,
    "free_product": ProductForm,
    "free_shift": ShiftForm,
}

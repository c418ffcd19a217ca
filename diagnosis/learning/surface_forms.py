"""The two forms of a law over two states: a grid of forces, and a product of two tables.

A surface is begun, fitted, spared points and drawn in the same way, whichever it is; what differs
stands here: which of its numbers are free, what each adds to the force, and what a law of fewer
points makes of them. Such a law has numbers y of which the first one's are z = offset + basis y.

A recording does not see all of a grid: of two states that swing, the corners are seldom met. Only
forces that samples lie nearest to are free; the others are laid smoothly between and beyond them
(the discrete Laplace equation, `filled`), and say nothing. Where another origin of positions does
the same as a constant, one force is held. Of a product only the product is known, so that one
number of its second table is held.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.learning.tables import MET, left_out_of
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_force import counts_at, force_at, grid_of, grid_values
from zwidth.sim.physics.free_product import (
    FORCE_FIRST,
    SHARE_SECOND,
    held,
    is_product,
    product_at,
    product_of,
    product_values,
)
from zwidth.sim.place import place_at

Floats = NDArray[np.float64]
Places = NDArray[np.int64]
Seen = NDArray[np.bool_]
OF_A_SHARE = 0.3  # scale of a number that a force is taken times, of which the largest is one


@dataclass(frozen=True)
class Field:
    """Where a surface may stand: place, two states, what was seen of them (samples, 2).

    makes: how much a force of it is likely to be. floats: whether another origin of positions does
    the same as a constant.
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


def in_words(over: Sequence[str], at: str) -> tuple[str, ...]:
    """Return states as people name them at a place."""
    if place_at(at).kind != "link":
        return tuple(over)
    link = {"position": "what the link gives way", "velocity": "rate of the link"}
    return tuple(link.get(state, state) for state in over)


class Fewer(NamedTuple):
    """A law of fewer points: of its numbers y the first one's are offset + basis y.

    basis (numbers, fewer), offset (numbers,): of those that are free; law: the law of numbers y.
    """

    basis: Floats
    offset: Floats
    law: Callable[[Floats], Physics]


class Form(ABC):
    """A law over two states.

    names: of all its numbers; sizes: how many points it has along either state.
    """

    names: tuple[str, ...]
    sizes: tuple[int, int]

    @abstractmethod
    def at(self, first: Floats, second: Floats) -> Floats:
        """Return the force at states (...,)."""

    @abstractmethod
    def slopes(self, first: Floats, second: Floats) -> Floats:
        """Return what each number adds to the force at states (...,): (..., numbers)."""

    @abstractmethod
    def left_out(self) -> Floats:
        """Return by how much it is likely to err at each number (numbers,), its points few."""

    @abstractmethod
    def scales(self, field: Field) -> dict[str, float]:
        """Return the numbers that a fit may move, each with its scale."""

    @abstractmethod
    def kept(self, field: Field, free: Collection[str]) -> tuple[int, int]:
        """Return which point along either state is that of the number that is held; -1 for none."""

    @abstractmethod
    def fewer(self, field: Field, free: Collection[str], first: Places, second: Places) -> Fewer:
        """Return a law of some of its points along either state, what `kept` names among them."""


def form_of(law: Physics) -> Form:
    """Return the form of a grid or a product."""
    return ProductForm(law) if is_product(law.effect.parameters) else GridForm(law)


def grid(field: Field, rows: Floats, columns: Floats, forces: Floats) -> Physics:
    """Return a grid of forces (rows, columns)."""
    values = grid_values(field.over, rows.tolist(), columns.tolist(), forces)
    return make_physics("free_force", field.at, **values)


def product(field: Field, a: Floats, f: Floats, b: Floats, g: Floats) -> Physics:
    """Return a product of laws f at states a and numbers g at states b."""
    tables = (np.column_stack(pair).tolist() for pair in ((a, f), (b, g)))
    return make_physics("free_product", field.at, **product_values(field.over, *tables))


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


class GridForm(Form):
    """A grid of forces at rows and columns."""

    def __init__(self, law: Physics) -> None:
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
        """Return by how much it is likely to err at each number, along either state."""
        along = left_out_of(self.rows, self.grid.values)
        across = left_out_of(self.columns, self.grid.values.T).T
        return np.hypot(along, across).ravel()

    def told(self, field: Field) -> Seen:
        """Return of which of its forces the recordings say something."""
        return told(field.states, self.rows, self.columns)

    def smooth(self, field: Field) -> Floats:
        """Return its forces, those that the recordings do not tell laid smoothly."""
        return filled(self.grid.values, self.told(field))

    def scales(self, field: Field) -> dict[str, float]:
        """Return the forces that a fit may move: what is told, but for one where it floats."""
        free = self.told(field)
        if field.floats and free.any():  # the one that is nearest to the middle
            i, j = np.nonzero(free)
            middle = (np.array(free.shape) - 1) / 2.0
            k = int(np.argmin((i - middle[0]) ** 2 + (j - middle[1]) ** 2))
            free[i[k], j[k]] = False
        return dict.fromkeys(self.cells[free].tolist(), field.makes)

    def kept(self, field: Field, free: Collection[str]) -> tuple[int, int]:
        """Return row and column of the force that is held; -1 for none."""
        still = self._held(field, free)
        if not still.any():
            return -1, -1
        (i,), (j,) = np.nonzero(still)
        return int(i), int(j)

    def _held(self, field: Field, free: Collection[str]) -> Seen:
        return self.told(field) & ~np.isin(self.cells, list(free))

    def fewer(self, field: Field, free: Collection[str], first: Places, second: Places) -> Fewer:
        """Return a grid of some rows and columns; what it does not see follows what it does."""
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


class ProductForm(Form):
    """Two tables: a force over one state, and what it is taken times over the other."""

    def __init__(self, law: Physics) -> None:
        self.product = product_of(law.values)
        self.states, self.laws = np.array(self.product.first).T
        self.beside, self.shares = np.array(self.product.second).T
        self.sizes = self.states.size, self.beside.size
        self.names = (*FORCE_FIRST[: self.states.size], *SHARE_SECOND[: self.beside.size])

    def at(self, first: Floats, second: Floats) -> Floats:
        """Return the force at states (...,)."""
        return product_at(self.product, first, second)

    def slopes(self, first: Floats, second: Floats) -> Floats:
        """Return what each number adds to the force at states (...,): (..., numbers)."""
        a, b = counts_at(self.states, first), counts_at(self.beside, second)
        of_laws, of_shares = a * (b @ self.shares)[..., None], b * (a @ self.laws)[..., None]
        return np.concatenate([of_laws, of_shares], axis=-1)

    def left_out(self) -> Floats:
        """Return by how much either table is likely to err at each number."""
        both = ((self.states, self.laws), (self.beside, self.shares))
        return np.concatenate([left_out_of(states, laws) for states, laws in both])

    def scales(self, field: Field) -> dict[str, float]:
        """Return the numbers that a fit may move: all but the largest of the second table."""
        found = dict.fromkeys(FORCE_FIRST[: self.states.size], field.makes)
        found |= dict.fromkeys(SHARE_SECOND[: self.beside.size], OF_A_SHARE)
        found.pop(SHARE_SECOND[held(self.shares.tolist())])
        return found

    def kept(self, field: Field, free: Collection[str]) -> tuple[int, int]:
        """Return that of the first table none is held, and which of the second is.

        It was the largest when the fit began, and need not be at its end.
        """
        (fixed,) = (k for k in range(self.beside.size) if SHARE_SECOND[k] not in free)
        return -1, fixed

    def coarser(self) -> tuple[int, float]:
        """Return which of its tables, 0 or 1, misses most of its law between points, and how much.

        As a share of the law's rms.
        """
        misses = [
            float(np.sqrt(np.sum(left_out_of(at, laws) ** 2) / max(np.sum(laws**2), 1e-300)))
            for at, laws in ((self.states, self.laws), (self.beside, self.shares))
        ]
        return int(np.argmax(misses)), max(misses)

    def on(self, field: Field, first: Floats, second: Floats) -> Physics:
        """Return the same product with tables of other states, each (points,)."""
        f = counts_at(self.states, first) @ self.laws
        g = counts_at(self.beside, second) @ self.shares
        return product(field, first, f, second, g)

    def fewer(self, field: Field, free: Collection[str], first: Places, second: Places) -> Fewer:
        """Return a product of some points of either table."""
        _, fixed = self.kept(field, free)
        a = counts_at(self.states[first], self.states)
        b = counts_at(self.beside[second], self.beside)
        known = np.delete(np.arange(self.beside.size), fixed)
        place = int(np.flatnonzero(second == fixed)[0])
        moved = np.delete(np.arange(second.size), place)
        basis = np.zeros((len(free), first.size + moved.size))
        basis[: self.states.size, : first.size] = a
        basis[self.states.size :, first.size :] = b[np.ix_(known, moved)]
        still = b[known, place] * self.shares[fixed]

        def law(y: Floats) -> Physics:
            shares = np.insert(y[first.size :], place, self.shares[fixed])
            return product(field, self.states[first], y[: first.size], self.beside[second], shares)

        return Fewer(basis, np.concatenate([np.zeros(self.states.size), still]), law)

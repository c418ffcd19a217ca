"""A force of no formula that is a law of one state times one of another, two tables.

    f = f(a) g(b)

a and b are two of position, velocity, command and time as in `free_force.py`; f has the force
[N m | N] and g is a number that it is taken times, each a smooth curve through the points of its
table, the one of `free_law.py`, at its ends beyond them. A friction that a position shapes is one,
a motor whose torque falls with speed, a drag that wears off: a grid of as many points along either
state has their product in numbers where this has their sum.

    [[physics]]
    effect = "free_product"
    at = "m1"
    over = ["velocity", "position"]
    first = [[-2.0, 0.1], [0.0, 0.0], [2.0, -0.1]]    # velocity, force
    second = [[0.0, 1.0], [0.5, 1.4], [1.0, 1.0]]     # position, times

Limits: as `free_law.py`, `POINTS` points a table. Only the product is a force: twice the first
table and half the second are the same.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Effect, Parameter
from zwidth.sim.physics.free_force import (
    OVER,
    check_states,
    counts_at,
    curve,
    over_parameters,
    over_values,
    state_of,
    states_over,
)
from zwidth.sim.physics.free_law import check_points, numbered, points_of, row_values
from zwidth.sim.place import LINKS, MASSES

Floats = NDArray[np.float64]
Points = tuple[tuple[float, float], ...]
POINTS = 32
AT_FIRST = tuple(f"first_at_{i + 1}" for i in range(POINTS))
FORCE_FIRST = tuple(f"first_{i + 1}" for i in range(POINTS))
AT_SECOND = tuple(f"second_at_{i + 1}" for i in range(POINTS))
SHARE_SECOND = tuple(f"second_{i + 1}" for i in range(POINTS))
TABLES = {"first": (AT_FIRST, FORCE_FIRST), "second": (AT_SECOND, SHARE_SECOND)}
FIRST, SECOND = len(OVER), len(OVER) + 2 * POINTS  # where the tables begin


class Product(NamedTuple):
    """A product as people write it: its two states, and the table of each, rows of (state, law)."""

    over: tuple[str, str]
    first: Points
    second: Points


free_product = Effect(
    name="free_product",
    summary="a force over one state times a number over another, as two tables",
    formula="f = f(a) g(b), smooth curves through the points of both tables",
    places=(*MASSES, *LINKS),
    parameters=(
        *over_parameters("first", "second", alone=False),
        *numbered(AT_FIRST, "s_f", "", "state of first at point"),
        *numbered(FORCE_FIRST, "f", "N m", "first at point", magnitude=True),
        *numbered(AT_SECOND, "s_g", "", "state of second at point"),
        *numbered(SHARE_SECOND, "g", "", "second at point"),
    ),
    hook="force",
    code=20,
    reference="tables of what was measured; Catmull & Rom, Computer Aided Geometric Design, 1974",
    sought="learned",
)


def product_values(
    over: Sequence[str],
    first: Sequence[Sequence[float]],
    second: Sequence[Sequence[float]],
) -> dict[str, float]:
    """Return the parameters of a product; over: two names among `STATES`.

    first, second: rows (state, law) whose states rise, two to `POINTS` of them. Raises ValueError
    with one sentence for anything else.
    """
    check_states(tuple(over), (2,))
    found = over_values(over)
    for (name, (states, laws)), table in zip(TABLES.items(), (first, second), strict=True):
        for row in table:
            if len(row) != 2:
                raise ValueError(
                    f"{name} has a row of {len(row)} numbers; a row is a state and a law"
                )
        points = [(float(s), float(f)) for s, f in table]
        check_points(name, points, POINTS)
        found |= row_values(states, [s for s, _ in points]) | row_values(
            laws, [f for _, f in points]
        )
    return found


def product_of(values: Mapping[str, float]) -> Product:
    """Return a product by its parameters: what `product_values` was given."""
    first, second = (
        tuple((float(s), float(f)) for s, f in points_of(values, states, laws))
        for states, laws in TABLES.values()
    )
    a, b = states_over(values)
    return Product((a, b), first, second)


def is_product(parameters: Sequence[Parameter]) -> bool:
    """Whether an effect is a law of this kind."""
    return any(p.name == AT_FIRST[0] for p in parameters)


def held(shares: Sequence[float]) -> int:
    """Return which number of a second table is held where others vary: the largest."""
    return int(np.argmax(np.abs(shares)))


def product_at(product: Product, first: ArrayLike, second: ArrayLike) -> Floats:
    """Return the force [N m | N] at states of a product, which broadcast together."""
    return np.asarray(factor_at(product.first, first) * factor_at(product.second, second))


def factor_at(table: Points, states: ArrayLike) -> Floats:
    """Return one of a product's laws at states (...)."""
    at, laws = np.array(table).T
    return np.asarray(counts_at(at, states) @ laws)


@part
def product_law(q, v, u, t, p):
    """The force at position q, velocity v, under the held command u, at time t."""
    first, second = state_of(p[0], q, v, u, t), state_of(p[1], q, v, u, t)
    force = curve(first, p, FIRST, FIRST + POINTS, POINTS)
    return force * curve(second, p, SECOND, SECOND + POINTS, POINTS)

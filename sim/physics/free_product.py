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

import itertools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zwidth.sim.jit import part
from zwidth.sim.lane_type import greatest, least, select
from zwidth.sim.physics.effect import Effect, Parameter
from zwidth.sim.physics.free_force import OVER, STATES, check_states, counts_at, state_of
from zwidth.sim.physics.free_law import tangent_at_end, tangent_inside
from zwidth.sim.place import LINKS, MASSES

Floats = NDArray[np.float64]
Points = tuple[tuple[float, float], ...]
POINTS = 16
AT_FIRST = tuple(f"first_at_{i + 1}" for i in range(POINTS))
FORCE_FIRST = tuple(f"first_{i + 1}" for i in range(POINTS))
AT_SECOND = tuple(f"second_at_{i + 1}" for i in range(POINTS))
SHARE_SECOND = tuple(f"second_{i + 1}" for i in range(POINTS))
FIRST, SECOND = len(OVER), len(OVER) + 2 * POINTS  # where the tables begin


class Product(NamedTuple):
    """A product as people write it: its two states, and the table of each, rows of (state, law)."""

    over: tuple[str, str]
    first: Points
    second: Points


def _parameters() -> tuple[Parameter, ...]:
    codes = ", ".join(f"{i + 1} {name}" for i, name in enumerate(STATES))
    last = len(STATES)
    found = [
        Parameter("over_1", "a", "", 1.0, last, None, meaning=f"state of the first: {codes}"),
        Parameter("over_2", "b", "", 1.0, last, None, meaning=f"state of the second: {codes}"),
    ]
    for letter, unit, states, laws in (
        ("f", "N m", AT_FIRST, FORCE_FIRST),
        ("g", "", AT_SECOND, SHARE_SECOND),
    ):
        found += [
            Parameter(
                name,
                f"s_{letter}{i + 1}",
                "",
                -1e9,
                1e9,
                None,
                meaning=f"state of {letter}_{i + 1}",
            )
            for i, name in enumerate(states)
        ]
        found += [
            Parameter(
                name, f"{letter}_{i + 1}", unit, -1e9, 1e9, 0.0 if letter == "f" else None,
                role="magnitude" if letter == "f" else "shape",
                meaning=f"{letter} at point {i + 1}",
            )
            for i, name in enumerate(laws)
        ]  # fmt: skip
    return tuple(found)


free_product = Effect(
    name="free_product",
    summary="a force over one state times a number over another, as two tables",
    formula="f = f(a) g(b), smooth curves through the points of both tables",
    places=(*MASSES, *LINKS),
    parameters=_parameters(),
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
    over = tuple(over)
    check_states(over)
    if len(over) != 2:
        raise ValueError(f"over is {list(over)}; name the two states of first and second")
    found = {name: float(STATES.index(s) + 1) for name, s in zip(OVER, over, strict=True)}
    for name, table, states, laws in (
        ("first", first, AT_FIRST, FORCE_FIRST),
        ("second", second, AT_SECOND, SHARE_SECOND),
    ):
        if not 2 <= len(table) <= POINTS:
            raise ValueError(f"{name} has {len(table)} points; allowed is 2 to {POINTS}")
        rows = [tuple(float(v) for v in row) for row in table]
        for row in rows:
            if len(row) != 2:
                raise ValueError(
                    f"{name} has a row of {len(row)} numbers; a row is a state and a law"
                )
        for (before, _), (after, _) in itertools.pairwise(rows):
            if not after > before:
                raise ValueError(
                    f"{name} has the state {after:g} after {before:g}; states must rise from row to"
                    " row"
                )
        rows += [rows[-1]] * (POINTS - len(rows))
        found |= dict(zip(states, (s for s, _ in rows), strict=True))
        found |= dict(zip(laws, (f for _, f in rows), strict=True))
    return found


def product_of(values: Mapping[str, float]) -> Product:
    """Return a product by its parameters: what `product_values` was given."""
    over = tuple(STATES[round(float(values[name])) - 1] for name in OVER)
    tables: list[Points] = []
    for states, laws in ((AT_FIRST, FORCE_FIRST), (AT_SECOND, SHARE_SECOND)):
        rows = [(float(values[states[0]]), float(values[laws[0]]))]
        for s, f in zip(states[1:], laws[1:], strict=True):
            if values[s] > rows[-1][0]:
                rows.append((float(values[s]), float(values[f])))
        tables.append(tuple(rows))
    return Product((over[0], over[1]), tables[0], tables[1])


def is_product(parameters: Sequence[Parameter]) -> bool:
    """Whether an effect is a law of this kind."""
    return any(p.name == AT_FIRST[0] for p in parameters)


def product_at(product: Product, first: ArrayLike, second: ArrayLike) -> Floats:
    """Return the force [N m | N] at states of a product, which broadcast together."""
    found = np.ones(np.broadcast_shapes(np.shape(first), np.shape(second)))
    for table, states in ((product.first, first), (product.second, second)):
        at, laws = np.array(table).T
        found = found * (counts_at(at, states) @ laws)
    return found


@part
def product_law(q, v, u, t, p):
    """The force at position q, velocity v, under the held command u, at time t."""
    return _curve(state_of(p[0], q, v, u, t), p, FIRST) * _curve(
        state_of(p[1], q, v, u, t), p, SECOND
    )


@part
def _curve(s, p, k):
    """The curve at s through the points whose states stand from p[k] on, their laws after them.

    As `free_law.table_law`: a sum over intervals, each nothing before it and all of it after.
    """
    total = p[k + POINTS] + 0.0 * s
    width, slope = _interval(p, k, 0)
    before, slope_before = 0.0 * width, 0.0 * slope
    for j in range(POINTS - 1):
        after, slope_after = _interval(p, k, j + 1)
        left = select(
            before > 0.0, tangent_inside(before, slope_before, width, slope),
            tangent_at_end(width, slope, after, slope_after),
        )  # fmt: skip
        right = select(
            after > 0.0, tangent_inside(width, slope, after, slope_after),
            tangent_at_end(width, slope, before, slope_before),
        )  # fmt: skip
        t = least(greatest((s - p[k + j]) / select(width > 0.0, width, 1.0), 0.0), 1.0)
        rest = 1.0 - t
        bend = slope * t * t * (3.0 - 2.0 * t) + left * t * rest * rest - right * t * t * rest
        total += width * bend
        before, slope_before, width, slope = width, slope, after, slope_after
    return total


@part
def _interval(p, k, j):
    """Width and slope of the interval from point j on; nothing beyond the last."""
    if j == POINTS - 1:
        return 0.0 * p[k], 0.0 * p[k]
    width = p[k + j + 1] - p[k + j]
    there = width > 0.0
    rise = p[k + POINTS + j + 1] - p[k + POINTS + j]
    return select(there, width, 0.0), select(there, rise / select(there, width, 1.0), 0.0)

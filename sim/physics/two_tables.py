"""Common parts of laws with two tables, each over one of two states.

A product multiplies the laws of both tables (`free_product.py`); a shift adds the law of the second
to the state of the first (`free_shift.py`). The states are two of position, velocity, command and
time as in `free_force.py`, and each law is the smooth curve of `free_law.py` through the points of
its table, constant beyond its ends.

Limits: as `free_law.py`; `POINTS` points in a table.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zwidth.sim.physics.effect import Parameter
from zwidth.sim.physics.free_force import (
    OVER,
    check_states,
    counts_at,
    over_parameters,
    over_values,
    states_over,
)
from zwidth.sim.physics.free_law import check_points, numbered, points_of, row_values

Floats = NDArray[np.float64]
Points = tuple[tuple[float, float], ...]
POINTS = 32
AT_FIRST = tuple(f"first_at_{i + 1}" for i in range(POINTS))
LAW_FIRST = tuple(f"first_{i + 1}" for i in range(POINTS))
AT_SECOND = tuple(f"second_at_{i + 1}" for i in range(POINTS))
LAW_SECOND = tuple(f"second_{i + 1}" for i in range(POINTS))
TABLES = {"first": (AT_FIRST, LAW_FIRST), "second": (AT_SECOND, LAW_SECOND)}
FIRST, SECOND = len(OVER), len(OVER) + 2 * POINTS  # indices at which the tables begin


class TwoTables(NamedTuple):
    """Such a law as written in a file: two states, and a table for each, rows (state, law)."""

    over: tuple[str, str]
    first: Points
    second: Points


def two_tables_parameters(symbol: str) -> tuple[Parameter, ...]:
    """Return the parameters of such a law; the second table has a symbol but no unit."""
    return (
        *over_parameters("first", "second", alone=False),
        *numbered(AT_FIRST, "s_f", "", "state of first at point"),
        *numbered(LAW_FIRST, "f", "N m", "first at point", magnitude=True),
        *numbered(AT_SECOND, f"s_{symbol}", "", "state of second at point"),
        *numbered(LAW_SECOND, symbol, "", "second at point"),
    )


def two_tables_values(
    over: Sequence[str],
    first: Sequence[Sequence[float]],
    second: Sequence[Sequence[float]],
) -> dict[str, float]:
    """Return the parameters of such a law; over: two names among `STATES`.

    first, second: rows (state, law) whose states rise, two to `POINTS` of them. Raises ValueError
    with one sentence for anything else.
    """
    check_states(tuple(over), (2,))
    found = over_values(over)
    for (name, (states, laws)), table in zip(TABLES.items(), (first, second), strict=True):
        for row in table:
            if len(row) != 2:
                raise ValueError(
                    f"{name} has a row of {len(row)} numbers; a row is a state and its value"
                )
        points = [(float(s), float(f)) for s, f in table]
        check_points(name, points, POINTS)
        found |= row_values(states, [s for s, _ in points]) | row_values(
            laws, [f for _, f in points]
        )
    return found


def two_tables_of(values: Mapping[str, float]) -> TwoTables:
    """Return such a law from its parameters: the inverse of `two_tables_values`."""
    first, second = (
        tuple((float(s), float(f)) for s, f in points_of(values, states, laws))
        for states, laws in TABLES.values()
    )
    a, b = states_over(values)
    return TwoTables((a, b), first, second)


def is_two_tables(parameters: Sequence[Parameter]) -> bool:
    """Whether an effect is a law of this kind."""
    return any(p.name == AT_FIRST[0] for p in parameters)


def table_at(table: Points, states: ArrayLike) -> Floats:
    """Return one of its laws at states (...)."""
    at, laws = np.array(table).T
    return np.asarray(counts_at(at, states) @ laws)

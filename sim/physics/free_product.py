"""A force without a formula: a law of one state times a factor that depends on another.

    f = f(a) g(b)

a and b are two of position, velocity, command and time as in `free_force.py`; f is the force [N m |
N] and g a factor, each a table of `two_tables.py`. Examples are a friction that varies with
position, a motor whose torque falls with speed, a drag that wears off. A grid with as many points
along either state needs the product of the two numbers of points, this law only their sum.

    [[physics]]
    effect = "free_product"
    at = "m1"
    over = ["velocity", "position"]
    first = [[-2.0, 0.1], [0.0, 0.0], [2.0, -0.1]]    # velocity, force
    second = [[0.0, 1.0], [0.5, 1.4], [1.0, 1.0]]     # position, times

Limits: only the product is a force: twice the first table and half the second are the same.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Effect
from zwidth.sim.physics.free_force import curve, state_of
from zwidth.sim.physics.two_tables import (
    FIRST,
    POINTS,
    SECOND,
    TwoTables,
    table_at,
    two_tables_parameters,
)
from zwidth.sim.place import LINKS, MASSES

Floats = NDArray[np.float64]

free_product = Effect(
    name="free_product",
    summary="a force that is the product of two tables, each over one state",
    formula="f = f(a) g(b), smooth curves through the points of both tables",
    places=(*MASSES, *LINKS),
    parameters=two_tables_parameters("g"),
    hook="force",
    code=20,
    reference="tables of what was measured; Catmull & Rom, Computer Aided Geometric Design, 1974",
    sought="learned",
)


def held(shares: Sequence[float]) -> int:
    """Return the index of the second table's number that a fit keeps constant: the largest one."""
    return int(np.argmax(np.abs(shares)))


def product_at(product: TwoTables, first: ArrayLike, second: ArrayLike) -> Floats:
    """Return the force [N m | N] at states of a product, which broadcast together."""
    return np.asarray(table_at(product.first, first) * table_at(product.second, second))


@part
def product_law(q, v, u, t, p):
    """The force at position q, velocity v, under the held command u, at time t."""
    first, second = state_of(p[0], q, v, u, t), state_of(p[1], q, v, u, t)
    force = curve(first, p, FIRST, FIRST + POINTS, POINTS)
    return force * curve(second, p, SECOND, SECOND + POINTS, POINTS)

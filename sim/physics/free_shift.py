"""A force without a formula: a law of one state, shifted by a law of another.

    f = f(a + g(b))

a and b are two of position, velocity, command and time as in `free_force.py`; f is the force [N m |
N] over a + g, and g the shift, in the unit of a, each a table of `two_tables.py`. Examples are a
detent whose place moves with the load because its mount yields, a ripple whose phase follows the
current, and friction about a speed that the command sets. A grid has to follow the shift in steps
of its rows, and a product cannot describe it at all.

    [[physics]]
    effect = "free_shift"
    at = "m1"
    over = ["position", "command"]
    first = [[0.0, 0.0], [0.05, 0.4], [0.1, 0.0], [0.15, -0.4], [0.2, 0.0]]  # position, force
    second = [[-1.0, -0.01], [0.0, 0.0], [1.0, 0.02]]                        # command, shift

Limits: shifting all of the first table's states one way and all of the second table's laws the
other way gives the same law.
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

free_shift = Effect(
    name="free_shift",
    summary="a force that depends on one state and is shifted by another; two tables",
    formula="f = f(a + g(b)), smooth curves through the points of both tables",
    places=(*MASSES, *LINKS),
    parameters=two_tables_parameters("g"),
    hook="force",
    code=21,
    reference="tables of what was measured; Catmull & Rom, Computer Aided Geometric Design, 1974",
    sought="learned",
)


def unshifted(shifts: Sequence[float]) -> int:
    """Return which number of a second table is held where others vary: the one in the middle."""
    return int(np.argsort(shifts)[len(shifts) // 2])


def shifted_at(law: TwoTables, first: ArrayLike, second: ArrayLike) -> Floats:
    """Return the force [N m | N] at states of a shift, which broadcast together."""
    return table_at(law.first, np.asarray(first) + table_at(law.second, second))


@part
def shifted_law(q, v, u, t, p):
    """The force at position q, velocity v, under the held command u, at time t."""
    first, second = state_of(p[0], q, v, u, t), state_of(p[1], q, v, u, t)
    along = first + curve(second, p, SECOND, SECOND + POINTS, POINTS)
    return curve(along, p, FIRST, FIRST + POINTS, POINTS)

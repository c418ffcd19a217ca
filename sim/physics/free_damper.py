"""A force, given by a table, that depends on velocity, or on the rate of a link's deflection.

    f = f(v),    a table with a smooth curve through it (`free_law.py`).

v is the velocity of a mass or, in a link, v_i - v_j; f acts on the first mass, and with the
opposite sign on the second. A falling table brakes. It cannot hold a mass: it is not dry friction.
"""

from zwidth.sim.physics.effect import Effect
from zwidth.sim.physics.free_law import table_parameters
from zwidth.sim.place import LINKS, MASSES

free_damper = Effect(
    name="free_damper",
    summary="a force that depends on velocity, or on the rate of a link's deflection, as a table",
    formula="f = f(v), a smooth curve through the points of the table",
    places=(*MASSES, *LINKS),
    parameters=table_parameters("rad/s", "N m"),
    hook="force",
    code=15,
    reference="a table of what was measured; Catmull & Rom, Computer Aided Geometric Design, 1974",
    sought="learned",
)

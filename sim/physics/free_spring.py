"""A force, given by a table, that depends on position, or on the deflection of a link.

    f = f(q),    a table with a smooth curve through it (`free_law.py`).

q is the position of a mass or, in a link, q_i - q_j; f acts on the first mass, and with the
opposite sign on the second. A spring that pulls back has a falling table.
"""

from zwidth.sim.physics.effect import Effect
from zwidth.sim.physics.free_law import table_parameters
from zwidth.sim.place import LINKS, MASSES

free_spring = Effect(
    name="free_spring",
    summary="a force that depends on position, or on the deflection of a link, as a table",
    formula="f = f(q), a smooth curve through the points of the table",
    places=(*MASSES, *LINKS),
    parameters=table_parameters("rad", "N m"),
    hook="force",
    code=14,
    reference="a table of what was measured; Catmull & Rom, Computer Aided Geometric Design, 1974",
    sought="learned",
)

"""A sensor's error without a formula: the reading is q + f(q), a table (`free_law.py`).

As a calibration against a better sensor gives it.
"""

from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Effect
from zwidth.sim.physics.free_law import table_law, table_parameters

free_sensor = Effect(
    name="free_sensor",
    summary="the error of a reading, which depends on the position, as a table",
    formula="reading = q + f(q), a smooth curve through the points of the table",
    places=("sensor",),
    parameters=table_parameters("rad", "rad"),
    hook="sensor",
    code=3,
    reference="a table of what was measured; Catmull & Rom, Computer Aided Geometric Design, 1974",
    sought="learned",
)


@part
def read_freely(position, p):
    """Return the reading of a position."""
    return position + table_law(position, p)

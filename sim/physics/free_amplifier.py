"""An amplifier's law without a formula: u + f(u), a table (`free_law.py`).

The table has the values that are added to the command, so one of zeros changes nothing.
"""

from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Effect
from zwidth.sim.physics.free_law import table_law, table_parameters

free_amplifier = Effect(
    name="free_amplifier",
    summary="what is added to the command, over the command, as a table",
    formula="force = u + f(u), a smooth curve through the points of the table",
    places=("command",),
    parameters=table_parameters("N m", "N m"),
    hook="command",
    code=3,
    reference="a table of what was measured; Catmull & Rom, Computer Aided Geometric Design, 1974",
    sought="learned",
)


@part
def amplified_freely(command, p):
    """Command as it is passed on."""
    return command + table_law(command, p)

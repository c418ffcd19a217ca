"""The recorded state of the drive besides the command: when it was on, its supply.

    [enable]                    # channel `enable`: on where it is at least a half
    signal = "torque_enable"
    [supply]                    # channel `supply`: the voltage over its nominal one
    signal = "input_volts"
    unit = "V"
    nominal = 12.0              # [V]: voltage at which the device file's numbers hold

The force of a drive is multiplied by its supply over the nominal one, and is zero while it is off.
Both are states, held between their samples like a command, and act at once, without the delay of a
command.
"""

import math

from zwidth.sim.table import Table, TableError

ENABLE, SUPPLY = "enable", "supply"
STATES = (ENABLE, SUPPLY)


def nominal_of(table: Table) -> float:
    """Return the nominal voltage [V] of [supply]; raises TableError."""
    value = table.number("nominal")
    if not 0.0 < value < math.inf:
        raise TableError(f"supply.nominal is {value:g}; it must be a finite voltage above 0 [V]")
    return value

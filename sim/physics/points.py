"""Common parts of laws without a formula: a table, a grid, and a product of tables."""

from collections.abc import Sequence

from zwidth.sim.physics.effect import Parameter, Physics
from zwidth.sim.physics.free_force import is_grid, states_over
from zwidth.sim.physics.free_law import is_table
from zwidth.sim.physics.two_tables import is_two_tables


def of_points(parameters: Sequence[Parameter]) -> bool:
    """Whether an effect is a law given by points, whose states must rise."""
    return is_table(parameters) or is_over(parameters)


def is_over(parameters: Sequence[Parameter]) -> bool:
    """Whether an effect is a law that names its states (also time): a grid or a product."""
    return is_grid(parameters) or is_two_tables(parameters)


def named_states(physics: Physics) -> tuple[str, ...]:
    """Return the states that a grid or a product names; () for all other effects."""
    return states_over(physics.values) if is_over(physics.effect.parameters) else ()

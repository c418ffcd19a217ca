"""What laws of free shape have in common: the same bits in lanes and in C as in a run alone."""

from collections.abc import Callable
from dataclasses import replace

import pytest
from c_examples import assert_same_bits, needs_compiler
from free_law_examples import (
    ALL_STATES,
    GRID_STATES,
    drawn,
    grid_over,
    product_over,
    shift_over,
    shifted,
    times,
)
from lane_examples import assert_equal_runs

from zwidth.export.c_source import c_source
from zwidth.export.settable import may_be_set
from zwidth.sim.device import Device
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.two_tables import POINTS

OVER: dict[str, Callable[..., Device]] = {
    "free_force": grid_over, "free_product": product_over, "free_shift": shift_over,
}  # fmt: skip
LAWS = [
    *(("free_force", states) for states in GRID_STATES),
    *((name, states) for name in ("free_product", "free_shift") for states in ALL_STATES),
]
named = pytest.mark.parametrize(
    ("name", "states"), LAWS, ids=[f"{name}-{'-'.join(states)}" for name, states in LAWS]
)


def other(name: str, at: str) -> Physics:
    """Return a law of the kind at a place, over other states and of another size."""
    points = drawn(3, 3, 0.3, 2e-3)
    match name:
        case "free_force":
            return replace(grid_over(("velocity", "time")).physics[0], at=at)
        case "free_product":
            return times(("velocity", "time"), points, drawn(POINTS, 4, 0.1), at)
        case _:
            return shifted(("velocity", "time"), points, drawn(POINTS, 4, 0.1, 0.1), at)


@named
def test_in_lanes_it_is_that_of_a_run_alone(name: str, states: tuple[str, ...]) -> None:
    """Members of other states and sizes, under walls, to the bit.

    Mutations: `any_lane` in place of `select` between a law over one state and one over two;
    `curve` of the first member's points for all.
    """
    device = OVER[name](states)
    mixed = replace(device, physics=(other(name, device.physics[0].at),))
    assert_equal_runs([device, mixed] * 11, 2, range(0, 21, 4))


@needs_compiler
@named
def test_in_c_it_has_the_bits_of_the_simulation(name: str, states: tuple[str, ...]) -> None:
    """With a delay inside the tick. Mutation: the time of a tick for both of its segments."""
    device = OVER[name](states).with_interface(delay=4e-4)
    made = c_source(device, "dev", seed=3)
    assert made.lost == ()
    assert_same_bits(device, made)
    assert ("= s->tick;" in made.text()) == ("time" in states)
    assert may_be_set(device) == []

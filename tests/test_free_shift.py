"""A force over one state that another shifts along it: closed forms, an integrator, ways out."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from engine_examples import phantom
from numpy.typing import NDArray
from test_export_c import COMMANDS, assert_same_bits, needs_compiler
from test_export_modelica import finely, needs_translator
from test_export_modelica import run as run_as_modelica
from test_free_force import COMMAND, errors, integrated, mass
from test_free_product import ALL_STATES, drawn
from test_lanes import assert_equal_runs

from zwidth.diagnosis.laws.forms import Shape, ShiftForm, Site
from zwidth.export.c_source import c_source
from zwidth.export.model import loss
from zwidth.fleet.structure import known_structure
from zwidth.sim.device import Device
from zwidth.sim.device_file import commented_text, device_from_text, device_to_text
from zwidth.sim.jit import jit
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_force import STATES
from zwidth.sim.physics.free_law import table_law, table_values
from zwidth.sim.physics.free_shift import shifted_at, shifted_law
from zwidth.sim.physics.two_tables import (
    LAW_FIRST,
    LAW_SECOND,
    POINTS,
    table_at,
    two_tables_of,
    two_tables_values,
)
from zwidth.views.device import in_points

Floats = NDArray[np.float64]


@jit
def _law(q: Any, v: Any, u: Any, t: Any, p: Any, found: Any) -> None:
    for i in range(q.size):
        found[i] = shifted_law(q[i], v[i], u[i], t[i], p)


def law(values: dict[str, float], *states: Floats) -> Floats:
    """Return the kernel's force at positions, velocities, commands and times."""
    found = np.zeros(states[0].size)
    q, v, u, t = states
    _law(q, v, u, t, np.array(list(values.values())), found)
    return found


def shifted(over: tuple[str, str], first: Any, second: Any, at: str = "m1") -> Physics:
    return make_physics("free_shift", at, **two_tables_values(over, first, second))


@pytest.mark.parametrize(("first", "second"), [(2, 2), (3, POINTS), (POINTS, POINTS)])
@pytest.mark.parametrize("over", [("position", "velocity"), ("time", "command")])
def test_it_is_one_table_at_what_the_other_adds(
    first: int, second: int, over: tuple[str, str]
) -> None:
    """Mutations that break it: the shift taken off; the states exchanged; one curve for both."""
    f, g = drawn(first, 1), drawn(second, 2)
    states = np.random.default_rng(6).normal(0.0, 2.0, (4, 200))
    a, b = (states[STATES.index(name)] for name in over)
    of_a, of_b = (np.array(list(table_values(points).values())) for points in (f, g))
    expected = [
        float(table_law(x + float(table_law(y, of_b)), of_a))
        for x, y in zip(a.tolist(), b.tolist(), strict=True)
    ]
    values = two_tables_values(over, f, g)
    np.testing.assert_allclose(law(values, *states), expected, rtol=1e-9, atol=1e-9)
    found = shifted_at(two_tables_of(values), a, b)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_it_goes_through_a_device_file_and_is_said() -> None:
    """Mutation: said as a product."""
    physics = shifted(("position", "time"), drawn(3, 5), drawn(4, 6))
    device = phantom().with_physics(physics)
    for text in (device_to_text(device), commented_text(device)):
        assert device_from_text(text) == device
    text = commented_text(phantom().with_physics(physics))
    assert "second = [  # rows of [s] time, [rad] what is added to the position" in text
    assert in_points(physics) == "3 points over position shifted by 4 over time"


def test_a_spring_whose_other_end_a_command_moves() -> None:
    """-15 (q + u / 2), against scipy; second order in the substep.

    Mutation: the shift that of the substep before.
    """
    physics = shifted(
        ("position", "command"), [(-9.0, 135.0), (9.0, -135.0)], [(-9.0, -4.5), (9.0, 4.5)]
    )
    truth = integrated(lambda q, v, u, t: -15.0 * (q + 0.5 * u), COMMAND)
    coarse, _, fine = errors(mass(physics), truth, COMMAND, (1, 2, 4))
    assert coarse < 1e-3
    assert coarse / fine > 12.0


def test_a_fleet_frees_its_numbers_but_one() -> None:
    """The shift in the middle is held. Mutation: all of the second table free."""
    physics = shifted(("velocity", "position"), [(-1.0, 2.0), (1.0, -1.0)],
                      [(0.0, -0.1), (0.5, 0.2), (1.0, 0.1)])  # fmt: skip
    (scales,) = known_structure(mass(physics)).scales
    assert set(scales) == {*LAW_FIRST[:2], LAW_SECOND[0], LAW_SECOND[1]}


def over(states: tuple[str, str]) -> Device:
    """Return the PHANToM with a shift over two states, drawn, in its first link or at m1."""
    size = {"position": 0.01, "velocity": 0.3, "command": 0.05, "time": 0.1}
    a, b = (size[state] for state in states)
    at = "m1" if "position" in states else "link12"
    return phantom().with_physics(
        shifted(states, drawn(5, 1, a, 2e-3), drawn(4, 2, b, 0.3 * a), at)
    )


@pytest.mark.parametrize("states", ALL_STATES, ids="-".join)
def test_in_lanes_it_is_that_of_a_run_alone(states: tuple[str, str]) -> None:
    """Members of other states and sizes, under walls, to the bit."""
    at = over(states).physics[0].at
    other = shifted(("velocity", "time"), drawn(3, 3, 0.3, 2e-3), drawn(POINTS, 4, 0.1, 0.1), at)
    assert_equal_runs([over(states), replace(over(states), physics=(other,))] * 11, 2,
                      range(0, 21, 4))  # fmt: skip


@needs_compiler
@pytest.mark.parametrize("states", ALL_STATES, ids="-".join)
def test_in_c_it_has_the_bits_of_the_simulation(states: tuple[str, str]) -> None:
    device = over(states).with_interface(delay=4e-4)
    made = c_source(device, "dev", seed=3)
    assert made.lost == ()
    assert_same_bits(device, made)


@needs_translator
@pytest.mark.parametrize("states", ALL_STATES, ids="-".join)
def test_in_modelica_it_moves_alike(states: tuple[str, str]) -> None:
    """Within 1 % of what it does. Mutation: the second table's law left out."""
    device = over(states)
    ours, bare = finely(device, 64), finely(replace(device, physics=()), 1)
    assert loss(ours, run_as_modelica(device, COMMANDS)) < 0.01 * loss(ours, bare)


def seen(floats: bool = False) -> Site:
    states = np.random.default_rng(1).normal(size=(500, 2))
    return Site("free_shift", "m1", ("position", "velocity"), states, floats=floats)


@pytest.mark.parametrize("order", [("position", "velocity"), ("velocity", "position")])
def test_the_slopes_of_its_numbers_are_differences(order: tuple[str, str]) -> None:
    """Mutation that breaks it: the slope of the first table at its unshifted state."""
    s = np.linspace(-2.0, 2.0, 9)
    physics = shifted(order, np.column_stack([s, np.sin(s)]).tolist(),
                      np.column_stack([s, 0.2 * s**2]).tolist())  # fmt: skip
    form, h = ShiftForm(physics), 1e-6
    a, b = np.random.default_rng(2).normal(size=(2, 20))
    slopes = form.slopes(a, b)
    for k, name in enumerate(form.names):
        more, less = (
            ShiftForm(make_physics("free_shift", "m1", **{**physics.values, name: value})).at(a, b)
            for value in (physics.values[name] + h, physics.values[name] - h)
        )
        np.testing.assert_allclose(slopes[:, k], (more - less) / (2.0 * h), atol=1e-6)


@pytest.mark.parametrize("order", [("position", "velocity"), ("velocity", "position")])
def test_from_where_states_are_counted_changes_nothing(order: tuple[str, str]) -> None:
    """Centred, it is the same, with no shift at rest; moved, what it is at another origin.

    Mutation that breaks it: the first table moved the other way.
    """
    s = np.linspace(-2.0, 2.0, 9)
    form = ShiftForm(shifted(order, np.column_stack([s, np.sin(s)]).tolist(),
                           np.column_stack([s, 0.2 * s**2 + 0.3]).tolist()))  # fmt: skip
    a, b = np.random.default_rng(2).uniform(-1.0, 1.0, size=(2, 20))
    centred = ShiftForm(form.centred(seen()))
    np.testing.assert_allclose(centred.at(a, b), form.at(a, b), atol=1e-12)
    assert abs(float(centred.at(np.zeros(1), np.zeros(1))[0]) - np.sin(0.3)) < 2e-3
    moved = form.moved(seen(), 0.1, 0.7)
    assert moved is not None
    there = (a + 0.1, b) if order[0] == "position" else (a, b + 0.1)
    np.testing.assert_allclose(ShiftForm(moved).at(*there), form.at(a, b) + 0.7, atol=1e-12)


@pytest.mark.parametrize("floats", [False, True])
def test_a_law_of_fewer_points_has_the_numbers_that_are_said_of_it(floats: bool) -> None:
    """Its numbers at the points that went are offset + basis y, what is held among what stays."""
    site, s = seen(floats), np.linspace(-2.0, 2.0, 9)
    form = ShiftForm(shifted(("position", "velocity"), np.column_stack([s, np.sin(s)]).tolist(),
                           np.column_stack([s, 0.1 * s]).tolist()))  # fmt: skip
    free = [name for name in form.names if name in form.scales(site)]
    kept = form.kept(site, free)
    assert kept[1] == s[4]
    assert kept[0] == s[4] if floats else np.isnan(kept[0])
    fewer = form.fewer(site, free, Shape((s[::2], s[::2])))
    y = np.random.default_rng(3).normal(size=fewer.basis.shape[1])
    law = ShiftForm(fewer.law(y))
    on = [table_at(table, s) for table in (law.tables.first, law.tables.second)]
    numbers = dict(zip(form.names, np.concatenate(on), strict=True))
    found = fewer.offset + fewer.basis @ y
    np.testing.assert_allclose(found, [numbers[name] for name in free], atol=1e-12)

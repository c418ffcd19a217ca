"""A force over one state times a number over another: closed forms, an integrator, all ways out."""

from typing import Any

import numpy as np
import pytest
from engine_examples import phantom
from free_law_examples import COMMAND, SEEN, T, drawn, errors, free, integrated, mass, times
from numpy.typing import NDArray
from physics_examples import example

from zwidth.controllers.none import none
from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.learning.steady import along
from zwidth.fleet.structure import known_structure
from zwidth.sim.device_file import commented_text, device_from_text, device_to_text
from zwidth.sim.equations import equations
from zwidth.sim.jit import jit
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_force import STATES, force_at, grid_of, grid_values, is_grid
from zwidth.sim.physics.free_law import table_law, table_values
from zwidth.sim.physics.free_product import product_at, product_law
from zwidth.sim.physics.two_tables import (
    LAW_FIRST,
    LAW_SECOND,
    POINTS,
    TwoTables,
    is_two_tables,
    two_tables_of,
    two_tables_values,
)
from zwidth.sim.population import Population, Readings, Recorded
from zwidth.sim.predict import alone
from zwidth.sim.run import Start, simulate, start_memory
from zwidth.views.device import in_points

Floats = NDArray[np.float64]


@jit
def _law(q: Any, v: Any, u: Any, t: Any, p: Any, found: Any) -> None:
    for i in range(q.size):
        found[i] = product_law(q[i], v[i], u[i], t[i], p)


def law(values: dict[str, float], *states: Floats) -> Floats:
    """Return the kernel's force at positions, velocities, commands and times."""
    found = np.zeros(states[0].size)
    q, v, u, t = states
    _law(q, v, u, t, np.array(list(values.values())), found)
    return found


@pytest.mark.parametrize(("first", "second"), [(2, 2), (3, POINTS), (POINTS, POINTS)])
@pytest.mark.parametrize("over", [("position", "velocity"), ("time", "command")])
def test_it_is_the_product_of_two_tables(first: int, second: int, over: tuple[str, str]) -> None:
    """Each that of a table's law, at its ends beyond them.

    Mutations that break it: the states exchanged; the last interval left out; one curve for both.
    """
    f, g = drawn(first, 1), drawn(second, 2)
    states = np.random.default_rng(6).normal(0.0, 2.0, (4, 200))
    a, b = (states[STATES.index(name)] for name in over)
    tables = [np.array(list(table_values(points).values())) for points in (f, g)]
    each = [
        [float(table_law(x, table)) for x in s.tolist()]
        for s, table in zip((a, b), tables, strict=True)
    ]
    values = two_tables_values(over, f, g)
    expected = np.prod(each, axis=0)
    np.testing.assert_allclose(law(values, *states), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(
        product_at(two_tables_of(values), a, b), expected, rtol=1e-9, atol=1e-9
    )


def test_a_product_of_straight_lines_is_exact() -> None:
    """(1 + 2 q)(3 - v), to rounding, and a grid of their products the same."""
    r, c = np.linspace(-1.0, 0.8, 6), np.linspace(-0.8, 1.0, 7) ** 3
    first, second = (list(zip(s, f, strict=True)) for s, f in ((r, 1.0 + 2.0 * r), (c, 3.0 - c)))
    q, v = np.random.default_rng(8).uniform(-0.3, 0.3, (2, 100))
    still = np.zeros(q.size)
    over = ["position", "velocity"]
    found = law(two_tables_values(over, first, second), q, v, still, still)
    np.testing.assert_allclose(found, (1.0 + 2.0 * q) * (3.0 - v), rtol=1e-13)
    grid = grid_of(grid_values(over, r, c, np.outer(1.0 + 2.0 * r, 3.0 - c)))
    np.testing.assert_allclose(found, force_at(grid, q, v), rtol=1e-12)


@pytest.mark.parametrize(("first", "second"), [(2, 5), (POINTS, 2)])
def test_what_was_given_is_read_back(first: int, second: int) -> None:
    """Mutation: a product taken for a grid, since both name their states."""
    f, g = drawn(first, 3), drawn(second, 4)
    physics = times(("velocity", "time"), f, g)
    assert two_tables_of(physics.values) == TwoTables(("velocity", "time"), f, g)
    assert is_two_tables(physics.effect.parameters)
    assert not is_grid(physics.effect.parameters)
    assert not is_two_tables(example("free_force").effect.parameters)
    assert in_points(physics) == f"{first} points over velocity times {second} over time"


@pytest.mark.parametrize(
    "physics",
    [
        times(["position", "time"], drawn(3, 5), drawn(4, 6)),
        times(["command", "velocity"], drawn(POINTS, 7), drawn(POINTS, 8), "link12"),
    ],
)
def test_it_goes_through_a_device_file(physics: Physics) -> None:
    """Commented too. Mutation: the second table written in the place of the first."""
    device = phantom().with_physics(physics)
    for text in (device_to_text(device), commented_text(device)):
        assert device_from_text(text) == device


def test_a_device_file_says_the_units_of_its_states() -> None:
    """Mutation: the unit of the first state for both."""
    physics = times(["velocity", "time"], drawn(2, 1), drawn(3, 2))
    text = commented_text(phantom().with_physics(physics))
    assert "first = [  # rows of [rad/s] velocity, [N m] force" in text
    assert "second = [  # rows of [s] time, what it is taken times" in text


TWO = 'over = ["position", "velocity"]\n'
ONES = "[[0.0, 1.0], [1.0, 1.0]]"


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (f"first = {ONES}\nsecond = {ONES}", "over is missing; add it"),
        (f'over = ["time"]\nfirst = {ONES}\nsecond = {ONES}',
         "over has 1 names; it must have two of position, velocity, command, time"),
        (f'over = ["time", "sped"]\nfirst = {ONES}\nsecond = {ONES}', "over has 'sped'; "),
        (f'over = ["time", "time"]\nfirst = {ONES}\nsecond = {ONES}',
         "over has 'time' twice; give another state for one of them"),
        (f"{TWO}first = {ONES}", "second is missing; add it"),
        (f"{TWO}first = [[0.0, 1.0]]\nsecond = {ONES}",
         "first has 1 points; it must have from 2 to 32"),
        (f"{TWO}first = {ONES}\nsecond = {[[float(i), 1.0] for i in range(33)]}",
         "second has 33 points; it must have from 2 to 32"),
        (f"{TWO}first = {ONES}\nsecond = [[1.0, 1.0], [0.5, 1.0]]",
         "second has the state 0.5 after 1; states must rise from row to row"),
        (f"{TWO}first = [[0.0, 1.0], [1.0]]\nsecond = {ONES}",
         r"first\[1\] is \[1.0\]; it must be a list of 2 numbers"),
        (f"{TWO}first = [[0.0, 1.0], [1.0, 2e9]]\nsecond = {ONES}",
         "free_product.first_2 is 2e.09; it must be from -1e.09 to 1e.09"),
        (f"{TWO}first = {ONES}\nsecond = {ONES}\nrows = [0.0]", "unknown key 'physics.0..rows'"),
    ],
)  # fmt: skip
def test_tables_that_are_none_are_refused(table: str, said: str) -> None:
    head, _, _ = device_to_text(mass()).partition("[[physics]]")
    text = f'{head}\n[[physics]]\neffect = "free_product"\nat = "m1"\n{table}\n'
    with pytest.raises(ValueError, match=said):
        device_from_text(text)


def test_rows_of_three_numbers_are_refused() -> None:
    """From Python, where no reader counts a row first."""
    with pytest.raises(ValueError, match="second has a row of 3 numbers; a row is a state and"):
        two_tables_values(["position", "time"], drawn(2, 1), [(0.0, 1.0, 2.0), (1.0, 1.0, 1.0)])


def test_damping_that_depends_on_where_it_moves() -> None:
    """-v (1 + 8 q), against scipy; second order in the substep.

    Mutation: the velocity that of the beginning in the second look.
    """
    physics = times(
        ["velocity", "position"], [(-9.0, 9.0), (9.0, -9.0)], [(-1.0, -7.0), (1.0, 9.0)]
    )
    truth = integrated(lambda q, v, u, t: -(1.0 + 8.0 * q) * v, COMMAND)
    coarse, _, fine = errors(mass(physics), truth, COMMAND, (1, 2, 4))
    assert coarse < 1e-3
    assert coarse / fine > 12.0


def test_its_work_is_the_energy_that_is_there() -> None:
    """Of a spring that time stiffens, to rounding. Mutation: the ledger without the time."""
    physics = times(["position", "time"], [(-1.0, 15.0), (1.0, -15.0)], drawn(POINTS, 9, 0.1))
    run = simulate(
        mass(physics), none(), duration=0.4, substeps=3, ledger=True, start=Start(0.02, 0.3)
    )
    began = 0.5 * 0.5 * 0.3**2 + 0.5 * 20.0 * 0.02**2
    there = run.trace["stored_energy"][-1]
    taken = {name: run.trace[f"work_{name}"][-1] for name in run.ledger}
    assert abs(taken["free_product_m1"]) > 0.01 * began
    assert there + taken["b1"] + taken["free_product_m1"] == pytest.approx(began, rel=1e-12)


def test_a_part_of_a_recording_knows_its_own_time() -> None:
    """A free run from the middle on goes on as it does, alone and in lanes.

    Mutations: a memory that begins at 0; members that do.
    """
    physics = times(["position", "time"], [(-2.0, 5.0), (2.0, -5.0)], drawn(8, 3, 0.2))
    device, cut, ticks = mass(physics), 37, 100
    run = simulate(device, recorded(COMMAND), duration=ticks * T, start=Start(0.02, 0.3))
    q, v = run.trace["position_m1"], run.trace["velocity_m1"]
    eq, still, blind = equations(device), np.zeros((ticks - cut, 1)), np.zeros((2, 1))

    def on(began: float) -> Floats:
        memory = start_memory(eq, Start(float(q[cut]), float(v[cut])), began=began)
        none_of = np.zeros((0, 1))
        return -alone(eq, eq, SEEN, COMMAND[cut:], still, blind, none_of, memory)[:, 0]

    np.testing.assert_allclose(on(cut * T), q[cut:], rtol=0.0, atol=1e-12)
    assert np.abs(on(0.0) - q[cut:]).max() > 1e-3
    population = Population([device, device], 1, 1)
    begun = population.start(np.full((2, 1), q[cut]), np.full((2, 1), v[cut]), cut * T)
    found = population.follow(
        Recorded(COMMAND[cut:], still, SEEN), begun, Readings(blind), keep=True
    )
    np.testing.assert_array_equal(-found.innovations[:, :, 0], [on(cut * T)] * 2)


@pytest.mark.parametrize("physics", [
    times(["velocity", "position"], [(-1.0, 1.0), (1.0, -1.0)],
          [(0.0, 1.0), (0.05, 1.4), (0.1, 1.0)]),
    times(["velocity", "time"], [(-1.0, 1.0), (1.0, -1.0)], [(0.0, 1.0), (1.0, 1.0)]),
    free(["velocity", "position"], [-1.0, 1.0], [0.0, 0.05, 0.1],
         [[1.0, 1.4, 1.0], [-1.0, -1.4, -1.0]]),
])  # fmt: skip
def test_it_is_no_curve_of_one_state(physics: Physics) -> None:
    """Mutation: looked at beyond the second table alone, at whose ends the force is the same."""
    assert along(physics, "free_damper", np.linspace(-1.0, 1.0, 5)) is None


def test_a_fleet_frees_its_numbers_but_one() -> None:
    """Its axes must rise, and only the product counts. Mutation: all of the second table free."""
    physics = times(["velocity", "position"], [(-1.0, 2.0), (1.0, -1.0)],
                    [(0.0, 1.0), (0.5, 1.5), (1.0, 0.5)])  # fmt: skip
    (scales,) = known_structure(mass(physics)).scales
    assert set(scales) == {*LAW_FIRST[:2], LAW_SECOND[0], LAW_SECOND[2]}

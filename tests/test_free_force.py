"""A force over two states or over time: against interpolation, closed forms and integrators."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from engine_examples import phantom
from free_law_examples import COMMAND, SEEN, Floats, T, drawn_grid, errors, free, integrated, mass
from physics_examples import example
from scipy.interpolate import CubicHermiteSpline

from zwidth.controllers.none import none
from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.noise.predictor import prepared
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_file import commented_text, device_from_text, device_to_text
from zwidth.sim.equations import equations
from zwidth.sim.interface import Interface
from zwidth.sim.jit import jit
from zwidth.sim.kernel import BEGAN
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_force import (
    MOST,
    SIZE,
    STATES,
    Grid,
    counts_at,
    force_at,
    grid_law,
    grid_of,
    grid_values,
    is_grid,
)
from zwidth.sim.physics.free_law import table_law, table_values
from zwidth.sim.population import Population, Readings, Recorded
from zwidth.sim.predict import alone
from zwidth.sim.run import Start, simulate, start_memory


@jit
def _law(q: Any, v: Any, u: Any, t: Any, p: Any, found: Any) -> None:
    for i in range(q.size):
        found[i] = grid_law(q[i], v[i], u[i], t[i], p)


def law(values: dict[str, float], *states: Floats) -> Floats:
    """Return the kernel's force at positions, velocities, commands and times."""
    found = np.zeros(states[0].size)
    q, v, u, t = states
    _law(q, v, u, t, np.array(list(values.values())), found)
    return found


@pytest.mark.parametrize(("rows", "columns"), [(2, 2), (3, 8), (8, 3), (SIZE, SIZE), (5, 1)])
@pytest.mark.parametrize("over", [("position", "velocity"), ("time", "command")])
def test_it_is_the_curve_along_either_axis(rows: int, columns: int, over: tuple[str, str]) -> None:
    """Beside cubics of scipy, first along all rows, then across them; beyond the grid its edges.

    Mutations that break it: an end has the slope of its interval; states of the axes exchanged.
    """
    r, c, f = drawn_grid(rows, columns)
    states = np.random.default_rng(6).normal(0.0, 2.0, (4, 200))
    a, b = (states[STATES.index(name)] for name in over)
    if columns > 1:
        order = 1 if columns == 2 else 2
        along = CubicHermiteSpline(c, f.T, np.gradient(f.T, c, axis=0, edge_order=order))
        each = along(np.clip(b, c[0], c[-1])).T
    else:
        each = np.repeat(f, b.size, axis=1)
    order = 1 if rows == 2 else 2
    across = CubicHermiteSpline(r, each, np.gradient(each, r, axis=0, edge_order=order))
    expected = np.diagonal(across(np.clip(a, r[0], r[-1])))
    values = grid_values(over, r.tolist(), c.tolist(), f)
    np.testing.assert_allclose(law(values, *states), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(force_at(grid_of(values), a, b), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("count", [2, 9, MOST])
def test_over_one_state_it_is_the_law_of_a_table(count: int) -> None:
    """Mutations that break it: the values of a grid's first column; the last interval left out."""
    s, _, f = drawn_grid(count, 1)
    points = list(zip(s.tolist(), f[:, 0].tolist(), strict=True))
    table = np.array(list(table_values(points).values()))
    t = np.random.default_rng(7).normal(0.0, 2.0, 200)
    values = grid_values(["time"], s.tolist(), [], f[:, 0])
    still = np.zeros(t.size)
    expected = [table_law(x, table) for x in t.tolist()]
    np.testing.assert_allclose(law(values, still, still, still, t), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(force_at(grid_of(values), t), expected, rtol=1e-9, atol=1e-9)


def test_products_of_straight_lines_are_exact() -> None:
    """(1 + 2 q)(3 - v) of any grid, to rounding. Mutation: a tangent of an end left out."""
    r, c, _ = drawn_grid(6, 7)
    f = np.outer(1.0 + 2.0 * r, 3.0 - c)
    q, v = np.random.default_rng(8).uniform(-0.3, 0.3, (2, 100))
    still = np.zeros(q.size)
    found = law(grid_values(["position", "velocity"], r, c, f), q, v, still, still)
    np.testing.assert_allclose(found, (1.0 + 2.0 * q) * (3.0 - v), rtol=1e-13)


def test_a_grid_of_rank_one_is_the_product_of_its_curves() -> None:
    r, c, f = drawn_grid(6, 5)
    a, b = f[:, 0], f[0]
    q, v = np.random.default_rng(9).normal(size=(2, 50))
    both = force_at(grid_of(grid_values(["position", "velocity"], r, c, np.outer(a, b))), q, v)
    np.testing.assert_allclose(both, (counts_at(r, q) @ a) * (counts_at(c, v) @ b), rtol=1e-12)


@pytest.mark.parametrize(("rows", "columns"), [(2, 1), (3, 5), (SIZE, SIZE)])
def test_what_was_given_is_read_back(rows: int, columns: int) -> None:
    r, c, f = drawn_grid(rows, columns)
    values = grid_values(("velocity", "time"), r.tolist(), c.tolist(), f)
    grid = grid_of(values)
    assert grid == Grid(
        ("velocity", "time"), tuple(r), tuple(c), tuple(tuple(row) for row in f.tolist())
    )
    assert [[values[name] for name in row] for row in grid.names] == f.tolist()
    physics = make_physics("free_force", "m1", **values)
    assert is_grid(physics.effect.parameters)
    assert not is_grid(example("free_damper").effect.parameters)


@pytest.mark.parametrize(
    "physics",
    [
        free(["position", "time"], *drawn_grid(3, 4)),
        free(["command"], [-1.0, 1.0], [], [2.0, -2.0]),
        free(["time"], np.arange(float(MOST)), [], np.sin(np.arange(float(MOST)))),
        free(["velocity", "command"], [0.0, 1.0], [0.5], [[1.0], [2.0]], "link12"),
    ],
)
def test_it_goes_through_a_device_file(physics: Physics) -> None:
    """Commented too. Mutation: a table of one state written as rows of rows and read as numbers."""
    device = phantom().with_physics(physics)
    for text in (device_to_text(device), commented_text(device)):
        assert device_from_text(text) == device


def test_a_device_file_says_the_units_of_its_states() -> None:
    """Mutation: the unit of the first state for both."""
    text = commented_text(phantom().with_physics(free(["velocity", "time"], *drawn_grid(2, 3))))
    assert "rows = [  # [rad/s] velocity of each" in text
    assert "columns = [  # [s] time of each" in text
    assert "table = [  # [N m] force at each row and column" in text


TWO = 'over = ["position", "velocity"]\n'


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("rows = [0.0, 1.0]\ntable = [0.0, 1.0]", "over is missing; add it"),
        ('over = []\nrows = [0.0, 1.0]\ntable = [0.0]', "over has 0 names; it must have one or"),
        ('over = ["speed"]\nrows = [0.0, 1.0]\ntable = [0.0, 1.0]', "over has 'speed'; "),
        ('over = ["time", "time"]\nrows = [0.0, 1.0]\ncolumns = [0.0, 1.0]\ntable = [[0.0, 1.0],'
         " [0.0, 1.0]]", "over has 'time' twice; give another state"),
        ('over = ["time"]\nrows = [0.0, 1.0]\ncolumns = [0.0, 1.0]\ntable = [0.0, 1.0]',
         "columns has 2 states, but over has only 'time'"),
        ('over = ["time"]\nrows = [0.0]\ntable = [0.0]',
         "rows has 1 values of the time; it must have 2 to 32"),
        (f"{TWO}rows = [0.0, 1.0]\ntable = [[0.0, 1.0]]", "columns is missing; add it"),
        (f"{TWO}rows = [0, 1, 2, 3, 4, 5, 6, 7, 8]\ncolumns = [1.0]\ntable = [[0.0]]",
         "rows has 9 values of the position; it must have 2 to 8"),
        (f"{TWO}rows = [0.0, 0.0]\ncolumns = [0.0, 1.0]\ntable = [[0.0, 1.0], [0.0, 1.0]]",
         "rows has the position 0 after 0; states must rise"),
        (f"{TWO}rows = [0.0, 1.0]\ncolumns = [1.0, 0.0]\ntable = [[0.0, 1.0], [0.0, 1.0]]",
         "columns has the velocity 0 after 1; states must rise"),
        (f"{TWO}rows = [0.0, 1.0]\ncolumns = [0.0, 1.0]\ntable = [[0.0, 1.0]]",
         "table has 1 rows; it needs 2, one for each state listed in `rows`"),
        (f"{TWO}rows = [0.0, 1.0]\ncolumns = [0.0, 1.0]\ntable = [[0.0, 1.0], [0.0]]",
         r"table\[1\] is \[0.0\]; it must be a list of 2 numbers"),
        (f"{TWO}rows = [0.0, 1.0]\ncolumns = [0.0, 1.0]\ntable = [[0.0, 1.0], [0.0, 2e9]]",
         "free_force.force_2_2 is 2e.09; it must be from -1e.09 to 1e.09"),
        (f"{TWO}odd = true", "unknown key 'physics.0..odd'"),
    ],
)  # fmt: skip
def test_a_table_that_is_none_is_refused(table: str, said: str) -> None:
    text = f"""schema = 1
name = "mass"
rotary = false
[chain]
masses = [1.0]
ground_dampers = [0.1]
[interface]
period_s = 0.001
[[physics]]
effect = "free_force"
at = "m1"
{table}
"""
    with pytest.raises(ValueError, match=said):
        device_from_text(text)


def test_forces_beside_the_grid_are_refused() -> None:
    """From Python, where no reader counts a row first."""
    with pytest.raises(
        ValueError, match=r"table\[0\] has 2 forces; it needs 3, one for each state"
    ):
        grid_values(["position", "time"], [0.0, 1.0], [0.0, 1.0, 2.0], np.zeros((2, 2)))
    with pytest.raises(ValueError, match="it needs 1, since `over` lists one state"):
        grid_values(["time"], [0.0, 1.0], [], np.zeros((2, 2)))


def test_damping_that_depends_on_where_it_moves() -> None:
    """-(1 + 8 q) v is a grid of four forces; second order in the substep.

    Mutation: the velocity that of the beginning in the second look.
    """
    ends = [-1.0, 1.0]
    table = [[-(1.0 + 8.0 * q) * v for v in (-9.0, 9.0)] for q in ends]
    device = mass(free(["position", "velocity"], ends, [-9.0, 9.0], table))
    truth = integrated(lambda q, v, u, t: -(1.0 + 8.0 * q) * v, COMMAND)
    coarse, _, fine = errors(device, truth, COMMAND, (1, 2, 4))
    assert coarse < 1e-3
    assert coarse / fine > 12.0


def test_a_spring_that_is_stiffened_over_time() -> None:
    """-k (1 + a cos(w t)) q over the turn that its eight columns are of: parametric excitation.

    Of the surface itself the error falls as the square of the substep; of the cosine it stands for
    that of the columns is left, 1 % of the motion that it changes. Mutations: the time of the
    beginning in the second look, or that of the tick in all substeps: first order.
    """
    k, a, w = 15.0, 0.8, 2.0 * np.pi / 0.4
    times, ends = np.linspace(0.0, 0.4, SIZE), np.array([-1.0, 1.0])
    physics = free(
        ["position", "time"], ends, times, -k * np.outer(ends, 1.0 + a * np.cos(w * times))
    )
    grid = grid_of(physics.values)
    through = CubicHermiteSpline(
        times, grid.values[1], np.gradient(grid.values[1], times, edge_order=2)
    )
    surface = integrated(lambda q, v, u, t: q * float(through(t)), COMMAND)
    errs = errors(mass(physics), surface, COMMAND, (1, 2, 4))
    assert errs[0] / errs[2] > 12.0
    cosine = integrated(lambda q, v, u, t: -k * (1.0 + a * np.cos(w * t)) * q, COMMAND)
    still = integrated(lambda q, v, u, t: -k * q, COMMAND)
    (left,) = errors(mass(physics), cosine, COMMAND, (4,))
    assert left < 0.02 * np.abs(cosine - still).max()


def test_a_force_over_time_alone_and_its_work() -> None:
    """Over 32 points, against scipy; its work is the energy that is there, to rounding.

    Mutations: the force of the tick's beginning held over all of its substeps; the second segment
    of a tick at the time of the first.
    """
    times = np.sort(np.random.default_rng(3).uniform(0.0, 0.4, MOST))
    force = np.random.default_rng(4).normal(size=MOST)
    device = mass(free(["time"], times, [], force), delay=0.4 * T)  # ticks of two segments
    through = CubicHermiteSpline(times, force, np.gradient(force, times, edge_order=2))

    def over_time(q: float, v: float, u: float, t: float) -> float:
        return float(through(np.clip(t, times[0], times[-1])))

    still = np.zeros(100)
    errs = errors(device, integrated(over_time, still), still, (1, 16))
    assert errs[0] / errs[1] > 100.0
    run = simulate(device, none(), duration=0.4, substeps=3, ledger=True)
    there = run.trace["stored_energy"][-1]
    taken = {name: run.trace[f"work_{name}"][-1] for name in run.ledger}
    assert taken["free_force_m1"] < 0.0  # it gives
    assert there + taken["b1"] + taken["free_force_m1"] == pytest.approx(0.0, abs=1e-12 * there)


def test_a_force_over_the_command_is_a_gain() -> None:
    """-u / 5 besides u is four fifths of it, after the delay as well.

    Mutation: the command as it is sent, before it arrives.
    """
    device = mass(free(["command"], [-9.0, 9.0], [], [1.8, -1.8]), delay=2.3 * T)
    weaker = mass(delay=2.3 * T)
    run = simulate(device, recorded(COMMAND), duration=0.4).trace["position_m1"]
    other = simulate(weaker, recorded(0.8 * COMMAND), duration=0.4).trace["position_m1"]
    np.testing.assert_allclose(run, other, rtol=0.0, atol=1e-13)


def test_in_a_link_it_is_over_what_gives_way() -> None:
    """20 N/m and 0.5 N s/m of a link as a grid of four forces. Mutation: over the first mass."""
    whole = Device("two", "", False, make_chain([0.5, 0.3], [0.1, 0.2], 0.0, [50.0], [0.6]),
                   Interface(period=0.002))  # fmt: skip
    part = whole.with_chain(make_chain([0.5, 0.3], [0.1, 0.2], 0.0, [30.0], [0.1]))
    table = [[-20.0 * q - 0.5 * v for v in (-9.0, 9.0)] for q in (-1.0, 1.0)]
    link = free(["position", "velocity"], [-1.0, 1.0], [-9.0, 9.0], table, "link12")
    command = recorded(np.repeat(np.random.default_rng(2).normal(size=20), 20))
    one = simulate(whole, command, duration=0.8, substeps=20).trace
    other = simulate(part.with_physics(link), command, duration=0.8, substeps=20).trace
    for name in ("position_m1", "position_m2"):
        assert np.abs(one[name] - other[name]).max() < 2e-5 * np.abs(one[name]).max()


OVER_TIME = free(["position", "time"], [-2.0, 2.0], np.linspace(0.0, 0.4, SIZE),
                 np.outer([1.0, -1.0], np.sin(np.arange(8.0))))  # fmt: skip


def test_a_part_of_a_recording_knows_its_own_time() -> None:
    """A free run from the middle of a simulation on goes on as it does, alone and in lanes.

    Mutations: a memory that begins at 0; members that do.
    """
    device, cut, ticks = mass(OVER_TIME), 37, 100
    run = simulate(device, recorded(COMMAND), duration=ticks * T, start=Start(0.02, 0.3))
    q, v = run.trace["position_m1"], run.trace["velocity_m1"]
    eq, still = equations(device), np.zeros((ticks - cut, 1))
    blind = np.zeros((2, 1))

    def on(began: float) -> Floats:
        memory = start_memory(eq, Start(float(q[cut]), float(v[cut])), began=began)
        none_of = np.zeros((0, 1))
        return -alone(eq, eq, SEEN, COMMAND[cut:], still, blind, none_of, memory)[:, 0]

    np.testing.assert_allclose(on(cut * T), q[cut:], rtol=0.0, atol=1e-12)
    assert np.abs(on(0.0) - q[cut:]).max() > 1e-3
    population = Population([device, device], 1, 1)
    begun = population.start(np.full((2, 1), q[cut]), np.full((2, 1), v[cut]), cut * T)
    assert all(memory.scalars[BEGAN] == cut * T for memory in begun)
    found = population.follow(
        Recorded(COMMAND[cut:], still, SEEN), begun, Readings(blind), keep=True
    )
    np.testing.assert_array_equal(-found.innovations[:, :, 0], [on(cut * T)] * 2)


def test_an_experiment_hands_its_time_on() -> None:
    """Of a part, of what comes after it, and of a recording that has a gap before it.

    Mutation: `observer_memory` without what the recording has gone on by then.
    """
    from zwidth.diagnosis.noise.predictor import innovations

    device = mass(OVER_TIME)
    run = simulate(device, recorded(COMMAND), duration=0.4, start=Start(0.02, 0.3), substeps=8)
    outputs = (Output("position", 0), Output("velocity", 0))
    measured = np.column_stack([run.trace["position_m1"], run.trace["velocity_m1"]])
    whole = Experiment(T, COMMAND, measured, outputs)
    gain, ready = np.eye(2), prepared(device)
    late = whole.part(40, 100)
    own = innovations(device, late, gain, ready=ready)
    forgetful = innovations(device, replace(late, begins=0.0), gain, ready=ready)
    assert np.abs(own[5:]).max() < 1e-5
    assert np.abs(forgetful[5:]).max() > 5e-4
    after = replace(whole.part(40, 100), before=whole.part(0, 40))
    np.testing.assert_array_equal(
        innovations(device, after, gain, ready=ready),
        innovations(device, whole, gain, ready=ready)[40:],
    )
    gap = replace(whole.part(0, 60), measured=measured[40:], command=COMMAND[40:], begins=40 * T)
    np.testing.assert_array_equal(innovations(device, gap, gain, ready=ready), own)

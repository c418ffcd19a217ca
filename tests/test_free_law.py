"""A law as a table of points: against interpolation, and against laws that it stands for."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline

from zwidth.controllers.recorded import recorded
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_file import device_from_text
from zwidth.sim.interface import Interface
from zwidth.sim.jit import jit
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.free_law import KNOTS, points_of, table_law, table_values
from zwidth.sim.run import Start, simulate

Floats = NDArray[np.float64]
RANDOM = np.random.default_rng(5)


@jit
def _law(states: Any, p: Any, found: Any) -> None:
    for i in range(states.size):
        found[i] = table_law(states[i], p)


def law(
    states: Floats, points: list[tuple[float, float]], odd: bool = False, period: float = 0.0
) -> Floats:
    values = table_values(points, odd, period)
    found = np.zeros(states.size)
    _law(states, np.array(list(values.values())), found)
    return found


@pytest.mark.parametrize("count", [2, 5, KNOTS])
def test_it_is_the_curve_through_its_points_and_stays_at_its_ends(count: int) -> None:
    """Beside cubics of scipy. Mutation that breaks it: an end has the slope of its interval."""
    s = np.sort(RANDOM.normal(size=count))
    f = RANDOM.normal(size=count)
    at = np.concatenate([RANDOM.normal(0.0, 3.0, 200), s])
    points = list(zip(s.tolist(), f.tolist(), strict=True))
    smooth = CubicHermiteSpline(s, f, np.gradient(f, s, edge_order=1 if count == 2 else 2))
    expected = smooth(np.clip(at, s[0], s[-1]))
    np.testing.assert_allclose(law(at, points), expected, rtol=1e-9, atol=1e-9)
    assert points_of(table_values(points)) == points


def _odd(s: Floats, f: Floats) -> Callable[[Floats], Floats]:
    """The curve through the points and what they are turned over."""
    both, heights = np.concatenate([-s[:0:-1], s]), np.concatenate([-f[:0:-1], f])
    smooth = CubicHermiteSpline(both, heights, np.gradient(heights, both, edge_order=2))
    return lambda at: smooth(np.clip(at, both[0], both[-1]))


def test_an_odd_law_is_turned_over() -> None:
    points = [(0.0, 0.0), (1.0, 2.0), (2.0, -1.0)]
    at = np.linspace(-3.0, 3.0, 61)
    s, f = np.array(points).T
    np.testing.assert_allclose(law(at, points, odd=True), _odd(s, f)(at), atol=1e-12)


@pytest.mark.parametrize("count", [2, 3, KNOTS])
def test_a_law_that_repeats_is_the_same_a_turn_on(count: int) -> None:
    """Beside a cubic of scipy over three turns, of which the middle one has no end near it.

    Mutations that break it: no interval that closes the turn; its tangents those of an end.
    """
    s = np.sort(RANDOM.uniform(0.2, 2.0, count))
    f = RANDOM.normal(size=count)
    period, points = 2.1, list(zip(s.tolist(), f.tolist(), strict=True))
    three = np.concatenate([s - period, s, s + period])
    smooth = CubicHermiteSpline(three, np.tile(f, 3), np.gradient(np.tile(f, 3), three))
    at = s[0] + np.linspace(0.0, period, 101)[:-1]
    for turns in (0.0, -7.0, 40.0):
        own = law(at + turns * period, points, period=period)
        np.testing.assert_allclose(own, smooth(at), rtol=1e-9, atol=1e-9)


def test_a_mass_under_a_table_of_its_speed_moves_as_an_integrator_says() -> None:
    """Second order in the substep: the error falls fourfold. Mutation: the law of position."""
    points = [(0.0, 0.0), (0.4, -0.5), (1.5, -0.8), (3.0, -3.0)]
    s, f = np.array(points).T
    device = Device(
        "mass", "", False, make_chain([0.5], [0.1], 20.0), Interface(period=0.004)
    ).with_physics(make_physics("free_damper", "m1", **table_values(points, odd=True)))
    command = np.array([3.0, -2.0, 2.5, 0.0])

    def moves(_: float, x: Floats, u: float) -> list[float]:
        drag = float(_odd(s, f)(x[1]))
        return [x[1], (u - 0.1 * x[1] - 20.0 * x[0] + drag) / 0.5]

    x, truth = np.array([0.02, 0.3]), []
    for u in np.repeat(command, 50):
        truth.append(x[0])
        x = solve_ivp(moves, (0.0, 0.004), x, args=(u,), rtol=1e-10, atol=1e-12).y[:, -1]
    errors = []
    for substeps in (1, 2, 4):
        run = simulate(device, recorded(np.repeat(command, 50)), duration=0.8,
                       start=Start(0.02, 0.3), substeps=substeps)  # fmt: skip
        errors.append(float(np.abs(run.trace["position_m1"] - np.array(truth)).max()))
    assert errors[0] < 2e-4
    assert errors[0] / errors[2] > 8.0


def test_a_table_of_a_spring_is_that_spring() -> None:
    """In a link, against the other mass too: energy books balance as those of the linear spring."""
    linear = Device(
        "two", "", False, make_chain([0.5, 0.3], [0.1, 0.2], 0.0, [50.0], [0.1]),
        Interface(period=0.002),
    )  # fmt: skip
    softer = linear.with_chain(make_chain([0.5, 0.3], [0.1, 0.2], 0.0, [30.0], [0.1]))
    table = make_physics("free_spring", "link12", **table_values([(-5.0, 100.0), (5.0, -100.0)]))
    command = recorded(np.repeat(RANDOM.normal(size=20), 20))
    one = simulate(linear, command, duration=0.8, substeps=20).trace
    other = simulate(softer.with_physics(table), command, duration=0.8, substeps=20).trace
    for name in ("position_m1", "position_m2"):
        assert np.abs(one[name] - other[name]).max() < 2e-5 * np.abs(one[name]).max()


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("table = [[0.0, 0.0]]", "table has 1 points; it must have from 2 to 32"),
        ("table = [[0.0, 0.0], [0.0, 1.0]]", "states must rise"),
        ("table = [[0.1, 0.0], [1.0, 1.0]]\nodd = true", r"must begin at \[0, 0\]"),
        ("table = [[0.0, 0.0], [1.0, 1.0]]\nperiod = 1.0", "less than one period"),
        ("table = [[0.0, 0.0], [1.0, 1.0]]\nperiod = 2.0\nodd = true", "only one of them"),
        ("table = [[0.0, 0.0], [1.0]]", "it must be a list of 2 numbers"),
        ("", "table is missing"),
    ],
)
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
effect = "free_damper"
at = "m1"
{table}
"""
    with pytest.raises(ValueError, match=said):
        device_from_text(text)

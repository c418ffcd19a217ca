"""Laws of free shape over two states, a mass that follows them, and its motion by scipy."""

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from engine_examples import phantom
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from zwidth.controllers.recorded import recorded
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_force import (
    STATES,
    grid_values,
)
from zwidth.sim.physics.two_tables import (
    two_tables_values,
)
from zwidth.sim.predict import GROUND, Outputs
from zwidth.sim.run import Start, simulate

Floats = NDArray[np.float64]
Force = Callable[[float, float, float, float], float]
T = 0.004


def drawn_grid(rows: int, columns: int, seed: int = 5) -> tuple[Floats, Floats, Floats]:
    random = np.random.default_rng(seed)
    return (
        np.sort(random.normal(size=rows)),
        np.sort(random.normal(size=columns)),
        random.normal(size=(rows, columns)),
    )


def free(over: Sequence[str], rows: Any, columns: Any, table: Any, at: str = "m1") -> Physics:
    return make_physics("free_force", at, **grid_values(over, rows, columns, table))


def mass(*physics: Physics, **interface: Any) -> Device:
    chain = make_chain([0.5], [0.1], 20.0)
    return Device("mass", "", False, chain, Interface(period=T, **interface)).with_physics(*physics)


def integrated(force: Force, command: Floats) -> Floats:
    """Positions (ticks,) of `mass` by scipy, with a force over position, velocity, command, time.

    From 0.02 m and 0.3 m/s.
    """

    def moves(t: float, x: Floats, u: float) -> list[float]:
        return [x[1], (u - 0.1 * x[1] - 20.0 * x[0] + force(x[0], x[1], u, t)) / 0.5]

    x, found = np.array([0.02, 0.3]), np.zeros(command.size)
    for k, u in enumerate(command.tolist()):
        found[k] = x[0]
        span = (T * k, T * (k + 1))
        x = solve_ivp(moves, span, x, args=(u,), rtol=1e-9, atol=1e-11).y[:, -1]
    return found


def errors(device: Device, truth: Floats, command: Floats, counts: Sequence[int]) -> list[float]:
    """Largest error of position in so many substeps."""
    return [
        float(np.abs(simulate(device, recorded(command), duration=command.size * T,
                              start=Start(0.02, 0.3), substeps=n).trace["position_m1"]
                     - truth).max())
        for n in counts
    ]  # fmt: skip


COMMAND = np.repeat([3.0, -2.0, 2.5, 0.0], 25)
SEEN = Outputs(np.array([0]), np.array([True]), np.array([GROUND]), np.zeros(1))
GRID_STATES = [
    *itertools.combinations(STATES, 2), *((state,) for state in STATES), ("time", "position"),
]  # fmt: skip


def grid_over(states: tuple[str, ...]) -> Device:
    """Return the PHANToM with a force over some states, drawn, in its first link or at m1."""
    size = {"position": 0.01, "velocity": 0.3, "command": 0.05, "time": 0.1}
    one = len(states) == 1
    rows, columns, f = drawn_grid(5, 1 if one else 4)
    r = size[states[0]] * np.sort(rows)
    c = [] if one else (size[states[1]] * columns).tolist()
    at = "m1" if "position" in states else "link12"
    return phantom().with_physics(free(states, r.tolist(), c, 2e-3 * f, at))


Points = tuple[tuple[float, float], ...]


def drawn(count: int, seed: int, wide: float = 1.0, high: float = 1.0) -> Points:
    random = np.random.default_rng(seed)
    states = wide * np.sort(random.normal(size=count))
    laws = high * random.normal(size=count)
    return tuple(zip(states.tolist(), laws.tolist(), strict=True))


def times(over: Sequence[str], first: Any, second: Any, at: str = "m1") -> Physics:
    return make_physics("free_product", at, **two_tables_values(over, first, second))


ALL_STATES = [*itertools.combinations(STATES, 2), ("time", "position")]


def product_over(states: tuple[str, str]) -> Device:
    """Return the PHANToM with a product over two states, drawn, in its first link or at m1."""
    size = {"position": 0.01, "velocity": 0.3, "command": 0.05, "time": 0.1}
    a, b = (size[state] for state in states)
    at = "m1" if "position" in states else "link12"
    return phantom().with_physics(times(states, drawn(5, 1, a, 2e-3), drawn(4, 2, b), at))


def shifted(over: tuple[str, str], first: Any, second: Any, at: str = "m1") -> Physics:
    return make_physics("free_shift", at, **two_tables_values(over, first, second))


def shift_over(states: tuple[str, str]) -> Device:
    """Return the PHANToM with a shift over two states, drawn, in its first link or at m1."""
    size = {"position": 0.01, "velocity": 0.3, "command": 0.05, "time": 0.1}
    a, b = (size[state] for state in states)
    at = "m1" if "position" in states else "link12"
    return phantom().with_physics(
        shifted(states, drawn(5, 1, a, 2e-3), drawn(4, 2, b, 0.3 * a), at)
    )

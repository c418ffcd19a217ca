"""The one-tick closed loop is exact: for every delay, with and without a velocity filter."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from zwidth.controllers.wall import wall
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.loop import MOST_TICKS, open_loop
from zwidth.sim.physics.actuator_lag import actuator_lag
from zwidth.sim.physics.effect import Physics
from zwidth.sim.run import Start, simulate

PERIOD = 0.001
STIFFNESS, DAMPING = 300.0, 0.15
DELAYS = (0.0, 0.3, 1.0, 1.7, 2.0, 5.25, 20.0)


def two_masses(delay: float, cutoff: float = math.inf, lag: float = 0.0) -> Device:
    chain = make_chain([2e-3, 1e-3], [3e-3, 2e-3], 0.5, [80.0], [0.02])
    interface = Interface(period=PERIOD, delay=delay * PERIOD, velocity_cutoff_hz=cutoff)
    physics = (Physics(actuator_lag, "command", {"time_constant": lag}),) if lag else ()
    return Device("two masses", "test", True, chain, interface, physics)


def by_events(device: Device, ticks: int) -> NDArray[np.float64]:
    """Positions of m1 at the ticks by a list of events: reading times and arrivals of commands."""
    plant, interface = device.plant(), device.interface
    x = np.zeros(plant.size)
    x[0] = x[1] = 1.0
    readings = [float(x[0])]
    velocity = 0.0
    arrivals: list[tuple[float, float]] = []
    held, now = 0.0, 0.0
    positions: list[float] = []

    def move(until: float) -> None:
        nonlocal x, now
        block = np.zeros((plant.size + 1,) * 2)
        block[:-1, :-1], block[:-1, -1] = plant.a, plant.b[:, 0]
        x = (expm(block * (until - now)) @ np.append(x, held))[:-1]
        now = until

    for k in range(ticks):
        while arrivals and arrivals[0][0] < k * PERIOD - 1e-9:
            time, command = arrivals.pop(0)
            move(time)
            held = command
        move(k * PERIOD)
        positions.append(float(x[0]))
        difference = (x[0] - readings[-1]) / PERIOD
        velocity += interface.velocity_smoothing * (difference - velocity)
        readings.append(float(x[0]))
        arrivals.append((now + interface.delay, -(STIFFNESS * x[0] + DAMPING * velocity)))
    return np.array(positions)


def by_matrix(device: Device, ticks: int) -> NDArray[np.float64]:
    loop = open_loop(device)
    plant = device.plant()
    whole, remainder = device.interface.delay_ticks
    state = np.zeros_like(loop.reading)
    state[: plant.dof] = state[plant.size + whole + (remainder > 0.0)] = 1.0
    step = loop.closed(STIFFNESS, DAMPING)
    positions: list[float] = []
    for _ in range(ticks):
        positions.append(float(loop.reading @ state))
        state = step @ state
    return np.array(positions)


@pytest.mark.parametrize("cutoff", [math.inf, 40.0])
@pytest.mark.parametrize("delay", DELAYS)
def test_one_tick_matrix_equals_events(delay: float, cutoff: float) -> None:
    """Powers of the matrix are the trajectory of the loop run event by event.

    Mutation: Gamma(r) in place of Phi(T - r) Gamma(r) breaks the delays with a remainder; a
    velocity row without (1 - a) breaks the filtered ones.
    """
    device = two_masses(delay, cutoff)
    reference = by_events(device, 80)
    np.testing.assert_allclose(
        by_matrix(device, 80), reference, rtol=0.0, atol=1e-11 * np.abs(reference).max()
    )


@pytest.mark.parametrize("delay", [0.0, 1.7, 5.25])
def test_one_tick_matrix_equals_the_engine(delay: float) -> None:
    """The linear theory and the simulation are about the same loop, lag of the amplifier included.

    Mutation: leaving the lag out of the plant.
    """
    device = two_masses(delay, 60.0, lag=4e-4)
    run = simulate(device, wall(STIFFNESS, DAMPING), duration=0.06, start=Start(position=1.0))
    reference = run.trace["position_m1"]
    np.testing.assert_allclose(
        by_matrix(device, len(run.trace)), reference, atol=1e-10 * np.abs(reference).max()
    )


@pytest.mark.parametrize("cutoff", [math.inf, 40.0])
@pytest.mark.parametrize("delay", [0.0, 0.3, 2.0, 5.25])
def test_drift_takes_one_eigenvalue_1_away(delay: float, cutoff: float) -> None:
    """A free device at K = 0 has its other eigenvalues in the loop without drift.

    Mutation: leaving y_{k-1} out of the shift.
    """
    chain = make_chain([2e-3, 1e-3], [3e-3, 2e-3], 0.0, [80.0], [0.02])
    device = Device("free", "test", True, chain, two_masses(delay, cutoff).interface)
    loop = open_loop(device)
    assert loop.free
    assert not open_loop(two_masses(delay, cutoff)).free
    np.testing.assert_allclose(loop.damped(0.1) @ loop.shift, loop.shift, atol=1e-12)
    smaller = np.poly(np.linalg.eigvals(loop.without_drift().damped(0.1)))
    whole = np.poly(np.linalg.eigvals(loop.damped(0.1)))
    np.testing.assert_allclose(np.convolve(smaller, [1.0, -1.0]), whole, atol=1e-9)


def test_a_delay_too_long_is_refused() -> None:
    with pytest.raises(ValueError, match=f"interface.delay is 5000 periods.* {MOST_TICKS}"):
        open_loop(two_masses(5000.0))

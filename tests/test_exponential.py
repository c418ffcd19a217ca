"""Propagators of our own: against 40 digits, and what must be exact in them."""

import mpmath
import numpy as np
import pytest
from engine_examples import Floats, one_mass, phantom

from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.exponential import SPACES, held_motion_alone
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.plant import Plant, locked

LAG = make_physics("actuator_lag", "command", time_constant=4e-4)
FREE = make_chain([2e-4, 9e-4, 7e-5], [0.0] * 3, 0.0, [217.0, 14.6], [0.0] * 2)
DEVICES = {
    "one mass": one_mass(1e-3, 6e-3),
    "three masses": phantom(),
    "three masses, lag": phantom().with_physics(LAG),
    "undamped": Device("-", "-", True, FREE, Interface()),
}


def motion(plant: Plant, h: float) -> Floats:
    size = plant.size
    out = np.zeros((size, size + plant.b.shape[1]))
    held_motion_alone(
        np.ascontiguousarray(plant.a), np.ascontiguousarray(plant.b), h, plant.dof,
        np.zeros(size), np.zeros((SPACES, size, size)), out,
    )  # fmt: skip
    return out


def truth(plant: Plant, h: float) -> Floats:
    """Return [E, F] by a Taylor series with 40 digits."""
    size, inputs = plant.b.shape
    block = np.zeros((size + inputs, size + inputs))
    block[:size] = np.hstack([plant.a, plant.b])
    with mpmath.workdps(40):
        whole = mpmath.expm(mpmath.matrix(block.tolist()) * mpmath.mpf(h), method="taylor")
        return np.array(whole.tolist(), dtype=np.float64)[:size]


@pytest.mark.parametrize("h", [1e-3, 1e-4, 2e-6])
@pytest.mark.parametrize("masses", [(), (0,), (1, 2)])
@pytest.mark.parametrize("name", DEVICES)
def test_motion_is_exact(name: str, masses: tuple[int, ...], h: float) -> None:
    """2e-15 of the largest in a row and column's units, of which a substep is the time's.

    Mutations: the series one term shorter (1e-13 at 1 ms); the last squaring in place of the
    product with X (a double eigenvalue of 1 then errs by 1e-8).
    """
    plant = DEVICES[name].plant()
    if masses and max(masses) >= plant.dof:
        pytest.skip("the device has no such mass")
    plant = locked(plant, masses)
    n = plant.dof
    found, exact = motion(plant, h), truth(plant, h)
    row = np.array([1.0] * n + [1.0 / h] * n + [1.0] * (plant.size - 2 * n))
    scaled = np.abs(found - exact) / row[:, None]
    largest = np.abs(exact / row[:, None]).max(axis=0)
    assert np.all(scaled.max(axis=0) <= 2e-15 * np.maximum(largest, 1e-300) + 1e-300)
    for i in masses:
        unit = np.zeros(found.shape[1])
        unit[n + i] = 1.0
        assert np.array_equal(found[n + i], unit)


def test_a_free_body_stays_where_it_is() -> None:
    """Rigid motion is a double eigenvalue of 1: its modulus errs by 1e-12, not its root's 1e-8."""
    plant = DEVICES["undamped"].plant()
    e = motion(plant, 1e-3)[:, : plant.size]
    assert abs(np.abs(np.linalg.eigvals(e)).max() - 1.0) < 1e-12

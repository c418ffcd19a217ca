"""Observers of a population at once: each what its member would have, also where a solver fails."""

import numpy as np
import pytest
from engine_examples import one_mass, phantom
from lane_examples import varied

from zwidth.diagnosis.noise.steady import steady, steady_gains
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.sim.physics import make_physics

LAG = make_physics("actuator_lag", "command", time_constant=4e-4)
POSITION, FAR_SPEED = Output("position", 0), Output("velocity", 2)


def seen(*outputs: Output) -> Experiment:
    return Experiment(1e-3, np.zeros(10), np.zeros((10, len(outputs))), outputs)


@pytest.mark.parametrize("ratio", [1e-4, 1e-1, 1e3])
@pytest.mark.parametrize("outputs", [(POSITION,), (POSITION, FAR_SPEED)])
def test_doubling_gives_every_member_its_gain(outputs: tuple[Output, ...], ratio: float) -> None:
    """1e-9 of each column's largest. Mutations: `g` left as it was; one doubling fewer (1e-3)."""
    devices = varied(phantom().with_physics(LAG), None, 5)
    found = steady_gains(devices, seen(*outputs), ratio)
    for gain, device in zip(found, devices, strict=True):
        own = steady(device, seen(*outputs), ratio).gain
        assert np.all(np.abs(gain - own) <= 1e-9 * np.abs(own).max(axis=0))


def test_every_member_may_have_a_ratio_of_its_own() -> None:
    """Mutation: the first member's for all."""
    ratios = np.geomspace(1e-4, 1e4, 5)
    found = steady_gains([phantom()] * 5, seen(POSITION), ratios)
    for gain, ratio in zip(found, ratios.tolist(), strict=True):
        alone = steady_gains([phantom()], seen(POSITION), ratio)[0]
        assert np.allclose(gain, alone, rtol=1e-9, atol=0.0)


def test_a_population_of_velocities_alone_has_gains() -> None:
    """Where the device stands never shows; each member's gain is then found by itself."""
    devices = varied(one_mass(1e-3, 2e-3), None, 3)
    only = seen(Output("velocity", 0))
    expected = [steady(device, only, 1e-2).gain for device in devices]
    assert np.array_equal(steady_gains(devices, only, 1e-2), expected)


def test_a_gain_is_a_fixed_point_where_the_solver_of_one_matrix_fails() -> None:
    """At a ratio of 1e-7, where scipy refuses several of these: finite, and smooth in the ratio.

    Mutation: states in the device's units in `_doubled`.
    """
    devices = varied(phantom(), None, 8)
    found = steady_gains(devices, seen(POSITION), 1e-7)
    assert np.all(np.isfinite(found))
    close = steady_gains(devices, seen(POSITION), 1.0001e-7)
    assert np.all(np.abs(close - found) <= 1e-3 * np.abs(found).max(axis=1, keepdims=True))

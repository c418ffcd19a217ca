"""Convergence: slope 2 for whatever is smooth, and for what is not, the order seen."""

import itertools

import numpy as np
import pytest
from physics_examples import EVERYWHERE, EXAMPLES, phantom

from zwidth.controllers.none import none
from zwidth.sim.device import Device
from zwidth.sim.physics import EFFECTS, make_physics
from zwidth.sim.physics.free_force import grid_values
from zwidth.sim.physics.two_tables import two_tables_values
from zwidth.sim.run import Start, simulate

SMOOTH = [
    (name, place)
    for name in (
        "presliding_friction",
        "quadratic_drag",
        "gravity_pendulum",
        "force_ripple",
        "cubic_stiffness",
        "hysteresis",
        "free_force",
        "free_product",
        "free_shift",
    )
    for place in EFFECTS[name].places
    if (name, place) in EVERYWHERE
]
WIDE = grid_values(  # nothing goes beyond it: at an edge a force has a corner
    ["velocity", "time"], [-9.0, 0.0, 9.0], [0.0, 0.03, 0.06],
    [[0.09, 0.02, 0.05], [0.0, 0.03, -0.02], [-0.03, 0.01, -0.09]],
)  # fmt: skip
TIMES = two_tables_values(
    ["velocity", "time"], [(-9.0, 0.09), (0.0, 0.02), (9.0, -0.09)],
    [(0.0, 1.0), (0.03, 0.4), (0.06, 1.2)],
)  # fmt: skip
MOVED = two_tables_values(
    ["velocity", "time"], [(-9.0, 0.09), (-1.0, 0.05), (0.5, -0.02), (9.0, -0.09)],
    [(0.0, 0.1), (0.03, -0.3), (0.06, 0.5)],
)  # fmt: skip
LARGER: dict[str, dict[str, float]] = {
    "quadratic_drag": {"coefficient": 0.03},
    "cubic_stiffness": {"coefficient": 2e6},
    "free_force": WIDE,
    "free_product": TIMES,
    "free_shift": MOVED,
}
COARSE, FINEST = (4, 8, 16, 32, 64), 2048


def _velocities(device: Device, substeps: int, velocity: float, duration: float) -> np.ndarray:
    run = simulate(
        device, none(), duration=duration, start=Start([2e-3, 1e-3, -1e-3], velocity),
        disturbance=0.05 * np.sin(np.arange(round(duration * 1000)) * 0.3), substeps=substeps,
    )  # fmt: skip
    return np.array([run.trace[f"velocity_m{i}"] for i in (1, 2, 3)])


def _slope(device: Device, velocity: float = 0.0, duration: float = 0.05) -> float:
    """Order of the rms error over the whole run, by a straight line through its logarithms."""
    truth = _velocities(device, FINEST, velocity, duration)
    errors = [np.std(_velocities(device, n, velocity, duration) - truth) for n in COARSE]
    return -float(np.polyfit(np.log(COARSE), np.log(errors), 1)[0])


@pytest.mark.parametrize(("name", "place"), SMOOTH)
def test_a_smooth_effect_is_second_order(name: str, place: str) -> None:
    """2 +- 0.1. Mutation: the mean of both ends left out in `substep`: slope 1."""
    values = EXAMPLES[name] | LARGER.get(name, {})
    assert _slope(phantom().with_physics(make_physics(name, place, **values))) == pytest.approx(
        2.0, abs=0.1
    )


def test_viscous_friction_of_two_directions_is_second_order_through_zero() -> None:
    """2 +- 0.1. Mutation: `mean_friction_limits` not called: slope 1."""
    values = {"level_plus": 0.0, "level_minus": 0.0, "viscous_plus": 0.02, "viscous_minus": 0.005}
    physics = make_physics("directional_friction", "m1", **values)
    assert _slope(phantom().with_physics(physics)) == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize(
    ("name", "place"),
    [
        *itertools.product(
            ("directional_friction", "stribeck_friction", "rising_friction"), ("m1", "m2", "m3")
        )
    ],
)
@pytest.mark.parametrize("velocity", [3.0, -3.0])
def test_dry_friction_that_varies_with_speed_slides_at_second_order(
    name: str, place: str, velocity: float
) -> None:
    """2 +- 0.1 without reversal. Mutation: `mean_friction_limits` not called: slope 1."""
    values = EXAMPLES[name] | ({"velocity": 1.5} if "velocity" in EXAMPLES[name] else {})
    physics = make_physics(name, place, **values)
    device = phantom().with_physics(physics)
    assert _slope(device, velocity, 0.01) == pytest.approx(2.0, abs=0.1)

"""A goal and a measured speed, without a device: a loop in proportion to the error of the speed."""

import warnings

import numpy as np
import pytest

import zwidth


@pytest.mark.truth
def test_a_loop_on_the_speed_is_found_with_the_friction_in_it() -> None:
    """J v' = k (g - v) - b v - friction: counted in k, the mass is J / k, the damper (b + k) / k.

    Mutations: the goal taken for a position; the unit of the goal left out.
    """
    random, period, k = np.random.default_rng(4), 2e-3, 0.05
    t = period * np.arange(5000)
    hertz = np.array([0.4, 0.9, 1.7, 3.1, 5.9])
    lines = np.cos(2.0 * np.pi * np.outer(t, hertz) + random.uniform(0.0, 6.28, hertz.size))
    goal, speed, v = 40.0 * lines.sum(axis=1), np.zeros(t.size), 0.0
    for i in range(t.size):
        speed[i] = v
        for _ in range(40):
            force = k * (goal[i] - v) - 1e-3 * v - 0.05 * np.tanh(v / 0.01)
            v += period / 40.0 * force / 2e-3
    rpm = 60.0 / (2.0 * np.pi)
    seen = rpm * (speed + 0.02 * random.standard_normal(t.size))
    with warnings.catch_warnings(action="ignore"):
        found = zwidth.diagnose(
            {"time_s": t, "goal_rpm": rpm * goal, "actual_rpm": seen}, effort="quick"
        )
    assert [f.effect for f in found.findings] == ["coulomb_friction"]
    assert found.findings[0].parameters["level"].value == pytest.approx(0.05 / k, rel=0.005)
    assert found.device.chain.masses[0] == pytest.approx(2e-3 / k, rel=0.002)
    assert found.device.chain.ground_dampers[0] == pytest.approx((1e-3 + k) / k, rel=0.002)

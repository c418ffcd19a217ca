"""The servo and the wheel that are shipped: their numbers are those of their sources, and hold."""

import math

import numpy as np
import pytest

from zwidth.scenarios.scenario import usual_substeps
from zwidth.sim.device_file import load_device
from zwidth.stability.bisection import Search, find_brackets
from zwidth.stability.judging import Trial
from zwidth.stability.linear import critical_stiffness, last_stable_damping

TURN = 2.0 * math.pi


def test_their_steps_are_those_of_their_registers() -> None:
    """Positions and velocities of the servo's data sheet, its current as a torque; the wheel's."""
    servo = load_device("serial_bus_servo").interface
    assert servo.encoder_step == pytest.approx(TURN / 4096, rel=1e-9)
    assert servo.velocity_step == pytest.approx(0.229 * TURN / 60.0, rel=1e-6)
    assert servo.command_step == pytest.approx(2.69e-3 * 4.1 / 2.3, rel=1e-3)
    wheel = load_device("gaming_wheel").interface
    assert wheel.encoder_step == pytest.approx(math.radians(900.0) / 2**16, rel=1e-6)
    assert wheel.command_step == pytest.approx(wheel.command_limit / 10_000, rel=1e-9)


@pytest.mark.parametrize(("name", "within"), [("serial_bus_servo", 0.06), ("gaming_wheel", 0.01)])
def test_without_a_virtual_damper_they_bear_what_their_own_gives(name: str, within: float) -> None:
    """K = b / (T/2 + t_d) of a rigid device, up to b T / m. Mutation: the delay a period longer."""
    device = load_device(name)
    face, b = device.interface, float(device.chain.ground_dampers[0])
    found = critical_stiffness(device, 0.0).stiffness
    assert found == pytest.approx(b / (0.5 * face.period + face.delay), rel=within)


@pytest.mark.parametrize("name", ["serial_bus_servo", "gaming_wheel"])
def test_friction_and_steps_move_their_walls_by_little(name: str) -> None:
    """From a start beyond the dither of their steps: theory less 3 % to theory plus 12 %.

    Friction adds. Mutation: friction ten times as large (the wheel's first wall is twice as stiff).
    """
    device = load_device(name)
    last = last_stable_damping(device)
    assert last is not None
    dampings = np.array([0.0, 0.2, 0.4]) * last
    trial = Trial(start=0.2, limit_s=16.0, substeps=usual_substeps(device))
    found = find_brackets([device], [dampings], trial, Search(tolerance=5e-3))[0]
    for bracket in found:
        theory = critical_stiffness(device, bracket.damping).stiffness
        assert theory is not None
        assert bracket.stable is not None
        assert 0.97 * theory < bracket.stable < 1.12 * theory

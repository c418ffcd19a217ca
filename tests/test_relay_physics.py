"""The relay beside bisection under the same physics: which of the two each effect moves."""

import pytest

from zwidth.paper.relay_physics import DAMPING, Changed, changed
from zwidth.paper.theory import phantom
from zwidth.sim.physics import make_physics
from zwidth.stability.linear import critical_stiffness

DEVICE = phantom(0.008)
LINEAR = critical_stiffness(DEVICE, DAMPING).stiffness or 0.0


def off(found: Changed) -> float:
    assert found.relay.stiffness is not None
    return found.relay.stiffness / found.true - 1.0


def test_friction_moves_relay_and_boundary_together() -> None:
    """Mutation: bisection from 1e-3 instead of the relay's amplitude finds a far stiffer wall."""
    rubbing = DEVICE.with_physics(make_physics("coulomb_friction", "m1", level=0.01))
    found = changed("friction", 0.01, rubbing)
    assert found.true > 1.25 * LINEAR
    assert abs(off(found)) < 0.05


def test_an_encoder_step_moves_neither_relay_nor_boundary() -> None:
    """Only walls that come to rest end earlier. Mutation: dither counted as growth."""
    found = changed("step", 1e-4, DEVICE.with_interface(encoder_step=1e-4))
    assert found.true == pytest.approx(LINEAR, rel=1e-2)
    assert abs(off(found)) < 0.03
    assert found.rests < 0.9 * LINEAR


def test_a_limit_moves_the_relay_and_not_the_boundary() -> None:
    """Mutation: the limit taken from the device of the bisection alone."""
    found = changed("limit", 0.06, DEVICE.with_interface(command_limit=0.06))
    assert found.true == pytest.approx(LINEAR, rel=3e-3)
    assert off(found) < -0.1

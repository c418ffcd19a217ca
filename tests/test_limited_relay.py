"""What a relay reads through a limited amplifier: describing function beside the time domain."""

from dataclasses import replace

import numpy as np
import pytest

from zwidth.identification.relay import STANDARD, RelayTest, relay_run
from zwidth.sim.device_file import load_device
from zwidth.stability.limited_relay import (
    command_share,
    limited_boundary,
    limited_reading,
    passed_share,
)
from zwidth.stability.linear import critical_stiffness, last_stable_damping

PHANTOM = load_device("phantom_1_0")


@pytest.mark.parametrize(
    ("ms", "damping", "ratio"),
    [(2, 0.105, 30.0), (2, 0.12, 50.0), (4, 0.264, 20.0), (4, 0.3, 40.0), (8, 0.14, 30.0)],
)
def test_beyond_the_region_the_relay_settles_where_its_amplifier_bounds_it(
    ms: float, damping: float, ratio: float
) -> None:
    """No wall is stable there, the limited loop oscillates, and one harmonic says where to 4 %.

    Mutation: N left out of B' = N B; the command without the damper's share.
    """
    device = PHANTOM.with_interface(delay=1e-3 * ms)
    assert critical_stiffness(device, damping).stiffness is None
    limited = device.with_interface(command_limit=ratio * STANDARD.force)
    seen, expected = relay_run(limited, damping), limited_reading(device, damping, ratio)
    assert seen.verdict == "oscillates"
    assert expected.stiffness == pytest.approx(seen.stiffness, rel=0.04)
    assert expected.frequency_hz == pytest.approx(seen.frequency_hz, rel=0.01)


def test_the_reading_is_proportional_to_the_limit_and_not_to_the_relay() -> None:
    """Only the ratio counts. Mutation: an encoder step, which has a size of its own."""
    device = PHANTOM.with_interface(delay=0.004, command_limit=1.5)
    small = relay_run(device, 0.27)
    large = relay_run(
        device.with_interface(command_limit=15.0), 0.27, test=replace(RelayTest(), force=0.5)
    )
    assert large.stiffness == pytest.approx(small.stiffness, rel=1e-3)
    assert large.stiffness is not None


def test_where_nothing_is_limited_it_is_the_boundary() -> None:
    device = PHANTOM.with_interface(delay=0.004)
    last = last_stable_damping(device) or 0.0
    dampings = np.linspace(0.0, 0.999 * last, 7)
    free = [critical_stiffness(device, float(b)) for b in dampings]
    assert limited_boundary(device, dampings.tolist(), 1e6) == free


def test_the_reading_falls_without_a_step_across_the_last_stable_damping() -> None:
    """Mutation: the linear point kept wherever there is one."""
    device = PHANTOM.with_interface(delay=0.002)
    last = last_stable_damping(device) or 0.0
    before, after = limited_boundary(device, [last * (1 - 1e-6), last * (1 + 1e-6)], 30.0)
    assert before.stiffness is not None
    assert after.stiffness == pytest.approx(before.stiffness, rel=1e-3)


def test_share_of_a_saturation() -> None:
    """N = 1 up to the limit, 4/(pi share) far beyond it. Mutation: asin r without r sqrt(1-r^2)."""
    np.testing.assert_allclose(passed_share([0.0, 1.0]), 1.0)
    assert passed_share(1e4) == pytest.approx(4.0 / np.pi * 1e-4, rel=1e-6)
    assert command_share(3.0 + 4.0j, 5.0, 8.0 / np.pi) == pytest.approx(0.5)
    assert command_share(1.0, 0.0, 2.0) == np.inf


def test_a_limit_below_the_relay_is_refused() -> None:
    with pytest.raises(ValueError, match="or the amplifier limits the relay"):
        limited_reading(PHANTOM, 0.05, 1.0)

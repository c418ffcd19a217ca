"""Root loci keep their names, and say which mode ends the boundary."""

import math

import numpy as np
import pytest

from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.interface import Interface
from zwidth.sim.loop import open_loop
from zwidth.sim.physics.actuator_lag import actuator_lag
from zwidth.sim.physics.effect import Physics
from zwidth.stability import branches
from zwidth.stability.branches import critical_mode, damper_effect, damping_locus, stiffness_locus
from zwidth.stability.linear import boundary, corner, critical_stiffness, last_stable_damping
from zwidth.stability.types import LinearPoint

PHANTOM = load_device("phantom_1_0")


def phantom(delay_ms: float) -> Device:
    return PHANTOM.with_interface(delay=1e-3 * delay_ms)


def end_of(device: Device) -> float:
    end = last_stable_damping(device)
    assert end is not None
    return end


@pytest.mark.parametrize(
    ("delay_ms", "beyond", "start_hz"),
    [(2, "mode 2", 182.0), (4, "delay", 0.0), (8, "mode 2", 182.0)],
)
def test_what_goes_unstable_beyond_the_corner(
    delay_ms: float, beyond: str, start_hz: float
) -> None:
    """Below B_t the rigid body, above it mode 2 at 2 and 8 ms, a branch of the delay at 4 ms.

    Mutation: names given in the order of the imaginary parts.
    """
    device = phantom(delay_ms)
    top = corner(device)
    assert top is not None
    below = critical_stiffness(device, 0.999 * top.damping)
    above = critical_stiffness(device, 1.001 * top.damping)
    assert critical_mode(device, below) == "rigid body"
    assert critical_mode(device, above) == beyond
    locus = damping_locus(device, [0.0])
    started = locus.frequency_hz[0, locus.names.index(beyond)]
    assert started == pytest.approx(start_hz, abs=1.0)


@pytest.mark.parametrize(("delay_ms", "sign"), [(2, -1), (4, 1), (8, -1)])
def test_why_4_ms_is_larger(delay_ms: float, sign: int) -> None:
    """At mode 2 the damper drives the motion at 2 and 8 ms and damps it at 4 ms.

    So with B mode 2 loses its decay at 2 and 8 ms, and keeps it at 4 ms. Mutation: the hold left
    out of `damper_effect`, or half the delay.
    """
    device = phantom(delay_ms)
    end = end_of(device)
    locus = damping_locus(device, [0.0, 0.02 * end, end])
    mode = locus.names.index("mode 2")
    effect = damper_effect(device, locus.frequency_hz[0, mode])
    assert math.copysign(1.0, effect.real) == sign
    assert abs(effect.real) > 0.5
    decay = locus.decay[:, mode]
    assert np.sign(decay[1] - decay[0]) == sign
    assert (decay[2] > 10.0) == (sign > 0)


def test_branches_are_the_eigenvalues() -> None:
    """Every row is the spectrum of the loop; the start is e^{pT}, and 0 for what is stored."""
    device = phantom(2.4).with_interface(velocity_cutoff_hz=100.0)
    device = device.with_physics(Physics(actuator_lag, "command", {"time_constant": 2e-4}))
    dampings, stiffnesses = [0.0, 0.01, 0.05], [0.0, 3.0, 20.0]
    loop = open_loop(device)
    over_b = damping_locus(device, dampings)
    over_k = stiffness_locus(device, 0.05, stiffnesses)
    poles = np.exp(np.linalg.eigvals(device.plant().a) * loop.period)
    assert over_b.names[:6] == ("rigid body",) * 2 + ("mode 1",) * 2 + ("mode 2",) * 2
    assert over_b.names[6:] == ("amplifier", "delay", "delay", "delay", "delay", "velocity filter")
    for pole in poles:
        assert np.abs(over_b.z[0] - pole).min() < 1e-9
    for row, b in zip(over_b.z[1:], dampings[1:], strict=True):
        expected = np.linalg.eigvals(loop.closed(0.0, b))
        np.testing.assert_allclose(np.poly(row), np.poly(expected), atol=1e-9)
    for row, k in zip(over_k.z, stiffnesses, strict=True):
        expected = np.linalg.eigvals(loop.closed(k, 0.05))
        np.testing.assert_allclose(np.poly(row), np.poly(expected), atol=1e-9)
    np.testing.assert_allclose(np.sort_complex(over_k.z[0]), np.sort_complex(over_b.z[2]))


@pytest.mark.parametrize("delay_ms", [2, 4, 8])
def test_names_do_not_depend_on_the_steps(delay_ms: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """A tenth of the step everywhere gives the same names along the whole boundary."""
    device = phantom(delay_ms)
    points = boundary(device, np.linspace(0.0, 0.999, 7) * end_of(device))
    coarse = [critical_mode(device, point) for point in points]
    monkeypatch.setattr(branches, "LONGEST_STEP", 0.005)
    monkeypatch.setattr(branches, "SHORT", 0.025)
    assert [critical_mode(device, point) for point in points] == coarse
    assert coarse[0] == "rigid body"


@pytest.mark.parametrize("delay_ms", [0.0, 4.5, 5.0])
def test_one_far_wall_or_many_on_the_way(delay_ms: float) -> None:
    """Modes keep their names to 3 times the last stable B, whether asked once or 300 times.

    Mutation: FIRST_STEP = LONGEST_STEP = 1 with SHORT = 1e9, one step to the end.
    """
    device = phantom(delay_ms)
    far = 3.0 * end_of(device)
    once, often = damping_locus(device, [far]), damping_locus(device, np.linspace(0.0, far, 300))
    for mode in ("mode 1", "mode 2"):
        columns = [i for i, name in enumerate(once.names) if name == mode]
        np.testing.assert_allclose(
            np.sort_complex(once.z[-1, columns]), np.sort_complex(often.z[-1, columns])
        )


def test_a_pair_has_one_name() -> None:
    """At 4 ms the damper turns a rigid and a delay eigenvalue into one pair: the rigid body's.

    Mutation: the name of the eigenvalue itself.
    """
    device = phantom(4)
    locus = damping_locus(device, [end_of(device)])
    pair = locus.z[0][np.abs(locus.frequency_hz[0] - 36.7) < 0.5]
    assert {locus.names[int(np.flatnonzero(locus.z[0] == z)[0])] for z in pair} == {
        "rigid body",
        "delay",
    }
    assert [locus.name_at(complex(z)) for z in pair] == ["rigid body", "rigid body"]


def test_the_critical_branch_is_on_the_circle() -> None:
    """At K_CR the named branch has no decay and the ultimate frequency."""
    device = phantom(2)
    point = critical_stiffness(device, 0.03)
    assert point.stiffness is not None
    locus = stiffness_locus(device, 0.03, [0.9 * point.stiffness, point.stiffness])
    slowest = int(np.argmin(locus.decay[1]))
    assert locus.names[slowest] == "rigid body"
    assert locus.decay[1, slowest] == pytest.approx(0.0, abs=1e-6)
    assert locus.decay[0, slowest] > 0.1
    assert locus.frequency_hz[1, slowest] == pytest.approx(point.frequency_hz, rel=1e-9)


def test_the_damper_turns_with_the_delay() -> None:
    """Backward difference and hold each cost half a tick: sinc^2(w T/2) at -w (T + t_d).

    Mutation: the estimate without its own half tick.
    """
    f = np.array([1.0, 50.0, 123.0, 400.0])
    device = phantom(2.37)
    expected = np.sinc(f * 0.001) ** 2 * np.exp(-2j * np.pi * f * 0.00337)
    np.testing.assert_allclose(damper_effect(device, f), expected, rtol=1e-12)


def test_one_mass_has_only_its_rigid_body() -> None:
    chain = make_chain([0.2], [0.5], 30.0)
    device = Device("one", "test", False, chain, Interface(delay=0.0013))
    assert critical_mode(device, critical_stiffness(device, 0.1)) == "rigid body"
    assert critical_mode(device, LinearPoint(1e3, None, None, None)) is None


def test_bad_input_is_named() -> None:
    with pytest.raises(ValueError, match="damping is nan; only finite"):
        damping_locus(PHANTOM, [0.0, math.nan])
    with pytest.raises(ValueError, match="stiffness is inf; only finite"):
        stiffness_locus(PHANTOM, 0.0, [math.inf])
    with pytest.raises(ValueError, match="give frequencies > 0 Hz"):
        damper_effect(PHANTOM, [0.0])

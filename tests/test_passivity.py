"""The passive walls: closed forms, and no passive hand that makes them unstable."""

import math

import numpy as np
import pytest

from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.interface import Interface
from zwidth.sim.physics.actuator_lag import actuator_lag
from zwidth.sim.physics.effect import Physics
from zwidth.stability.linear import critical_stiffness
from zwidth.stability.passivity import passive_boundary, passive_stiffness, stiffest_passive

T = 0.001


def one_mass(delay: float, mass: float = 1.0, b: float = 1.0, cutoff: float = math.inf) -> Device:
    interface = Interface(period=T, delay=delay * T, velocity_cutoff_hz=cutoff)
    return Device("one mass", "test", False, make_chain([mass], [b]), interface)


def stiffness(device: Device, damping: float) -> float:
    value = passive_stiffness(device, damping).stiffness
    assert value is not None
    return value


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.99])
def test_without_delay(share: float) -> None:
    """Colgate and Schenkel: b >= K T/2 + |B|. Mutation: B - b cos(wT) in place of -cos."""
    point = passive_stiffness(one_mass(0.0, b=2.0), 2.0 * share)
    assert point.stiffness == pytest.approx(2.0 * (1.0 - share) / (T / 2.0), rel=1e-9)
    assert point.frequency_hz == pytest.approx(0.0 if share == 0.0 else 0.5 / T)
    assert passive_stiffness(one_mass(0.0, b=2.0), 2.001).stiffness is None


@pytest.mark.parametrize("ticks", [1, 2, 8, 100])
def test_with_whole_ticks_of_delay(ticks: int) -> None:
    """n ticks and B = 0: b >= K (T/2 + nT). Mutation: n - 1 in the kernel; POINTS_PER_TICK = 1."""
    assert stiffness(one_mass(float(ticks)), 0.0) == pytest.approx(1.0 / (T / 2.0 + ticks * T))


def test_damping_turns_with_the_delay() -> None:
    """One tick: K T/2 (1 + 2 cos x) <= b + B cos 2x for all x, here from a fine grid of x.

    Mutation: no refinement between the points.
    """
    x = np.linspace(0.0, np.pi, 2_000_001)
    kernel = 0.5 * T * (1.0 + 2.0 * np.cos(x))
    for damping in (0.1, 0.5, 0.9):
        room = 1.0 + damping * np.cos(2.0 * x)
        expected = (room[kernel > 0.0] / kernel[kernel > 0.0]).min()
        assert stiffness(one_mass(1.0), damping) == pytest.approx(expected, rel=1e-9)


def test_an_angle_at_a_time_equals_the_criterion() -> None:
    """The paper's inequality itself, with velocity filter and two ticks of delay.

    Mutation: the filter left out of w u.
    """
    device = one_mass(2.0, cutoff=60.0)
    a = device.interface.velocity_smoothing
    x = np.linspace(1e-3, np.pi, 200_001)
    z = np.exp(1j * x)
    w = a * (1.0 - 1.0 / z) / (T * (1.0 - (1.0 - a) / z))
    for damping in (0.2, 0.8):
        k = stiffness(device, damping)

        def needed(stiffness: float, damping: float = damping) -> float:
            wall = (stiffness + damping * w) / z**2
            return float((T / 2.0 / (1.0 - np.cos(x)) * (wall * (1.0 - 1.0 / z)).real).max())

        assert needed(k) == pytest.approx(1.0, abs=1e-5)
        assert needed(1.001 * k) > 1.0


@pytest.mark.parametrize("ticks", [0.0, 1.0, 3.0])
def test_a_heavy_hand_reaches_it(ticks: float) -> None:
    """With B = 0 and whole ticks a large mass is the worst hand: K_CR falls to the passive K."""
    passive = stiffness(one_mass(ticks), 0.0)
    ratios: list[float] = []
    for mass in (0.1, 1.0, 100.0):
        k = critical_stiffness(one_mass(ticks, mass), 0.0).stiffness
        assert k is not None
        ratios.append(k / passive)
    assert ratios == sorted(ratios, reverse=True)
    assert ratios[-1] == pytest.approx(1.0, abs=1e-4)
    assert ratios[-1] > 1.0


@pytest.mark.parametrize("cutoff", [math.inf, 80.0])
@pytest.mark.parametrize("ticks", [0.0, 0.5, 1.0, 2.25])
def test_no_hand_is_worse(ticks: float, cutoff: float) -> None:
    """Random hands of three masses and a spring to ground, hardly damped, stay stable up to it.

    Mutation: the remainder's term r (T - r)/4 left out, or r s_d in place of r s_{d+1}.
    """
    rng = np.random.default_rng(7)
    interface = one_mass(ticks, cutoff=cutoff).interface
    for damping in (0.0, 0.3):
        passive = stiffness(Device("m", "t", False, make_chain([1], [1]), interface), damping)
        for _ in range(25):
            masses = 10.0 ** rng.uniform(-2.0, 2.0, 3)
            links = masses[1:] * 10.0 ** rng.uniform(2.0, 7.0, 2)
            chain = make_chain(masses, [1.0, 0.0, 0.0], masses[0], links, 1e-6 * links)
            k = critical_stiffness(Device("hand", "t", False, chain, interface), damping).stiffness
            assert k is not None
            assert k > 0.9999 * passive


def test_half_a_tick_has_a_worse_hand_than_a_mass() -> None:
    """A heavy mass behind a link that rings at the sampling rate comes within 1.1 % of it.

    Masses alone stop 5.9 % above: what happens at the aliases counts when r > 0. Mutation: the term
    r (T - r)/4 left out, which makes the passive K as large as for masses.
    """
    passive = stiffness(one_mass(0.5), 0.0)
    assert passive * T == pytest.approx(2.0 / (1.0 + math.sqrt(1.25)), rel=1e-9)
    rate = 2.0 * math.pi / T
    chain = make_chain([0.012, 3e4], [1.0, 0.0], 0.0, [0.012 * rate**2], [0.0])
    interface = one_mass(0.5).interface
    ringing = critical_stiffness(Device("hand", "t", False, chain, interface), 0.0).stiffness
    heavy = critical_stiffness(one_mass(0.5, mass=3e4), 0.0).stiffness
    assert ringing is not None
    assert heavy is not None
    assert 1.0 < ringing / passive < 1.011
    assert heavy / passive > 1.058


def test_it_lies_inside_the_stable_walls() -> None:
    """On the PHANToM every passive wall is stable, and passivity ends at B = b at the latest."""
    device = load_device("phantom_1_0")
    b = float(device.chain.ground_dampers.sum())
    dampings = np.linspace(0.0, 1.2 * b, 13)
    for point in passive_boundary(device, dampings):
        if point.damping < b:
            stable = critical_stiffness(device, point.damping).stiffness
            assert stable is not None
            assert point.stiffness is not None
            assert 0.0 < point.stiffness < stable
        else:
            assert point.stiffness is None
            assert point.frequency_hz is None


def test_devices_outside_the_criterion() -> None:
    assert passive_stiffness(one_mass(0.0, b=0.0), 0.0).stiffness is None
    with pytest.raises(ValueError, match="damping is inf; only finite"):
        passive_stiffness(one_mass(0.0), math.inf)
    lag = Physics(actuator_lag, "command", {"time_constant": 1e-3})
    with pytest.raises(ValueError, match="actuator_lag is set"):
        passive_stiffness(one_mass(0.0).with_physics(lag), 0.0)


def test_the_stiffest_passive_wall_is_the_top_of_the_hill() -> None:
    """Mutations: the best of the coarse grid taken; the hill looked for at B = 0 alone."""
    device = load_device("phantom_1_0")
    top = stiffest_passive(device)
    assert top is not None
    assert top.stiffness is not None
    grid = np.linspace(0.0, 0.006, 601).tolist()
    dense = max(passive_boundary(device, grid), key=lambda p: p.stiffness or 0.0)
    assert dense.stiffness is not None
    assert top.stiffness >= dense.stiffness
    assert top.stiffness == pytest.approx(dense.stiffness, rel=1e-4)
    assert top.damping == pytest.approx(dense.damping, abs=2e-5)
    assert stiffest_passive(one_mass(1.0, b=0.0)) is None

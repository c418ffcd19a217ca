"""Velocity filters and several rates: the tick against slow references, theory against itself."""

import math

import numpy as np
import pytest
from engine_examples import Floats, one_mass, phantom
from scipy.signal import butter, cont2discrete, lfilter

from zwidth.controllers.wall import wall
from zwidth.sim.device import Device
from zwidth.sim.device_file import device_from_text, device_to_text
from zwidth.sim.interface import Interface
from zwidth.sim.loop import open_loop
from zwidth.sim.run import Start, simulate
from zwidth.stability.bisection import Search, find_brackets
from zwidth.stability.decomposition import curve
from zwidth.stability.judging import Trial
from zwidth.stability.linear import boundary, corner, critical_stiffness, last_stable_damping
from zwidth.stability.passivity import passive_boundary
from zwidth.stability.periodic import periodic_boundary, periodic_loop

T = 1e-3


def second(cutoff: float, **others: float) -> Device:
    return phantom().with_interface(velocity_cutoff_hz=cutoff, velocity_order=2, **others)


@pytest.mark.parametrize("cutoff", [20.0, 120.0, 900.0])
def test_the_second_order_filter_is_butterworths(cutoff: float) -> None:
    """1e-12 of scipy's step-invariant one. Mutation: kept without its sine (1e-1)."""
    run = simulate(second(cutoff), wall(2.0, 0.01), duration=0.3, start=Start(1e-3, 0.0))
    y = run.trace["encoder"]
    b, a = butter(2, 2.0 * np.pi * cutoff, analog=True)
    numerator, denominator, _ = cont2discrete((b, a), T, method="zoh")
    # scipy gives the state before the input of this tick; ours has it in (a step earlier).
    differences = np.diff(y, prepend=y[0]) / T
    truth = lfilter(np.append(numerator.ravel()[1:], 0.0), denominator, differences)
    found = run.trace["velocity_estimate"]
    assert np.abs(found - truth).max() < 1e-12 * np.abs(truth).max()


def test_an_order_without_a_cutoff_changes_nothing() -> None:
    """To the bit. Mutation: `second_order` without its second condition."""
    runs = [
        simulate(
            phantom().with_interface(velocity_order=n), wall(5.0, 0.02), duration=0.1,
            start=Start(1e-3),
        )
        for n in (1, 2)
    ]  # fmt: skip
    assert np.array_equal(runs[0].trace["position_m1"], runs[1].trace["position_m1"])


def by_hand(device: Device, stiffness: float, damping: float, ticks: int) -> Floats:
    """Positions of one free mass under two rates, a tick at a time, from rest at 1e-3."""
    face = device.interface
    m, b = float(device.chain.masses[0]), float(device.chain.ground_dampers[0])
    decay = math.exp(-b / m * face.period)
    x, speed, given, estimate, before = 1e-3, 0.0, 0.0, 0.0, 1e-3
    rows: list[float] = []
    for k in range(ticks):
        rows.append(x)
        if k % face.velocity_ticks == 0:
            estimate = (x - before) / (face.velocity_ticks * face.period)
            before = x
        if k % face.position_ticks == 0:
            given = x
        end = -(stiffness * given + damping * estimate) / b
        x += end * face.period + (speed - end) * m / b * (1.0 - decay)
        speed = end + (speed - end) * decay
    return np.array(rows)


@pytest.mark.parametrize(("fast", "slow"), [(1, 5), (10, 1), (4, 6)])
def test_several_rates_are_those_of_the_definition(fast: int, slow: int) -> None:
    """1e-11. Mutations: the difference over one tick (1e-1); the position renewed at odd ticks."""
    device = one_mass(1e-3, 5e-3).with_interface(
        period=2e-4, delay=0.0, velocity_ticks=fast, position_ticks=slow
    )
    run = simulate(device, wall(3.0, 4e-3), duration=0.1, start=Start(1e-3))
    truth = by_hand(device, 3.0, 4e-3, 500)
    assert np.abs(run.trace["position_m1"] - truth).max() < 1e-11 * np.abs(truth).max()


@pytest.mark.parametrize("n", [2, 5])
def test_all_slow_is_a_long_period(n: int) -> None:
    """K_CR of position and velocity every n ticks of T / n is that at T, to 1e-9."""
    single = phantom().with_interface(period=T, delay=0.002)
    several = single.with_interface(period=T / n, velocity_ticks=n, position_ticks=n)
    for b in (0.0, 0.05):
        (found,) = periodic_boundary(several, [b])
        truth = critical_stiffness(single, b)
        assert found.stiffness == pytest.approx(truth.stiffness, rel=1e-9)
        assert found.frequency_hz == pytest.approx(truth.frequency_hz, rel=1e-6)
    top, last = corner(several), last_stable_damping(several)
    assert top is not None
    assert last == pytest.approx(last_stable_damping(single), rel=1e-4)
    known = corner(single)
    assert known is not None
    assert top.stiffness == pytest.approx(known.stiffness, rel=1e-3)


def test_a_cycle_of_one_tick_has_the_eigenvalues_of_the_loop() -> None:
    """1e-9 in modulus, the zeros apart. Mutation: the slope's weight on v with the other sign."""
    device = second(80.0, delay=0.0023)
    one = np.sort(np.abs(np.linalg.eigvals(open_loop(device).closed(4.0, 0.02))))
    other = np.sort(np.abs(np.linalg.eigvals(periodic_loop(device).closed(4.0, 0.02))))
    assert other[-one.size :] == pytest.approx(one, abs=1e-9)


def test_the_closed_form_has_the_second_order_filter() -> None:
    """The D-decomposition at each ultimate frequency gives K_CR, B back to 1e-7."""
    device = second(60.0, delay=0.002)
    for point in boundary(device, [0.01, 0.03, 0.05]):
        assert point.stiffness is not None
        assert point.frequency_hz is not None
        found = curve(device, point.frequency_hz)
        assert float(found.damping) == pytest.approx(point.damping, rel=1e-7)
        assert float(found.stiffness) == pytest.approx(point.stiffness, rel=1e-7)


@pytest.mark.parametrize("n", [5, 10])
def test_a_faster_loop_gains_stiffness_as_it_shortens_the_hold(n: int) -> None:
    """K_CR = 2 b / T of a rigid device (Colgate and Schenkel's line): n times from T to T / n.

    5 %: b T / 2 m is not nothing. Mutation: `position_ticks` ignored in `given`.
    """
    device = one_mass(1e-2, 5e-3).with_interface(period=T / n, delay=0.0)
    fast = critical_stiffness(device, 0.0).stiffness
    slow = critical_stiffness(device.with_interface(position_ticks=n), 0.0).stiffness
    assert fast is not None
    assert slow is not None
    assert slow == pytest.approx(2.0 * 5e-3 / T, rel=0.05)
    assert fast / slow == pytest.approx(n, rel=0.05)
    (bracket,) = find_brackets(
        [device.with_interface(position_ticks=n)], [np.zeros(1)], Trial(), Search(ratio=1.5)
    )[0]
    assert bracket.stable is not None
    assert bracket.unstable is not None
    assert bracket.stable <= slow * 1.001
    assert bracket.unstable >= slow * 0.999


@pytest.mark.parametrize(("velocity", "position"), [(1, 5), (5, 1)])
def test_brackets_of_several_rates_close_on_the_theory(velocity: int, position: int) -> None:
    """0.2 % at three dampings. Mutation: `velocity_ticks` left out of `rate`."""
    device = phantom().with_interface(
        period=2e-4, delay=0.001, velocity_ticks=velocity, position_ticks=position
    )
    dampings = np.array([0.0, 0.02, 0.05])
    theory = boundary(device, dampings.tolist())
    brackets = find_brackets([device], [dampings])[0]
    for point, bracket in zip(theory, brackets, strict=True):
        assert point.stiffness is not None
        assert bracket.stable is not None
        assert bracket.unstable is not None
        assert bracket.stable < point.stiffness * 1.002
        assert bracket.unstable > point.stiffness * 0.998
        assert bracket.frequency == pytest.approx(point.frequency_hz, rel=0.02)


def test_what_takes_one_rate_says_so() -> None:
    device = phantom().with_interface(velocity_ticks=2)
    for refuse in (open_loop, lambda d: passive_boundary(d, [0.0])):  # pyright: ignore
        with pytest.raises(ValueError, match="takes only one rate"):
            refuse(device)


def test_the_device_file_has_them() -> None:
    """Round trip; a device without them has the text that it had."""
    device = second(80.0, velocity_ticks=4, position_ticks=10)
    text = device_to_text(device)
    assert device_from_text(text).interface == device.interface
    assert "velocity_order" not in device_to_text(phantom())
    with pytest.raises(ValueError, match=r"velocity_ticks is 1\.5; it must be a whole number"):
        device_from_text(text.replace("velocity_ticks = 4.0", "velocity_ticks = 1.5"))
    with pytest.raises(ValueError, match="velocity_order is 3; it must be 1 or 2"):
        Interface(velocity_order=3)

"""The linear boundary against check values, closed forms and three independent witnesses."""

import warnings

import control
import numpy as np
import pytest
from numpy.typing import NDArray

from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.interface import Interface
from zwidth.sim.loop import open_loop
from zwidth.sim.physics.actuator_lag import actuator_lag
from zwidth.sim.physics.effect import Physics
from zwidth.stability import linear
from zwidth.stability.crossings import crossings
from zwidth.stability.decomposition import curve
from zwidth.stability.linear import (
    boundary,
    corner,
    critical_stiffness,
    last_stable_damping,
    stable_dampings,
)
from zwidth.stability.types import LinearPoint

PHANTOM = load_device("phantom_1_0")


def stable_bands(device: Device, damping: float) -> list[tuple[float, float]]:
    """Return all intervals (from, to) of K > 0 that are stable at B; the first may begin at 0."""
    loop = open_loop(device)
    found = linear._crossings(loop, damping)
    stable = [linear._begins_stable(loop, damping, found)]
    stable += [linear._stable(loop.closed(k, damping)) for k in linear._between(found.gains)[1:]]
    return linear._joined(found.gains, stable)


def phantom(delay_ms: float) -> Device:
    return PHANTOM.with_interface(delay=1e-3 * delay_ms)


def one_mass(m: float, b: float, k0: float = 0.0, delay: float = 0.0, lag: float = 0.0) -> Device:
    physics = (Physics(actuator_lag, "command", {"time_constant": lag}),) if lag else ()
    chain = make_chain([m], [b], k0)
    return Device("one mass", "test", False, chain, Interface(delay=delay), physics)


def radius(device: Device, stiffness: float, damping: float) -> float:
    eigenvalues = np.linalg.eigvals(open_loop(device).closed(stiffness, damping))
    return float(np.abs(eigenvalues).max())


def found(point: LinearPoint) -> tuple[float, float]:
    assert point.stiffness is not None
    assert point.frequency_hz is not None
    return point.stiffness, point.frequency_hz


def printed(value: float, text: str) -> bool:
    """Is the value within one unit of the last digit printed?"""
    return abs(value - float(text)) <= 10.0 ** -len(text.partition(".")[2])


@pytest.mark.parametrize(
    ("delay_ms", "damping", "stiffness", "frequency"),
    [
        (2, 0.0, "2.501", "7.31"),
        (2, 0.03, "14.98", "17.88"),
        (2, 0.05, "22.996", "22.12"),
        (2, 0.08, "34.651", "27.05"),
        (4, 0.0, "1.350", "5.37"),
        (4, 0.15, "27.637", "27.40"),
        (4, 0.2, "33.02", "31.30"),
        (4, 0.23, "29.69", "259.8"),
        (4, 0.23, "29.690", "259.8"),
        (8, 0.0, "0.70484", "3.86"),
        (8, 0.08, "7.857", "15.33"),
        (8, 0.1, "8.807", "17.18"),
    ],
)
def test_check_values(delay_ms: float, damping: float, stiffness: str, frequency: str) -> None:
    """Points computed independently of this code, to their printed digits.

    Mutation: one tick of delay more or less, or a forward difference for the velocity.
    """
    k, f = found(critical_stiffness(phantom(delay_ms), damping))
    assert printed(k, stiffness)
    assert printed(f, frequency)


@pytest.mark.parametrize(
    ("delay_ms", "damping", "stiffness", "below", "above", "last"),
    [
        (2, "0.085465", "36.7347", "27.834", "170.95", "0.099678"),
        (4, "0.226191", "35.2355", "33.107", "259.48", "0.249767"),
        (8, "0.102381", "8.8943", "17.390", "171.62", "0.105691"),
    ],
)
def test_corner_and_last_damping(
    delay_ms: float, damping: str, stiffness: str, below: str, above: str, last: str
) -> None:
    """B_t, K_max, both frequencies and the end of the stable dampings, to their printed digits.

    Mutation: the corner at the best grid point instead of the meeting of the branches.
    """
    top = corner(phantom(delay_ms))
    end = last_stable_damping(phantom(delay_ms))
    assert top is not None
    assert end is not None
    assert printed(top.damping, damping)
    assert printed(top.stiffness, stiffness)
    assert printed(top.frequency_below_hz, below)
    assert printed(top.frequency_above_hz, above)
    assert printed(end, last)


@pytest.mark.parametrize("delay_ms", [2, 4, 8])
def test_no_stable_stiffness_above_the_last_damping(delay_ms: float) -> None:
    """Beyond it no K is stable, however large or small, although crossings are still there.

    Mutation: answering with the first crossing, as a margin routine does.
    """
    device = phantom(delay_ms)
    end = last_stable_damping(device)
    assert end is not None
    assert critical_stiffness(device, 0.999999 * end).stable
    loop = open_loop(device)
    for damping in (1.000001 * end, 1.1 * end, 2.0 * end):
        assert critical_stiffness(device, damping) == LinearPoint(damping, None, None, None)
        assert stable_bands(device, damping) == []
        assert crossings(loop.damped(damping), loop.entry, loop.reading).gains.size > 0
        assert all(radius(device, k, damping) > 1.0 for k in np.geomspace(1e-3, 300.0, 100))


@pytest.mark.parametrize("delay_ms", [2, 4, 8, 2.37])
def test_decomposition_agrees(delay_ms: float) -> None:
    """Eq. (1) on the unit circle gives the same (B, K) to 1e-8, from partial fractions alone.

    Mutation: exp(p r) in place of exp(p (T - r)) in the witness; a chain rounded to ten digits.
    """
    device = phantom(delay_ms)
    end = last_stable_damping(device)
    assert end is not None
    dampings = np.linspace(0.0, 0.99999 * end, 60)
    points = np.array([found(p) for p in boundary(device, dampings)])
    witness = curve(device, points[:, 1])
    np.testing.assert_allclose(witness.damping, dampings, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(witness.stiffness, points[:, 0], rtol=0.0, atol=1e-8)


def lowest_on_curve(device: Device, damping: float) -> float:
    """Smallest K > 0 on the D-decomposition curve at B, from a fine grid of frequencies."""
    f = np.linspace(0.05, 499.95, 60_000)
    b, k = curve(device, f)
    i = np.flatnonzero((b[1:] - damping) * (b[:-1] - damping) < 0.0)
    share = (damping - b[i]) / (b[i + 1] - b[i])
    crossing = k[i] + share * (k[i + 1] - k[i])
    return float(crossing[crossing > 0.0].min())


@pytest.mark.parametrize("delay_ms", [2, 4, 8])
def test_no_crossing_comes_earlier(delay_ms: float) -> None:
    """The lowest K of the D-decomposition curve at B is K_CR, on both parts of the boundary.

    Mutation: NEAR_CIRCLE = 1e-15, which loses crossings to rounding.
    """
    device = phantom(delay_ms)
    end = last_stable_damping(device)
    assert end is not None
    for damping in np.linspace(0.01, 0.999, 12) * end:
        k, _ = found(critical_stiffness(device, damping))
        assert k == pytest.approx(lowest_on_curve(device, damping), rel=1e-5, abs=5e-5)


@pytest.mark.parametrize(
    ("delay_ms", "dampings"), [(2, (0.0, 0.03, 0.08)), (4, (0.0, 0.15, 0.2)), (8, (0.0, 0.1))]
)
def test_margin_is_a_witness_below_the_corner(delay_ms: float, dampings: list[float]) -> None:
    """python-control's gain margin agrees where the first crossing is the boundary."""
    device = phantom(delay_ms)
    for damping in dampings:
        k, f = found(critical_stiffness(device, damping))
        gain, rate = margin(device, damping)
        assert gain == pytest.approx(k, rel=1e-7)
        assert rate == pytest.approx(2.0 * np.pi * f, rel=1e-7)


def test_margin_is_no_witness_beyond_it() -> None:
    """At 4 ms, B = 0.23 a margin routine prints a K that is no boundary; the true one is 29.690."""
    device = phantom(4)
    gain, _ = margin(device, 0.23)
    assert abs(gain - 29.690) > 0.5
    assert radius(device, 29.690, 0.23) < 1.0 < radius(device, 29.691, 0.23)


def margin(device: Device, damping: float) -> tuple[float, float]:
    loop = open_loop(device)
    system = control.ss(
        loop.damped(damping), loop.entry[:, None], loop.reading[None, :], 0.0, loop.period
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        gain, _, rate, _ = control.margin(system)
    return float(gain), float(rate)


@pytest.mark.parametrize("ticks", [0.0, 0.4, 1.0, 3.5, 8.0])
def test_one_mass_first_order_law(ticks: float) -> None:
    """Gil, Hulin: K < (b + B)/tau, w = sqrt(b/(m tau)), tau = T/2 + t_d, for b tau/m <= 0.02.

    Within 0.998 to 1.004 (1.007 for delays under one tick) and 0.4 %. Mutation: tau = T + t_d.
    """
    tau = 0.0005 + 0.001 * ticks
    for share in (0.002, 0.01, 0.02):
        b = share / tau
        k, f = found(critical_stiffness(one_mass(1.0, b, delay=0.001 * ticks), 0.0))
        assert 0.998 < k * tau / b < (1.004 if ticks >= 1.0 else 1.007)
        assert 2.0 * np.pi * f == pytest.approx(np.sqrt(b / tau), rel=4e-3)
        # A virtual damper adds to b until it is itself a matter of delay.
        k, _ = found(critical_stiffness(one_mass(1.0, b, delay=0.001 * ticks), 0.3 * b))
        assert k * tau / (1.3 * b) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("lag", [0.0005, 0.002])
def test_a_lag_counts_as_delay(lag: float) -> None:
    """An actuator's lag acts on K_CR as the same time of delay, within 0.8 %.

    Mutation: leaving the lag out of the plant.
    """
    tau = 0.0005 + 0.002 + lag
    for share in (0.002, 0.01, 0.02):
        k, _ = found(critical_stiffness(one_mass(1.0, share / tau, delay=0.002, lag=lag), 0.0))
        assert k * tau**2 / share == pytest.approx(1.0, abs=8e-3)


@pytest.mark.parametrize("b", [1e-1, 1e-3, 1e-5])
def test_tiny_damping_is_resolved(b: float) -> None:
    """K_CR = b/(T/2) holds down to b T/m = 1e-8."""
    k, f = found(critical_stiffness(one_mass(1.0, b), 0.0))
    assert k == pytest.approx(b / 0.0005, rel=1e-4)
    assert 2.0 * np.pi * f == pytest.approx(np.sqrt(b / 0.0005), rel=1e-3)


def test_without_damping_no_wall_is_stable() -> None:
    """b = 0, B = 0: every K diverges by the hold's delay; a little B gives a stable K again."""
    device = one_mass(1.0, 0.0)
    assert not critical_stiffness(device, 0.0).stable
    assert stable_bands(device, 0.0) == []
    k, _ = found(critical_stiffness(device, 0.1))
    assert k == pytest.approx(0.1 / 0.0005, rel=1e-3)
    assert stable_dampings(device)[0][0] == 0.0
    assert not critical_stiffness(one_mass(1.0, 0.0, k0=50.0, delay=0.002), 0.0).stable


@pytest.mark.parametrize("delay", [0.0, 0.0003, 0.001, 0.0085])
def test_links_damped_but_not_the_whole(delay: float) -> None:
    """Link dampers do not hold a free chain: no K is stable at B = 0, and none is invented.

    Mutation: keeping the zeros that the double eigenvalue 1 scatters (NEAR_ONE = 1e-9).
    """
    for masses in ([0.02, 0.004], [0.53, 0.19], [1.0, 2.0, 0.3]):
        links = [100.0 * m / delay if delay else 900.0 for m in masses[1:]]
        chain = make_chain(masses, np.zeros(len(masses)), 0.0, links, np.full(len(links), 0.3))
        device = Device("free", "test", False, chain, Interface(delay=delay))
        assert not critical_stiffness(device, 0.0).stable
        for low, high in stable_bands(device, 0.0):
            assert radius(device, 0.5 * (low + high), 0.0) < 1.0
            assert low > 1e-3
        assert critical_stiffness(device, 0.01).stable


def test_negative_damping_needs_a_virtual_damper() -> None:
    """b = -1: stable from B = 1 on, within rounding. Mutation: no crossing at z = 1."""
    ((low, high),) = stable_dampings(one_mass(1.0, -1.0))
    assert low == pytest.approx(1.0, rel=1e-9)
    assert high > 100.0
    assert not critical_stiffness(one_mass(1.0, -1.0), 0.999).stable
    assert critical_stiffness(one_mass(1.0, -1.0), 1.001).stable


@pytest.mark.parametrize("b", [2.0, 0.02, 2e-5])
def test_the_first_order_law_with_a_ground_spring(b: float) -> None:
    """K tau < b whatever k0, at sqrt((k0 + K)/m), for k0 tau^2 << m; down to b T/m = 2e-8.

    Mutation: NEAR_POLE = 1e-6, which takes the crossing of the light damping for rounding.
    """
    k, f = found(critical_stiffness(one_mass(1.0, b, k0=1000.0, delay=0.001), 0.0))
    tau = 0.0015
    assert k * tau == pytest.approx(b, rel=5e-3)
    assert 2.0 * np.pi * f == pytest.approx(np.sqrt(1000.0 + k), rel=2e-3)


def test_last_damping_of_a_mass_in_closed_form() -> None:
    """A mass without friction or delay allows B < 2 m/T, where an eigenvalue meets the circle.

    At K = 0, h = B T/m, the velocity v obeys v+ = v - h (y - y-)/T, y - y- = T (v + v-)/2:
    z^2 - z (1 - h/2) + h/2, whose product of roots is 1 at h = 2.
    """
    device = one_mass(2.0, 0.0)
    end = last_stable_damping(device)
    assert end is not None
    eigenvalues = np.linalg.eigvals(open_loop(device).without_drift().damped(end))
    assert np.abs(eigenvalues).max() == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(end * 0.001 / 2.0, 2.0, rtol=1e-12)


def with_a_fold() -> Device:
    """Two lightly damped modes whose branch turns back in B at a K below the main boundary."""
    masses = np.array([1e-3, 0.47e-3, 0.35e-3])
    rates = np.array([1430.0, 150.0])
    springs = rates**2 * masses[1:] / np.array([1.47, 1.35])
    dampers = 2.0 * np.array([2.2e-3, 0.047]) * springs / rates
    chain = make_chain(masses, [5e-3, 0.0, 0.0], 0.0, springs, dampers)
    return Device("fold", "test", True, chain, Interface(delay=0.0005))


@pytest.mark.parametrize("width", [1e-6, 1e-9])
def test_a_narrow_unstable_band_is_found(width: float) -> None:
    """On one side of a fold a band of K opens in which the loop is unstable, however narrow.

    There K_CR drops to the band's lower edge; the band is far narrower than any grid of K.
    Mutation: only the first two crossings, or candidates taken within 1e-12 of the circle.
    """
    device = with_a_fold()
    f = np.linspace(15.0, 16.5, 150_001)
    b, k = curve(device, f)
    top = int(np.argmax(b))
    inside, outside, turn = b[top] * (1.0 - width), b[top] * (1.0 + width), k[top]
    bands = stable_bands(device, inside)
    assert len(bands) >= 2
    assert 0.0 < bands[1][0] / bands[0][1] - 1.0 < 20.0 * np.sqrt(width)
    stiffness, frequency = found(critical_stiffness(device, inside))
    assert stiffness == bands[0][1] == pytest.approx(turn, rel=10.0 * np.sqrt(width))
    assert frequency == pytest.approx(f[top], rel=10.0 * np.sqrt(width))
    assert found(critical_stiffness(device, outside))[0] > 1.2 * turn


def random_device(rng: np.random.Generator, scale: float = 1.0) -> Device:
    n = int(rng.integers(1, 5))
    period = 10.0 ** rng.uniform(-4.0, -2.5)
    rates = 10.0 ** rng.uniform(1.0, np.log10(6.0 / period), n - 1)
    masses = scale * 10.0 ** rng.uniform(-1.0, 1.0, n) * 10.0 ** rng.uniform(-4.0, 1.0)
    springs = masses[:-1] * rates**2
    dampers = 2.0 * 10.0 ** rng.uniform(-3.0, -0.3, n - 1) * springs / rates
    ground = 10.0 ** rng.uniform(-3.0, 1.0, n) * masses.sum()
    k0 = 0.0 if rng.random() < 0.7 else float(masses.sum()) * 10.0 ** rng.uniform(0.0, 5.0)
    interface = Interface(
        period=period,
        delay=period * float(rng.choice([0.0, 0.3, 1.0, 1.7, 2.0, 5.5, 13.0])),
        velocity_cutoff_hz=float(rng.choice([np.inf, 0.05, 0.5])) / period,
    )
    return Device(
        "random", "test", True, make_chain(masses, ground, k0, springs, dampers), interface
    )


def test_random_devices_agree_with_the_witness() -> None:
    """D-decomposition from the chain's eigenvectors, masses from 1e-11 to 1e6: within 2e-9.

    Mutation: no balancing (wrong by more than 1), no Newton step (1e-8).
    """
    rng = np.random.default_rng(3)
    compared = 0
    for scale in (1e-6, 1.0, 1e4):
        for _ in range(25):
            device = random_device(rng, scale)
            end = last_stable_damping(device)
            assert end is not None
            for damping in (0.0, 0.5 * end):
                k, f = found(critical_stiffness(device, damping))
                if f > 0.4999 / device.interface.period:
                    continue  # z = -1 is not on the curve
                witness = curve(device, f)
                assert float(witness.stiffness) == pytest.approx(k, rel=2e-9)
                assert float(witness.damping) == pytest.approx(damping, abs=2e-9 * end)
                compared += 1
    assert compared > 100


def sampled_stiffness(point: LinearPoint, device: Device) -> NDArray[np.float64]:
    if point.stiffness is None:
        scale = float(device.chain.masses.sum()) / device.interface.period**2
        return np.geomspace(1e-6, 10.0, 25).astype(np.float64) * scale
    shares = np.concatenate([np.geomspace(1e-4, 0.9999999, 12), np.geomspace(1.0000001, 30.0, 12)])
    return shares * point.stiffness


def test_random_devices_are_stable_where_it_says() -> None:
    """40 devices, 1 to 4 masses, fractional delays, filters, ground springs: bands are true.

    Mutation: dropping the crossings at real z.
    """
    rng = np.random.default_rng(20)
    checked = 0
    for _ in range(40):
        device = random_device(rng)
        end = last_stable_damping(device)
        assert end is not None
        for damping in (0.0, 0.5 * end, 1.1 * end):
            point = critical_stiffness(device, damping)
            bands = stable_bands(device, damping)
            assert (bands[0][1] if point.stable else None) == point.stiffness
            assert point.departure is None or point.departure > 0.0
            for k in sampled_stiffness(point, device):
                excess = radius(device, k, damping) - 1.0
                inside = any(low < k < high for low, high in bands)
                assert inside == (excess < 0.0) or abs(excess) < 1e-11
                checked += 1
    assert checked > 2500


def test_growth_beyond_the_boundary() -> None:
    """At 2 ms and B = 0 the motion at K + 0.1 % grows at 2.4e-3 per second.

    Mutation: the departure per tick instead of per second.
    """
    point = critical_stiffness(phantom(2), 0.0)
    assert point.stiffness is not None
    assert point.departure is not None
    assert 1e-3 * point.stiffness * point.departure == pytest.approx(2.4e-3, abs=5e-5)
    step = 1e-3 * point.stiffness
    exact = np.log(radius(phantom(2), point.stiffness + step, 0.0)) / 0.001
    assert step * point.departure == pytest.approx(exact, rel=2e-3)


def test_a_long_delay_is_served() -> None:
    """100 ticks: the first-order law still holds at B = 0."""
    k, _ = found(critical_stiffness(one_mass(1.0, 0.1, delay=0.1), 0.0))
    assert k == pytest.approx(0.1 / 0.1005, rel=5e-3)


def test_bad_input_is_named() -> None:
    with pytest.raises(ValueError, match="damping is nan; only finite numbers are allowed"):
        critical_stiffness(PHANTOM, np.nan)
    with pytest.raises(ValueError, match="frequency_hz must lie between 0 and 500 Hz"):
        curve(PHANTOM, [0.0, 10.0])
    with pytest.raises(ValueError, match="two equal poles"):
        curve(one_mass(1.0, 0.0), 10.0)


def test_the_closed_form_refuses_several_rates() -> None:
    """Mutation that breaks it: curves of one rate, said of two."""
    device = load_device("phantom_1_0").with_interface(position_ticks=10)
    with pytest.raises(ValueError, match="takes only one rate"):
        curve(device, [50.0])

"""Effects on the command, the clock and the sensor, tick by tick against their formulas."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from physics_examples import example, phantom
from scipy.stats import chi2, kstest

from zwidth.controllers.recorded import recorded
from zwidth.controllers.wall import wall
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.dead_band import beyond_band
from zwidth.sim.physics.dropped_samples import uniform
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.gain_asymmetry import two_gains
from zwidth.sim.run import Run, Start, simulate

WANTED = 0.05 * np.random.default_rng(2).normal(size=300)


def _play(*physics: Physics, seed: int = 0) -> Run:
    device = phantom().with_physics(*physics)
    return simulate(device, recorded(WANTED), duration=0.3, seed=seed)


def test_a_dead_band_takes_half_its_width_from_either_side() -> None:
    """Mutation: width for half the width; or a band that jumps at its edge."""
    command = _play(make_physics("dead_band", "command", width=0.04)).trace["command"]
    expected = np.sign(WANTED) * np.maximum(np.abs(WANTED) - 0.02, 0.0)
    np.testing.assert_allclose(command, expected, rtol=0.0, atol=1e-17)
    assert np.count_nonzero(command == 0.0) > 50


def test_gain_asymmetry_has_its_ratio_and_a_mean_of_one() -> None:
    """Mutation: the ratio upside down, or gains r and 1."""
    command = _play(make_physics("gain_asymmetry", "command", ratio=1.5)).trace["command"]
    gain = command / WANTED
    assert np.unique(gain[WANTED > 0.0]) == pytest.approx(1.2, rel=1e-14)
    assert np.unique(gain[WANTED < 0.0]) == pytest.approx(0.8, rel=1e-14)


def _describing_function(law: Callable[[float], float], amplitude: float) -> float:
    phase = (np.arange(20000) + 0.5) * (2.0 * np.pi / 20000)
    output = np.array([law(amplitude * s) for s in np.sin(phase)])
    return float(2.0 / amplitude * np.mean(output * np.sin(phase)))


def test_describing_functions_of_band_and_gains() -> None:
    """Dead zone d = width / 2: 1 - (2/pi)(asin(d/A) + (d/A) sqrt(1 - (d/A)^2)); two gains: 1."""
    width = np.array([0.04])
    for amplitude in (0.021, 0.05, 1.0):
        d = 0.02 / amplitude
        closed = 1.0 - 2.0 / math.pi * (math.asin(d) + d * math.sqrt(1.0 - d * d))
        found = _describing_function(lambda u: beyond_band(u, width), amplitude)
        assert found == pytest.approx(closed, abs=1e-6)
    ratio = np.array([1.7])
    assert _describing_function(lambda u: two_gains(u, ratio), 0.3) == pytest.approx(1.0, rel=1e-9)


def test_amplifier_effects_act_between_step_and_limit_in_their_order() -> None:
    """Step, then band, then gain, then limit. Mutation: the limit before the band."""
    band = make_physics("dead_band", "command", width=0.02)
    gains = make_physics("gain_asymmetry", "command", ratio=1.5)
    ends = (
        make_physics("command_step", "command", step=4e-3),
        make_physics("saturation", "command", limit=0.05),
    )
    stepped = np.sign(WANTED) * np.floor(np.abs(WANTED) / 4e-3 + 0.5) * 4e-3

    def banded(u: np.ndarray) -> np.ndarray:
        return np.sign(u) * np.maximum(np.abs(u) - 0.01, 0.0)

    def amplified(u: np.ndarray) -> np.ndarray:
        return u * np.where(u > 0.0, 1.2, 0.8)

    for order, expected in (
        ((band, gains), amplified(banded(stepped))),
        ((gains, band), banded(amplified(stepped))),
    ):
        command = _play(*order, *ends).trace["command"]
        np.testing.assert_allclose(command, np.clip(expected, -0.05, 0.05), rtol=0.0, atol=1e-16)


def test_a_dropped_tick_holds_the_command_before() -> None:
    """Mutation: zero instead of the earlier command."""
    command = _play(make_physics("dropped_samples", "clock", rate=0.2), seed=11).trace["command"]
    dropped = command != WANTED
    assert 30 < np.count_nonzero(dropped) < 90
    expected, held = np.zeros(300), 0.0
    for k in range(300):
        held = held if dropped[k] else WANTED[k]
        expected[k] = held
    assert np.array_equal(command, expected)


def test_drops_depend_on_seed_and_tick_alone() -> None:
    """The same seed gives the same run, another one another; other physics do not matter."""
    physics = make_physics("dropped_samples", "clock", rate=0.2)
    one, again, other = (_play(physics, seed=s).trace["command"] for s in (5, 5, 6))
    assert np.array_equal(one, again)
    assert not np.array_equal(one, other)
    beside = _play(physics, example("quadratic_drag"), seed=5).trace["command"]
    assert np.array_equal(one, beside)
    high = [_play(physics, seed=s).trace["command"] for s in (5 + 2**32, 2**64 - 1)]
    assert not np.array_equal(one, high[0])
    assert not np.array_equal(high[0], high[1])
    never, always = (make_physics("dropped_samples", "clock", rate=r) for r in (0.0, 1.0))
    assert np.array_equal(_play(never).trace["command"], WANTED)
    assert not _play(always).trace["command"].any()


def test_ticks_are_lost_independently_and_evenly() -> None:
    """Uniform (Kolmogorov-Smirnov), neighbours in tick and in seed uncorrelated (4 sigma), and
    gaps geometric (chi squared), p > 1e-3. Mutation: `scrambled` without its two products.
    """
    ticks = 20000
    table = np.array([[uniform(float(s), 0.0, k) for k in range(ticks)] for s in range(4)])
    for row in table:
        assert kstest(row, "uniform").pvalue > 1e-3
    centred = table - 0.5
    bound = 4.0 / (12.0 * math.sqrt(ticks))
    for lag in (1, 2, 3, 16):
        assert np.all(np.abs(np.mean(centred[:, lag:] * centred[:, :-lag], axis=1)) < bound)
    for i in range(3):
        assert abs(np.mean(centred[i] * centred[i + 1])) < bound
    gaps = np.diff(np.flatnonzero(table[0] < 0.1))
    share = 0.1 * 0.9 ** np.arange(20)
    expected = gaps.size * np.append(share, 0.9**20)
    found = np.bincount(np.minimum(gaps, 21), minlength=22)[1:]
    assert chi2.sf(((found - expected) ** 2 / expected).sum(), 20) > 1e-3


def test_every_bit_of_a_tick_changes_half_of_the_bits_of_its_fate() -> None:
    """Avalanche: 1/2 within 5 sigma. Mutation: `scrambled` without its products."""
    ticks, words = np.random.default_rng(6).integers(0, 2**32, 1000), np.uint64(2**32)

    def bits(changed: np.ndarray) -> np.ndarray:
        values = [int(uniform(3.0, 0.0, int(k)) * words) for k in changed]
        return np.array(values)[:, None] >> np.arange(32) & 1

    plain = bits(ticks)
    for flipped in range(32):
        share = np.mean(plain != bits(ticks ^ (1 << flipped)), axis=0)
        assert np.all(np.abs(share - 0.5) < 5.0 * 0.5 / math.sqrt(1000))


def test_an_eccentric_encoder_reads_by_its_formula_before_its_step() -> None:
    """Mutation: the step before the eccentricity."""
    values = {"amplitude": 3e-4, "period": 0.004, "phase": 1.0}
    off_centre = make_physics("encoder_eccentricity", "sensor", **values)
    for step in (0.0, 1e-4):
        device = phantom().with_physics(off_centre).with_interface(encoder_step=step)
        run = simulate(device, wall(5.0, 0.01), duration=0.3, start=Start(0.0, 0.2))
        q = run.trace["position_m1"]
        expected = q + 3e-4 * np.sin(2.0 * np.pi * q / 0.004 + 1.0)
        if step:
            expected = np.sign(expected) * np.floor(np.abs(expected) / step + 0.5) * step
        assert np.ptp(q) > 0.004
        np.testing.assert_allclose(run.trace["encoder"], expected, rtol=0.0, atol=1e-15)


def test_a_rectified_sensor_reads_the_magnitude() -> None:
    """|q| always; where q >= 0 nothing changes, bit for bit."""
    device = phantom().with_physics(make_physics("rectified_sensor", "sensor"))
    run = simulate(device, wall(0.0, 0.0), duration=0.3, start=Start(0.01, -0.1))
    q = run.trace["position_m1"]
    assert q[-1] < 0.0
    assert np.array_equal(run.trace["encoder"], np.abs(q))
    runs = [
        simulate(d, wall(5.0, 0.01, 0.02), duration=0.1, start=Start(0.03))
        for d in (device, phantom())
    ]
    assert runs[0].trace["position_m1"].min() > 0.0
    for channel, values in runs[0].trace.channels.items():
        assert np.array_equal(values, runs[1].trace.channels[channel])

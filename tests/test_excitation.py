"""Test signals are what their names say, line by line of the spectrum."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import hilbert

from zwidth.controllers.excitation import SIGNALS, chirp, multisine, noise, random_steps, triangle

Floats = NDArray[np.float64]


def lines(signal: Floats) -> tuple[Floats, Floats]:
    """Amplitude of each harmonic of the whole signal, and its frequency in Hz at 1 kHz."""
    frequency = np.arange(signal.size // 2 + 1, dtype=np.float64) / (0.001 * signal.size)
    return 2.0 * np.abs(np.fft.rfft(signal)) / signal.size, frequency


def test_noise_has_the_papers_band_and_nothing_outside():
    """Mutation: `inside` left out of `noise` fills the band up to 500 Hz."""
    amplitude, f = lines(noise())
    inside = (f >= 0.7) & (f <= 300.0)
    assert noise().size == 30_000
    assert amplitude[~inside].max() < 1e-15
    assert np.mean(amplitude[inside] > 1e-6) > 0.99


@pytest.mark.parametrize("signal", [noise, multisine])
def test_random_signals_have_the_rms_asked_for_and_come_from_their_seed(
    signal: Callable[..., Floats],
) -> None:
    """Mutation: a seed that is ignored makes the two signals equal."""
    first, again, other = signal(rms=0.2, seed=1), signal(rms=0.2, seed=1), signal(rms=0.2, seed=2)
    assert np.sqrt(np.mean(first**2)) == pytest.approx(0.2, rel=1e-12)
    np.testing.assert_array_equal(first, again)
    assert abs(np.corrcoef(first, other)[0, 1]) < 0.05


def test_noise_is_gaussian_and_white():
    """Kurtosis 3 and equal power in equal bands. Mutation: constant amplitudes in `noise`."""
    signal = noise(seed=3)
    power = lines(signal)[0] ** 2
    bands = power[30:9000].reshape(10, -1).mean(axis=1)
    assert np.mean(signal**4) / np.mean(signal**2) ** 2 == pytest.approx(3.0, abs=0.1)
    assert bands.max() / bands.min() < 1.25
    assert np.std(power[30:9000]) == pytest.approx(np.mean(power[30:9000]), rel=0.1)


def test_multisine_lines_are_equal_and_repeats_repeat():
    """Mutation: repeats that do not tile change the second period."""
    signal = multisine(repeats=3)
    one = signal[:10_000]
    amplitude, f = lines(one)
    inside = (f >= 0.7) & (f <= 300.0)
    np.testing.assert_array_equal(signal[10_000:20_000], one)
    assert np.ptp(amplitude[inside]) < 1e-15
    assert amplitude[~inside].max() < 1e-15


def test_odd_multisine_has_no_even_line():
    """Mutation: `chosen[1::2]` leaves the even ones."""
    amplitude, _ = lines(multisine(lines="odd"))
    assert amplitude[::2].max() < 1e-15
    assert np.all(amplitude[21:9000:2] > 1e-4)


def test_chirp_rises_exponentially_from_end_to_end():
    """ln f is a line from 0.7 to 300 Hz. Mutation: method="linear"."""
    signal = chirp(amplitude=0.3)
    t = np.arange(signal.size) * 0.001
    frequency = np.gradient(np.unwrap(np.angle(hilbert(signal)))) / (2.0 * np.pi * 0.001)
    expected = 0.7 * (300.0 / 0.7) ** (t / 30.0)
    middle = (t > 8.0) & (t < 28.0)
    assert np.abs(frequency / expected - 1.0)[middle].max() < 0.03
    assert signal[0] == pytest.approx(0.0, abs=1e-12)
    assert np.abs(signal).max() == pytest.approx(0.3, rel=1e-3)


def test_random_steps_hold_their_levels():
    """Mutation: hold_s that is ignored changes the level every tick."""
    signal = random_steps(amplitude=0.2, hold_s=0.25)
    levels = signal.reshape(-1, 250)
    assert np.ptp(levels, axis=1).max() == 0.0
    assert np.abs(levels).max() <= 0.2
    assert np.unique(levels[:, 0]).size == 120


def test_triangle_is_slow_even_and_begins_at_zero_rising():
    """Mutation: without the quarter period it begins at its minimum."""
    signal = triangle(amplitude=0.05, cycle_s=4.0, duration=8.0)
    assert signal[0] == pytest.approx(0.0, abs=1e-15)
    assert signal[1000] == pytest.approx(0.05)
    assert signal[3000] == pytest.approx(-0.05)
    slopes = np.abs(np.diff(signal))
    np.testing.assert_allclose(np.delete(slopes, [999, 2999, 4999, 6999]), 5e-5, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "bad", "says"),
    [
        ("noise", {"rms": 0.0}, "amplitude is 0.0; it must be finite and > 0"),
        ("noise", {"to_hz": 600.0}, r"500 Hz \(half the sampling rate\)"),
        ("noise", {"from_hz": 300.0, "to_hz": 0.7}, "the band must begin above 0"),
        ("noise", {"duration": 0.001}, "at least two ticks"),
        ("noise", {"duration": 0.1, "from_hz": 1.0, "to_hz": 2.0}, "lengthen the signal"),
        ("multisine", {"repeats": 0}, "repeats is 0"),
        ("multisine", {"lines": "even"}, "'full' or 'odd'"),
        ("chirp", {"from_hz": 0.0}, "above 0"),
        ("random_steps", {"hold_s": np.inf}, "duration is inf"),
        ("triangle", {"cycle_s": np.nan}, "duration is nan"),
    ],
)
def test_a_signal_that_cannot_be_says_what_is_allowed(
    name: str, bad: dict[str, Any], says: str
) -> None:
    with pytest.raises(ValueError, match=says):
        SIGNALS[name](**bad)

"""Test signals for identification, one command per tick, played by `controllers.recorded`.

Defaults are the paper's: 0.7 to 300 Hz over 30 s at 1 kHz. Amplitudes are in the command's unit
[N m | N]. All random signals come from a seed.
"""

from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.signal import chirp as swept_cosine
from scipy.signal import sawtooth

Floats = NDArray[np.float64]
Lines = Literal["full", "odd"]


def noise(
    rms: float = 0.15,
    from_hz: float = 0.7,
    to_hz: float = 300.0,
    duration: float = 30.0,
    period: float = 0.001,
    seed: int = 0,
) -> Floats:
    """Return Gaussian noise, white between two frequencies and zero outside.

    Raises ValueError (field, value, what is allowed), as all signals here do.
    """
    ticks = _ticks(rms, duration, period)
    inside = _band(ticks, from_hz, to_hz, period)
    rng = np.random.default_rng(seed)
    spectrum = rng.standard_normal((2, inside.size)) * inside
    signal = np.fft.irfft(spectrum[0] + 1j * spectrum[1], ticks)
    return rms * signal / np.sqrt(np.mean(signal**2))


def multisine(
    rms: float = 0.15,
    from_hz: float = 0.7,
    to_hz: float = 300.0,
    duration: float = 30.0,
    period: float = 0.001,
    seed: int = 0,
    repeats: int = 1,
    lines: Lines = "full",
) -> Floats:
    """Return a sum of sines of equal amplitude and random phase, repeated a number of times.

    lines: all harmonics of duration / repeats ("full"), or the odd ones only ("odd"), in which case
    even nonlinearities show between them.
    """
    if repeats < 1:
        raise ValueError(f"repeats is {repeats}; a multisine is played at least once")
    if lines not in ("full", "odd"):
        raise ValueError(f"lines is {lines!r}; it must be 'full' or 'odd'")
    ticks = _ticks(rms, duration / repeats, period)
    chosen = _band(ticks, from_hz, to_hz, period)
    if lines == "odd":
        chosen[::2] = False
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, chosen.size)
    one = np.fft.irfft(chosen * np.exp(1j * phases), ticks)
    return np.tile(rms * one / np.sqrt(np.mean(one**2)), repeats)


def chirp(
    amplitude: float = 0.2,
    from_hz: float = 0.7,
    to_hz: float = 300.0,
    duration: float = 30.0,
    period: float = 0.001,
) -> Floats:
    """Return a sine whose frequency rises exponentially from one frequency to another."""
    ticks = _ticks(amplitude, duration, period)
    _band(ticks, from_hz, to_hz, period)
    t = np.arange(ticks) * period
    swept = swept_cosine(t, from_hz, duration, to_hz, method="logarithmic", phi=-90)
    return amplitude * np.asarray(swept)


def random_steps(
    amplitude: float = 0.2,
    hold_s: float = 0.25,
    duration: float = 30.0,
    period: float = 0.001,
    seed: int = 0,
) -> Floats:
    """Return levels uniform within +-amplitude, each held for a time."""
    ticks = _ticks(amplitude, duration, period)
    held = _ticks(amplitude, hold_s, period)
    levels = np.random.default_rng(seed).uniform(-amplitude, amplitude, -(-ticks // held))
    return np.repeat(levels, held)[:ticks]


def triangle(
    amplitude: float = 0.05,
    cycle_s: float = 4.0,
    duration: float = 30.0,
    period: float = 0.001,
) -> Floats:
    """Return a slow triangle that begins at zero and rises."""
    ticks = _ticks(amplitude, duration, period)
    _ticks(amplitude, cycle_s, period)
    phase = 2.0 * np.pi * np.arange(ticks) * period / cycle_s + 0.5 * np.pi
    return amplitude * np.asarray(sawtooth(phase, 0.5))  # pyright: ignore[reportArgumentType]


SIGNALS: Mapping[str, Callable[..., Floats]] = {
    "noise": noise,
    "multisine": multisine,
    "chirp": chirp,
    "random_steps": random_steps,
    "triangle": triangle,
}


def _ticks(amplitude: float, duration: float, period: float) -> int:
    for field, value in (("amplitude", amplitude), ("duration", duration), ("period", period)):
        if not 0.0 < value < np.inf:
            raise ValueError(f"excitation.{field} is {value}; it must be finite and > 0")
    ticks = round(duration / period)
    if ticks < 2:
        raise ValueError(f"excitation.duration is {duration} s; it must hold at least two ticks")
    return ticks


def _band(ticks: int, from_hz: float, to_hz: float, period: float) -> NDArray[np.bool_]:
    """Harmonics of the signal inside the band, shape (ticks // 2 + 1,)."""
    nyquist = 0.5 / period
    if not 0.0 < from_hz < to_hz <= nyquist:
        raise ValueError(
            f"excitation goes from {from_hz:g} to {to_hz:g} Hz; the band must begin above 0, rise,"
            f" and end at most at {nyquist:g} Hz (half the sampling rate)"
        )
    frequencies = np.fft.rfftfreq(ticks, period)
    inside = (frequencies >= from_hz) & (frequencies <= to_hz) & (frequencies < nyquist)
    if not inside.any():
        raise ValueError(
            f"no harmonic of {1.0 / (ticks * period):.3g} Hz lies between {from_hz:g} and"
            f" {to_hz:g} Hz; widen the band or lengthen the signal"
        )
    return inside

"""Frequency response of a recording: H1 with its coherence, from overlapping windows.

H1 = S_uy / S_uu over Hann windows of 4096 samples, half overlapping. With the command known
exactly, H1 is linear in the output: an output disturbance n adds

    dH(f) = sum_w conj(U_w(f)) N_w(f) / sum_w |U_w(f)|^2,

N_w the window's transform of n. `identification/` uses this in two ways: the model's H1 is computed
through the same windows, so leakage is in model and data alike, and the covariance of any fit to H1
is computed exactly from the spectrum of n, including overlap and neighbouring bins.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal.windows import hann

from zwidth.shown import Valued
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
WINDOW = 4096
UNEVEN = 0.5  # of a period: how early or late a sample may be
EXCITED = 1e-4  # least power of the command at an excited bin, over the largest


class RecordingError(ValueError):
    """A recording cannot be used; the message describes what to record instead."""


@dataclass(frozen=True)
class Windows(Valued):
    """The windows of a recording and the bins that its command excites.

    length: of a window in samples; starts (windows,); taper (length,); bins (bins,) indices;
    spectra (windows, bins) of the command; power (bins,) = sum over windows of |U_w|^2.
    """

    period: float
    length: int
    starts: NDArray[np.int64]
    taper: Floats
    bins: NDArray[np.int64]
    spectra: Complexes
    power: Floats

    @property
    def frequencies(self) -> Floats:
        """Frequencies [Hz] of the bins."""
        return self.bins / (self.length * self.period)

    def transform(self, signal: Floats) -> Complexes:
        """Return the windows' transforms at the bins, (windows, bins)."""
        pieces = signal[self.starts[:, None] + np.arange(self.length)]
        pieces = (pieces - pieces.mean(axis=1)[:, None]) * self.taper
        return np.fft.rfft(pieces, axis=1)[:, self.bins]

    def response(self, output: Floats) -> Complexes:
        """Return H1 of an output (samples,) to the command, shape (bins,)."""
        return np.sum(np.conj(self.spectra) * self.transform(output), axis=0) / self.power

    def noise_gain(self) -> Floats:
        """Return variance of H1 over the output noise's power spectrum, (bins,).

        Cov(N_w, N_v) of two windows is the spectrum times the overlap of their tapers.
        """
        total = np.zeros(self.bins.size)
        for lag in range(self.starts.size):
            apart = int(self.starts[lag] - self.starts[0])
            overlap = float(self.taper[apart:] @ self.taper[: self.length - apart])
            if overlap == 0.0:
                break
            turn = np.exp(2j * np.pi * self.bins * apart / self.length)
            pairs = np.sum(np.conj(self.spectra[lag:]) * self.spectra[: self.starts.size - lag], 0)
            total += (1.0 if lag == 0 else 2.0) * overlap * np.real(pairs * turn)
        return total / self.power**2

    def adjoint(self, weights: Complexes, samples: int) -> Floats:
        """Return c (samples,) with Re sum_f conj(weights) H1(n) = sum_t c(t) n(t) for every n."""
        full = np.zeros((self.starts.size, self.length // 2 + 1), dtype=np.complex128)
        full[:, self.bins] = weights * self.spectra / self.power
        full *= 0.5 * self.length
        full[:, 0] *= 2.0
        pieces = np.fft.irfft(full, self.length, axis=1) * self.taper
        pieces -= pieces.mean(axis=1)[:, None]  # the adjoint of removing each window's mean
        total = np.zeros(samples)
        for start, piece in zip(self.starts, pieces, strict=True):
            total[start : start + self.length] += piece
        return total


@dataclass(frozen=True)
class FrequencyResponse(Valued):
    """H1 of a recording: frequency_hz, value (complex), coherence, all (bins,)."""

    frequency_hz: Floats
    value: Complexes
    coherence: Floats
    windows: Windows


def frequency_response(
    trace: Trace,
    output: str = "position_m1",
    command: str = "command",
    window: int = WINDOW,
    from_hz: float = 0.7,
    to_hz: float = 300.0,
) -> FrequencyResponse:
    """Return H1 from command to an output channel over the bins that the command excites.

    Raises RecordingError for a recording that is too short, not excited, constant or not finite,
    with what to record instead.
    """
    for name in (command, output):
        if name not in trace.channels:
            raise RecordingError(
                f"the recording has no channel {name!r}; it has {', '.join(trace.channels)}: name"
                " the motor's command, and the position of the mass that the motor drives"
            )
    u, y = trace[command], trace[output]
    _check(trace, u, y, command, output, window)
    period = float(np.median(np.diff(trace.t)))
    windows = windows_of(u, period, window, from_hz, to_hz)
    spectra = windows.transform(y)
    cross = np.sum(np.conj(windows.spectra) * spectra, axis=0)
    coherence = np.abs(cross) ** 2 / (windows.power * np.sum(np.abs(spectra) ** 2, axis=0))
    return FrequencyResponse(windows.frequencies, cross / windows.power, coherence, windows)


def windows_of(
    command: Floats, period: float, length: int, from_hz: float, to_hz: float
) -> Windows:
    """Return half-overlapping Hann windows and the excited bins of a command (samples,)."""
    starts = np.arange(0, command.size - length + 1, length // 2)
    taper = hann(length, sym=False)
    pieces = command[starts[:, None] + np.arange(length)]
    pieces = (pieces - pieces.mean(axis=1)[:, None]) * taper
    spectra = np.fft.rfft(pieces, axis=1)
    power = np.sum(np.abs(spectra) ** 2, axis=0)
    frequencies = np.arange(power.size) / (length * period)
    inside = (frequencies >= from_hz) & (frequencies <= to_hz)
    bins = np.flatnonzero(inside & (power > EXCITED * power[inside].max()))
    if bins.size < 20:
        raise RecordingError(
            f"the command excites {bins.size} frequencies between {from_hz:g} and {to_hz:g} Hz; at"
            " least 20 are needed: record with noise, a chirp or a multisine over that band"
        )
    return Windows(period, length, starts, taper, bins, spectra[:, bins], power[bins])


def _check(trace: Trace, u: Floats, y: Floats, command: str, output: str, window: int) -> None:
    if len(trace) < 2 * window:
        raise RecordingError(
            f"the recording has {len(trace)} samples, but at least two windows of {window} samples"
            " are needed; record longer (30 s at 1 kHz is plenty)"
        )
    steps = np.diff(trace.t)
    period = float(np.median(steps))
    uneven = np.flatnonzero(~(np.abs(steps - period) <= UNEVEN * period))
    if uneven.size:
        raise RecordingError(
            f"the time between samples is {steps[uneven[0]]:.3g} s at {trace.t[uneven[0]]:.6g} s,"
            f" but {period:.3g} s elsewhere; use a stretch without gaps, or record at a constant"
            " rate"
        )
    for name, values in ((command, u), (output, y)):
        if not np.all(np.isfinite(values)):
            raise RecordingError(
                f"channel {name!r} has values that are not finite; remove these samples"
            )
        if np.ptp(values) == 0.0:
            raise RecordingError(
                f"channel {name!r} is constant at {values[0]:g}; record while the device is driven"
                " with noise, a chirp or a multisine"
            )

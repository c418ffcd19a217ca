"""Spectrum of the output's noise, separated from the errors of the model.

Local polynomials (Pintelon, Schoukens, Vandersteen & Barbe, Mech. Systems and Signal Processing 24,
2010; here on the residual): over a narrow band of the whole record's transform, the residual that a
wrong linear model leaves is the command times a function smooth in frequency, plus a smooth
transient,

    E(k) = (g0 + g1 r + g2 r^2) U(k) + t0 + t1 r + t2 r^2 + N(k),    r the distance in bins.

The remainder of E after a fit of these six coefficients is noise, whether or not the fitted model
is right.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
BAND = 24  # bins per band; the polynomials use six of them
DEGREE = 2
AVERAGED = 7  # neighbouring bands
SINGULAR = 1e-8


def noise_spectrum(
    command: Floats, residual: Floats, period: float, from_hz: float, to_hz: float
) -> Floats:
    """Return E|N(k)|^2 / samples at the bins of rfft(samples), (samples // 2 + 1,).

    command and residual (samples,). Outside the band from from_hz to to_hz the nearest value is
    used.
    """
    samples = residual.size
    frequency = np.fft.rfftfreq(samples, period)
    first, last = np.searchsorted(frequency, [from_hz, to_hz])
    bands = max(1, (last - first) // BAND)
    chosen = first + np.arange(bands * BAND).reshape(bands, BAND)
    chosen = np.minimum(chosen, frequency.size - 1)
    u, e = np.fft.rfft(command)[chosen], np.fft.rfft(residual)[chosen]
    r = np.linspace(-1.0, 1.0, BAND)[None, :, None] ** np.arange(DEGREE + 1)
    scale = np.abs(u).max(axis=1, keepdims=True)
    driven = np.divide(u, scale, out=np.zeros_like(u), where=scale > 0.0)
    columns = np.concatenate([r * driven[:, :, None], np.broadcast_to(r, (bands, *r.shape[1:]))], 2)
    left, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    used = sizes > SINGULAR * sizes[:, :1]
    left = left * used[:, None, :]
    noise = e - np.einsum("bik,bk->bi", left, np.einsum("bik,bi->bk", left.conj(), e))
    power = np.sum(np.abs(noise) ** 2, axis=1)
    freedom = (BAND - used.sum(axis=1)).astype(np.float64)
    kernel = np.ones(min(AVERAGED, bands))
    density = np.convolve(power, kernel, "same") / np.convolve(freedom, kernel, "same")
    return np.interp(frequency, frequency[chosen].mean(axis=1), density) / samples

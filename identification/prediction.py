"""H1 of a modal model under a recorded command, and its derivative by the model's coordinates.

Each pole of G adds Re(a f_k + b f_{k-1}) to the position: f is the delayed command through one
filter, f_{k+1} = e^{pT} f_k + u_k; a and b hold residue and hold (`identification/output.py`).
Coordinates change only a, b and e^{pT}, and the derivative of f by e^{pT} is the same filter
applied to f. So the derivatives by all coordinates take two filters and two or three transforms per
pole, whatever the number of coordinates.

The motion before the recording began adds e^{pt} for each pole, and a constant force adds a ramp:
`free_motion` returns their H1, to be projected out of a fit.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.identification.coordinates import Coordinates
from zwidth.identification.output import (
    Terms,
    delayed,
    each_term,
    filtered,
    fractions,
    split_delay,
    terms,
)
from zwidth.identification.response import Windows

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
STEP = 1e-6  # step of a coordinate, for central differences of a, b and e^{pT}


class Predicted(NamedTuple):
    """H1 of a model, (bins,), and its derivative by the coordinates, (bins, coordinates)."""

    response: Complexes
    slope: Complexes


def predict(x: Floats, coordinates: Coordinates, command: Floats, windows: Windows) -> Predicted:
    """Return H1 and its derivative at coordinates x, for a command (ticks,) in the windows."""
    model, delay = coordinates.model(x)
    whole, remainder = split_delay(delay, windows.period)
    at = terms(model, windows.period, remainder)
    change = _slopes(x, coordinates, whole)
    held = delayed(command, whole)
    response = np.zeros(windows.bins.size, dtype=np.complex128)
    slope = np.zeros((windows.bins.size, x.size), dtype=np.complex128)
    for k, (decay, newer, older) in enumerate(each_term(at)):
        f = filtered(decay, held)
        before = delayed(f, 1)
        by_decay = filtered(decay, newer * f + older * before)
        for signal, weight, weights in (
            (f, newer, change.newer[:, k]),
            (before, older, change.older[:, k]),
            (by_decay, 0.0, change.decay[:, k]),
        ):
            if weight == 0.0 and not np.any(weights):
                continue
            real = windows.response(np.real(signal))
            response += np.real(weight) * real
            slope += real[:, None] * np.real(weights)
            if np.iscomplexobj(signal):
                imaginary = windows.response(np.imag(signal))
                response -= np.imag(weight) * imaginary
                slope -= imaginary[:, None] * np.imag(weights)
    return Predicted(response, slope)


def _slopes(x: Floats, coordinates: Coordinates, whole: int) -> Terms:
    """Derivatives of the terms, (coordinates, poles), at a fixed number of whole delay periods."""
    period = coordinates.period

    def at(point: Floats) -> Terms:
        model, delay = coordinates.model(point)
        return terms(model, period, delay - whole * period if coordinates.delay is None else rest)

    rest = 0.0 if coordinates.delay is None else split_delay(coordinates.delay, period)[1]
    steps = STEP * np.eye(x.size)
    pairs = [(at(x + step), at(x - step)) for step in steps]
    return Terms(*(np.array([(p[i] - m[i]) / (2.0 * STEP) for p, m in pairs]) for i in range(3)))


def free_motion(x: Floats, coordinates: Coordinates, samples: int, windows: Windows) -> Complexes:
    """Return H1 of the free responses and of a ramp, (bins, columns), columns of norm 1."""
    signals = free_signals(x, coordinates, samples).T
    columns = np.column_stack([windows.response(signal) for signal in signals])
    return columns / np.linalg.norm(columns, axis=0)


def free_signals(x: Floats, coordinates: Coordinates, samples: int) -> Floats:
    """Return a ramp and the free responses of all poles except that at 0, (samples, columns)."""
    model, _ = coordinates.model(x)
    poles, _ = fractions(model)
    t = coordinates.period * np.arange(samples, dtype=np.float64)
    signals: list[Floats] = [t]
    for pole in poles[1:]:
        decaying: Complexes = np.exp(complex(pole) * t).astype(np.complex128)
        signals += [decaying.real, decaying.imag] if pole.imag else [decaying.real]
    return np.column_stack(signals)

"""Fast position of a modal model under a held command: one first-order filter per pole.

G = sum_p r_p / (s - p). Over one period T, for a command that changes from u' to u at a time r
after the tick, the term of a pole p becomes

    y_{k+1} = e^{pT} y_k + r_p h(T - r) u + r_p e^{p(T - r)} h(r) u',    h(t) = (e^{pt} - 1) / p,

exactly (h(t) = t for the pole at 0). Limit: all poles distinct.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from zwidth.sim.modal import ModalModel

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
WHOLE = 1e-9  # of a period: a smaller remainder is rounding of decimal input


class Terms(NamedTuple):
    """The terms of the sampled position, one per pole, all (poles,).

    decay: e^{pT}; newer and older: the contributions of one unit of the newer and of the older
    command.
    """

    decay: Complexes
    newer: Complexes
    older: Complexes


def fractions(model: ModalModel) -> tuple[Complexes, Complexes]:
    """Return (poles, residues) of G: 0, -b/m, and of each complex pair the upper pole.

    The residue of a pair is doubled: the real part of this one filter is then the sum of both.
    Raises ValueError for a mode without oscillation (c >= 2 omega).
    """
    poles: list[complex] = [0.0, -model.damping / model.inertia]
    for i, mode in enumerate(model.modes):
        if not abs(mode.c) < 2.0 * mode.omega:
            raise ValueError(
                f"modal.mode[{i}].c is {mode.c:g}; it must stay below 2 omega = {2 * mode.omega:g}"
            )
        poles.append(complex(-0.5 * mode.c, np.sqrt(mode.omega**2 - 0.25 * mode.c**2)))
    p = np.array(poles, dtype=np.complex128)
    gain = np.ones(p.size, dtype=np.complex128) / model.inertia
    for mode in model.modes:
        gain *= (mode.omega / mode.v) ** 2 * ((p + mode.d) * p + mode.v**2)
    everything = np.concatenate([p, np.conj(p[2:])])
    differences = p[:, None] - everything[None, :]
    differences[np.arange(p.size), np.arange(p.size)] = 1.0
    residues = gain / differences.prod(axis=1)
    residues[2:] *= 2.0
    return p, residues


def terms(model: ModalModel, period: float, remainder: float) -> Terms:
    """Return the terms of the position for a delay of whole periods and a remainder r [s]."""
    poles, residues = fractions(model)
    return Terms(
        np.exp(poles * period),
        residues * _held(poles, period - remainder),
        residues * _held(poles, remainder) * np.exp(poles * (period - remainder)),
    )


def split_delay(delay: float, period: float) -> tuple[int, float]:
    """Return (whole periods, remainder [s]) of a delay >= 0."""
    whole = int(np.floor(delay / period + WHOLE))
    remainder = delay - whole * period
    return whole, remainder if remainder > WHOLE * period else 0.0


def position(model: ModalModel, delay: float, command: Floats, period: float) -> Floats:
    """Return the position at each tick, from rest; each command is held from kT + delay on.

    command (ticks,) [N m | N]; the command is 0 before the first tick.
    """
    whole, remainder = split_delay(delay, period)
    held = delayed(command, whole)
    before = delayed(held, 1)
    total = np.zeros(command.size)
    for decay, newer, older in each_term(terms(model, period, remainder)):
        total += np.real(filtered(decay, newer * held + older * before))
    return total


def each_term(at: Terms) -> list[tuple[complex, complex, complex]]:
    """Return (decay, newer, older) of each pole, as real numbers for a real pole."""
    rows = zip(at.decay.tolist(), at.newer.tolist(), at.older.tolist(), strict=True)
    return [row if row[0].imag else (row[0].real, row[1].real, row[2].real) for row in rows]


def filtered(decay: complex, values: NDArray[np.inexact]) -> NDArray[np.inexact]:
    """Return f with f_0 = 0 and f_{k+1} = decay f_k + value_k, of the shape of values."""
    return np.asarray(lfilter([0.0, 1.0], [1.0, -decay], values))


def delayed(values: NDArray[np.inexact], ticks: int) -> NDArray[np.inexact]:
    """Return the values some ticks later, zero before."""
    return np.concatenate([np.zeros(ticks, values.dtype), values])[: values.size]


def _held(poles: Complexes, duration: float) -> Complexes:
    """Integral of exp(p t) over the hold."""
    with np.errstate(invalid="ignore"):
        return np.where(poles == 0.0, duration, np.expm1(poles * duration) / poles)

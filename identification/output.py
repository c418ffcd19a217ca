"""Output of a modal model to a held command, fast: partial fractions, one first-order filter a pole.

G = sum_p r_p / (s - p); a hold over T makes y_{k+1} = e^{pT} y_k + r (e^{pT} - 1)/p u_k of each term
(T r u_k for the pole at 0), exactly. Limit: all poles distinct, which a fit keeps by its bounds.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from sim.modal import ModalModel

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


def fractions(model: ModalModel) -> tuple[Complexes, Complexes]:
    """Return (poles, residues) of G: 0, -b/m, and the upper one of each pair of poles.

    A conjugate pair counts once here, with its residue doubled: the real part of its filter is the
    sum of both. Raises ValueError for a mode without oscillation (c >= 2 omega).
    """
    poles = [0.0, -model.damping / model.inertia]
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


def position(model: ModalModel, command: Floats, period: float, delay: float = 0.0) -> Floats:
    """Return the position at each tick, from rest, under commands held from kT + delay on.

    command (ticks,) [N m | N]; a delay of d T + r mixes the commands of ticks k - d - 1 and k - d.
    """
    whole = int(np.floor(delay / period + 1e-9))
    rest = max(0.0, delay - whole * period)
    held = np.concatenate([np.zeros(whole + 1), command])[: command.size + 1]
    total = np.zeros(command.size)
    for pole, residue in zip(*fractions(model), strict=True):
        late = residue * _hold(pole, period - rest)
        early = residue * _hold(pole, rest) * np.exp(pole * (period - rest))
        force = late * held[1:] + early * held[:-1]
        one = lfilter([0.0, 1.0], [1.0, -np.exp(pole * period)], force)
        total += np.real(one)
    return total


def _hold(pole: complex, duration: float) -> complex:
    """Integral of exp(p t) over the hold."""
    return duration if pole == 0.0 else complex(np.expm1(pole * duration) / pole)

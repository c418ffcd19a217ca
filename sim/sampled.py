"""Z[H G] of a modal model: its exact response through hold and sampler."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm

from zwidth.sim.chain import Floats
from zwidth.sim.ladder import Complexes
from zwidth.sim.modal import ModalModel


class StateSpace(NamedTuple):
    """x' = a x + b u (or x+ = a x + b u), position of m1 = c x; a (N, N), b (N,), c (N,)."""

    a: Floats
    b: Floats
    c: Floats


def state_space(model: ModalModel) -> StateSpace:
    """Return a realisation of G with 2k + 2 states, for k modes.

    A cascade that ends in position and velocity of the rigid body; each mode before it is w^2/v^2
    (1 + ((d - c) s + v^2 - w^2)/(s^2 + c s + w^2)), with states scaled to its omega.
    """
    size = 2 * len(model.modes) + 2
    a, b = np.zeros((size, size)), np.zeros(size)
    passed, gain = np.zeros(size), 1.0
    for i, (omega, c, v, d) in enumerate(model.modes):
        x, y = 2 * i, 2 * i + 1
        a[x, y], a[y, x], a[y, y] = omega, -omega, -c
        a[y] += omega * passed
        b[y] = omega * gain
        ratio = (omega / v) ** 2
        passed[x], passed[y] = (v * v - omega * omega) / omega**2, (d - c) / omega
        passed, gain = passed * ratio, gain * ratio
    a[-2, -1], a[-1, -1] = 1.0, -model.damping / model.inertia
    a[-1] += passed / model.inertia
    b[-1] = gain / model.inertia
    return StateSpace(a, b, np.eye(size)[-2])


def sampled_state_space(model: ModalModel, period: float) -> StateSpace:
    """Return Z[H G]: the state at t = k T [s] under an input held over each period, exactly."""
    a, b, c = state_space(model)
    n = b.size
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n] = a, b
    full: Floats = np.asarray(expm(block * period), dtype=np.float64)
    return StateSpace(full[:n, :n], full[:n, n], c)


def sampled_frequency_response(model: ModalModel, period: float, frequency: ArrayLike) -> Complexes:
    """Return Z[H G] at z = exp(j 2 pi f T), f > 0 [Hz], of the shape of frequency."""
    a, b, c = sampled_state_space(model, period)
    z = np.exp(2j * np.pi * period * np.asarray(frequency, dtype=np.float64))
    systems = z[..., None, None] * np.eye(b.size) - a
    gains: Complexes = np.linalg.inv(systems).astype(np.complex128) @ b @ c
    return gains

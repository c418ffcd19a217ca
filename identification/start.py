"""Starting values for the fit, from the measured response alone.

Mobility V = s G / (hold) is a ratio of polynomials of degrees 2k and 2k + 1. N - V D = 0 is solved
by linear least squares with the weight 1/|D| of the previous iteration (Sanathanan & Koerner, IEEE
T. Automatic Control 8, 1963), with s scaled by the band's upper end. Roots are then made stable and
interlacing.

A fit from there may end with a mode that cancels itself while another mode is missing: `moved`
moves the first to the frequency of the second.
"""

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.modal import ModalModel, Mode

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
ROUNDS = 30
NEW_DAMPING = 0.1  # c and d over omega of an inserted mode
SPLIT = 1.01  # least ratio of a pole to the zero before it, or of a zero to its pole


def starting_model(
    frequency_hz: Floats, response: Complexes, weight: Floats, modes: int, period: float,
    delay: float,
) -> ModalModel:  # fmt: skip
    """Return a modal model near a measured response.

    frequency_hz, response [rad/(N m) | m/N], weight (1 / standard deviation), each (bins,).
    """
    s = (2j * np.pi * frequency_hz).astype(np.complex128)
    scale = float(2.0 * np.pi * frequency_hz[-1])
    hold = (1.0 - np.exp(-s * period)) / (s * period)
    mobility = s * response / (hold * np.exp(-s * delay))
    size = float(np.median(np.abs(mobility)))
    numerator, denominator = _rational(s / scale, mobility / size, weight / np.abs(s), 2 * modes)
    poles, zeros = (_roots(c) * scale for c in (denominator, numerator))
    return _interlaced(poles, zeros, mobility, s, modes)


def moved(model: ModalModel, omega: float) -> ModalModel:
    """Return the model with its least important mode moved to omega [rad/s], nearly cancelled.

    Zeros and poles alternate in any case: between modes the pair is inserted as zero, then pole;
    inside a mode as pole, then zero.
    """
    effect = [abs(np.log(m.omega / m.v)) + abs(m.c - m.d) / m.omega for m in model.modes]
    kept = [m for i, m in enumerate(model.modes) if i != int(np.argmin(effect))]
    zeros = sorted([(m.v, m.d) for m in kept] + [(omega, NEW_DAMPING * omega)])
    poles = sorted([(m.omega, m.c) for m in kept] + [(omega, NEW_DAMPING * omega)])
    modes = [Mode(max(p, v * SPLIT), c, v, d) for (p, c), (v, d) in zip(poles, zeros, strict=True)]
    return ModalModel(model.inertia, model.damping, tuple(_apart(modes)))


def _apart(modes: list[Mode]) -> list[Mode]:
    """Raise each zero above the preceding pole."""
    found: list[Mode] = []
    floor = 0.0
    for mode in modes:
        v = max(mode.v, floor * SPLIT)
        found.append(mode._replace(v=v, omega=max(mode.omega, v * SPLIT)))
        floor = found[-1].omega
    return found


def _rational(s: Complexes, value: Complexes, weight: Floats, degree: int) -> tuple[Floats, Floats]:
    """Ascending coefficients of N (degree) and monic D (degree + 1), N/D near value."""
    powers = s[:, None] ** np.arange(degree + 2)
    scaling = weight
    solution = np.zeros(2 * degree + 2)
    for _ in range(ROUNDS):
        columns = np.hstack([powers[:, :-1], -value[:, None] * powers[:, :-1]]) * scaling[:, None]
        target = value * powers[:, -1] * scaling
        left = np.vstack([columns.real, columns.imag])
        norms = np.linalg.norm(left, axis=0)
        right = np.concatenate([target.real, target.imag])
        solution = np.linalg.lstsq(left / norms, right, rcond=None)[0] / norms
        denominator = powers @ np.append(solution[degree + 1 :], 1.0)
        scaling = weight / np.abs(denominator)
    return solution[: degree + 1], np.append(solution[degree + 1 :], 1.0)


def _interlaced(
    poles: Complexes, zeros: Complexes, mobility: Complexes, s: Complexes, modes: int
) -> ModalModel:
    """Keep the oscillating pairs, in rising order with each zero below its pole."""
    low, high = float(np.abs(s[0])), float(np.abs(s[-1]))
    omegas = _pairs(poles, modes, low, high)
    vs = _pairs(zeros, modes, low, high)
    real = np.abs(poles.real[np.abs(poles.imag) < 1e-9 * np.abs(poles)])
    built: list[Mode] = []
    floor = 0.0
    for (omega, c), (v, d) in zip(omegas, vs, strict=True):
        omega = max(omega, 1.02 * floor)
        if not floor < v < omega:
            v = 0.95 * omega if floor == 0.0 else max(np.sqrt(floor * omega), 0.9 * omega)
        built.append(Mode(omega, c, v, d))
        floor = omega
    unit = ModalModel(1.0, 0.0, tuple(built))
    ratio = np.ones(s.size, dtype=np.complex128)
    for omega, c, v, d in unit.modes:
        ratio *= (omega / v) ** 2 * (s * s + d * s + v * v) / (s * s + c * s + omega * omega)
    stiff = ratio / mobility  # m s + b
    inertia = float(np.median(np.abs(np.imag(stiff) / np.imag(s))))
    slow = float(real.min()) if real.size else low
    return ModalModel(inertia, inertia * float(np.clip(slow, 1e-3 * low, 0.5 * high)), unit.modes)


def _roots(ascending: Floats) -> Complexes:
    return np.roots(ascending[::-1]).astype(np.complex128)


def _pairs(roots: Complexes, count: int, low: float, high: float) -> list[tuple[float, float]]:
    """Return (natural frequency, damping coefficient) of `count` oscillating pairs, rising."""
    upper = roots[roots.imag > 1e-9 * np.abs(roots)]
    found = sorted(
        (float(abs(r)), float(np.clip(2.0 * abs(r.real), 0.01 * abs(r), 1.5 * abs(r))))
        for r in upper
        if 0.3 * low < abs(r) < 3.0 * high
    )
    while len(found) < count:  # fill the widest gap of the band
        edges = [low, *(f for f, _ in found), high]
        gap = int(np.argmax(np.diff(np.log(edges))))
        middle = float(np.sqrt(edges[gap] * edges[gap + 1]))
        found = sorted([*found, (middle, 0.2 * middle)])
    return found[:count]

"""Eq. (1) of the paper: rigid body times one factor per mode; conversion to a chain and back."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from zwidth.shown import Valued, fields_html
from zwidth.sim.chain import MAX_MASSES, Chain, Floats, make_chain, matrices, negative_dampers
from zwidth.sim.ladder import Complexes, dynamic_stiffness, scaled
from zwidth.sim.synthesis import chains, polish

AGREEMENT = 1e-8
NO_MASS = 1e-12  # of the total mass: rounding of a mode that cancels itself


class Mode(NamedTuple):
    """One factor w^2 (s^2 + d s + v^2) / (v^2 (s^2 + c s + w^2)), all in rad/s."""

    omega: float
    c: float
    v: float
    d: float

    _repr_html_ = fields_html


@dataclass(frozen=True)
class ModalModel(Valued):
    """G(s) = 1/(m s^2 + b s) x product of modes: position of m1 over force at m1.

    inertia m [kg m2 | kg], damping b [N m s/rad | N s/m], modes (0 to 4 of them; kept in rising
    omega). Damping terms may be negative, as in some fits; inertia and frequencies may not.

    Raises ValueError with a sentence that names the field, the value and what is allowed.
    """

    inertia: float
    damping: float
    modes: tuple[Mode, ...] = ()

    def __post_init__(self) -> None:
        modes = tuple(Mode(*map(float, mode)) for mode in self.modes)
        object.__setattr__(self, "inertia", float(self.inertia))
        object.__setattr__(self, "damping", float(self.damping))
        object.__setattr__(self, "modes", tuple(sorted(modes)))
        if len(modes) >= MAX_MASSES:
            raise ValueError(f"modal has {len(modes)} modes; it must have at most {MAX_MASSES - 1}")
        if not 0.0 < self.inertia < math.inf:
            raise ValueError(f"modal.inertia is {self.inertia:g}; it must be > 0 and finite")
        if not math.isfinite(self.damping):
            raise ValueError(f"modal.damping is {self.damping:g}; it must be finite")
        for i, mode in enumerate(modes):
            for field, value in mode._asdict().items():
                frequency = field in ("omega", "v")
                if not math.isfinite(value) or (frequency and value <= 0.0):
                    raise ValueError(
                        f"modal.mode[{i}].{field} is {value:g}; it must be"
                        f" {'> 0 and finite' if frequency else 'finite'} [rad/s]"
                    )


def transfer_function(model: ModalModel) -> tuple[Floats, Floats]:
    """Return (numerator, denominator) of G(s), descending powers of s, shapes (2k+1,), (2k+3,)."""
    numerator, denominator = np.ones(1), np.array([model.inertia, model.damping, 0.0])
    for omega, c, v, d in model.modes:
        numerator = np.convolve(numerator, [1.0 / v**2, d / v**2, 1.0])
        denominator = np.convolve(denominator, [1.0 / omega**2, c / omega**2, 1.0])
    return numerator, denominator


def response(model: ModalModel, s: ArrayLike) -> Complexes:
    """Return G at complex s [rad/s], of the shape of s."""
    s = np.asarray(s, dtype=np.complex128)
    gain = 1.0 / ((model.inertia * s + model.damping) * s)
    for omega, c, v, d in model.modes:
        gain = gain * (((s + d) * s / v**2 + 1.0) / ((s + c) * s / omega**2 + 1.0))
    return gain


def frequency_response(model: ModalModel, frequency: ArrayLike) -> Complexes:
    """Return G [rad/(N m) | m/N] at frequency > 0 [Hz], of the same shape."""
    return response(model, 2j * np.pi * np.asarray(frequency, dtype=np.float64))


def to_chain(model: ModalModel) -> Chain:
    """Return the chain of k + 1 masses with this response, to the last digits (`sim/synthesis.py`).

    If there are several with positive masses and springs (seen only with overdamped modes), the one
    with the least negative damping is returned. Raises ValueError with a sentence if there is none,
    or none in double precision (seen only with v > omega or overdamped modes).
    """
    rate = math.exp(
        sum(math.log(mode.omega * mode.v) for mode in model.modes) / max(1, 2 * len(model.modes))
    )
    unit = ModalModel(
        1.0,
        model.damping / (model.inertia * rate),
        tuple(Mode(*(value / rate for value in mode)) for mode in model.modes),
    )
    minor, stiffness = (polynomial[::-1] for polynomial in transfer_function(unit))
    found = [_polished(chain, unit) for chain in chains(stiffness / minor[-1], minor / minor[-1])]
    fitting = [
        chain
        for chain in found
        if agree(chain, unit) and chain.masses.min() > NO_MASS * chain.masses.sum()
    ]
    if not fitting:
        raise ValueError(
            f"modal: no chain of {len(model.modes) + 1} positive masses and springs has this"
            " response"
            " to eight digits; put each v below its omega, keep c < 2 omega, and remove a mode that"
            " cancels itself"
        )
    best = max(fitting, key=lambda chain: sum(negative_dampers(chain).values()))
    return make_chain(*scaled(best, model.inertia, rate))


def _polished(chain: Chain, unit: ModalModel) -> Chain:
    poles = np.array([r for mode in unit.modes for r in _roots(mode.c, mode.omega)], complex)
    zeros = np.array([r for mode in unit.modes for r in _roots(mode.d, mode.v)], complex)
    ratios = [(mode.v / mode.omega) ** 2 for mode in unit.modes]
    return polish(chain, poles, zeros, unit.damping, math.prod(ratios, start=unit.inertia))


def _roots(c: float, omega: float) -> tuple[complex, ...]:
    """Return the roots of s^2 + c s + omega^2, of a complex pair the upper one."""
    squared = (c / 2.0) ** 2 - omega**2
    if squared < 0.0:
        return (complex(-c / 2.0, math.sqrt(-squared)),)
    far = -c / 2.0 - math.copysign(math.sqrt(squared), c)
    return far, omega**2 / far


def agree(chain: Chain, model: ModalModel) -> bool:
    """Return whether both have the same response (to 1e-8, slightly off the imaginary axis)."""
    if min(chain.masses) <= 0.0 or min(chain.link_springs, default=1.0) <= 0.0:
        return False
    rates = [rate for mode in model.modes for rate in (mode.omega, mode.v)]
    rates += [abs(model.damping) / model.inertia] if model.damping else []
    rates = rates or [1.0]
    s = np.geomspace(0.1 * min(rates), 10.0 * max(rates), 30) * (0.3 + 1j)
    return bool(np.abs(dynamic_stiffness(chain, s) * response(model, s) - 1.0).max() < AGREEMENT)


def from_chain(chain: Chain) -> ModalModel:
    """Return the modal model with the response of this chain (damping: sum of ground dampers).

    Raises ValueError with a sentence if there is none: with a spring to ground, or if a mode is
    overdamped, so that its two real poles cannot be distinguished from the rigid body's.
    """
    if chain.ground_spring != 0.0:
        raise ValueError(
            f"ground_spring is {chain.ground_spring:g}: a chain tied to ground has no modal form"
            " 1/(m s^2 + b s); set it to 0 or keep the chain form"
        )
    poles, zeros = _pairs(_chain_poles(chain), "poles"), _pairs(_chain_zeros(chain), "zeros")
    ratio = math.prod((omega / v) ** 2 for (omega, _), (v, _) in zip(poles, zeros, strict=True))
    return ModalModel(
        float(chain.masses[0]) * ratio,
        math.fsum(chain.ground_dampers),
        tuple(Mode(*pole, *zero) for pole, zero in zip(poles, zeros, strict=True)),
    )


def _chain_poles(chain: Chain) -> Complexes:
    """Eigenvalues in link deflections and velocities, (2n - 1,): position itself is left out."""
    n = chain.masses.size
    deflections = np.eye(n)[:-1] - np.eye(n)[1:]
    forces = -deflections.T * chain.link_springs
    damping = -matrices(chain).damping
    a = np.block([[np.zeros((n - 1, n - 1)), deflections], [forces, damping]])
    a[n - 1 :] /= chain.masses[:, None]
    return np.linalg.eigvals(a).astype(np.complex128)


def _chain_zeros(chain: Chain) -> Complexes:
    """Eigenvalues with m1 locked, (2n - 2,)."""
    n = chain.masses.size
    locked = [matrix[1:, 1:] / chain.masses[1:, None] for matrix in matrices(chain)[1:]]
    a = np.block([[np.zeros((n - 1, n - 1)), np.eye(n - 1)], [-locked[1], -locked[0]]])
    return np.linalg.eigvals(a).astype(np.complex128)


def _pairs(roots: Complexes, kind: str) -> list[tuple[float, float]]:
    """Return (frequency, damping term) of each conjugate pair, rising; at most one root is real."""
    upper = roots[roots.imag > 0.0]
    if roots.size - 2 * upper.size > 1:
        real = ", ".join(f"{-root.real:.4g}" for root in roots[roots.imag == 0.0])
        raise ValueError(
            f"the chain has real {kind} at -({real}) rad/s: an overdamped mode has no modal form;"
            " lower link_dampers and ground_dampers or keep the chain form"
        )
    return sorted((float(abs(root)), -2.0 * float(root.real)) for root in upper)

"""D-decomposition: every wall (B, K) that sustains an oscillation of frequency f, in closed form.

On the unit circle the characteristic equation is linear in K and B with one complex coefficient,

    K + B w(z) = -1 / P(z),    z = exp(2 pi j f T),

w the response of the velocity estimate (`velocity_response`),

so the imaginary part gives B(f), and the real part K(f). P is the plant with hold and delay; from
the partial fractions G(s) = sum r_i / (s - p_i),

    P(z) = z^-d sum r_i (h_i(T - r) + e^{p_i (T - r)} h_i(r) / z) / (z - e^{p_i T}),
    h_i(t) = (e^{p_i t} - 1) / p_i.

This uses no matrix exponential, no loop matrix and no eigenvalue in z, so it is an independent
check of `stability/linear.py`. The curve shows at which walls an oscillation can sustain itself,
not which side is stable; the line z = -1 is not part of it. It needs distinct poles, so b > 0 on a
device without ground spring.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zwidth.sim.device import Device
from zwidth.sim.modal import ModalModel
from zwidth.sim.plant import Plant
from zwidth.stability.velocity import refuse_force, velocity_response

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
DISTINCT = 1e-9


class PartialFractions(NamedTuple):
    """G(s) = sum of residues / (s - poles); both (n,), poles in rad/s."""

    poles: Complexes
    residues: Complexes


class Curve(NamedTuple):
    """Walls that sustain an oscillation: damping B and stiffness K, one of each per frequency."""

    damping: Floats
    stiffness: Floats


def curve(device: Device, frequency_hz: ArrayLike) -> Curve:
    """Return (B, K) at each frequency, 0 < f < 1/(2T) [Hz].

    Uses eq. (1) if the device is given in modal form and no effect changes its linear equations,
    else the eigenvectors of the chain. Raises ValueError for a frequency outside the open interval
    or for poles that coincide.
    """
    interface = device.interface
    f = np.asarray(frequency_hz, dtype=np.float64)
    refuse_force(device, "this closed form")
    if interface.multirate:
        raise ValueError(
            "velocity_ticks or position_ticks is more than 1, but this closed form takes only one"
            " rate: use `stability.periodic`, or set both to 1"
        )
    nyquist = 0.5 / interface.period
    if not np.all((f > 0.0) & (f < nyquist)):
        raise ValueError(
            f"frequency_hz must lie between 0 and {nyquist:g} Hz (half the sampling rate)"
        )
    altered = any(p.effect.hook == "structure" for p in device.physics)
    modal = None if altered else device.modal
    fractions = from_plant(device.plant()) if modal is None else from_modal(modal)
    z = np.exp(2j * np.pi * interface.period * f)
    velocity = velocity_response(interface, z)
    needed = -1.0 / sampled(fractions, interface.period, *interface.delay_ticks, z)
    damping = needed.imag / velocity.imag
    return Curve(damping, needed.real - damping * velocity.real)


def from_modal(model: ModalModel) -> PartialFractions:
    """Split eq. (1): residue i = gain prod_j (p_i - z_j) / prod_{j != i} (p_i - p_j)."""
    poles = [0.0, -model.damping / model.inertia]
    zeros: list[complex] = []
    gain = 1.0 / model.inertia
    for omega, c, v, d in model.modes:
        poles += np.roots([1.0, c, omega**2]).tolist()
        zeros += np.roots([1.0, d, v**2]).tolist()
        gain *= (omega / v) ** 2
    p = _distinct(np.array(poles, dtype=np.complex128))
    differences = p[:, None] - p[None, :] + np.eye(p.size)
    above = np.prod(p[:, None] - np.array(zeros, dtype=np.complex128)[None, :], axis=1)
    return PartialFractions(p, gain * above / np.prod(differences, axis=1))


def from_plant(plant: Plant) -> PartialFractions:
    """Split c (s I - A)^-1 b of the chain, amplifier's lag included, by its eigenvectors."""
    poles, vectors = np.linalg.eig(plant.a)
    inputs = np.linalg.solve(vectors, plant.b[:, 0].astype(np.complex128))
    return PartialFractions(_distinct(poles.astype(np.complex128)), vectors[0] * inputs)


def sampled(
    fractions: PartialFractions, period: float, whole: int, remainder: float, z: Complexes
) -> Complexes:
    """Return P(z) for a period T and a delay of whole periods and a remainder r, both in s."""
    p, newer = fractions.poles, period - remainder
    held = _held(p, newer) + np.exp(p * newer) * _held(p, remainder) / z[..., None]
    terms = fractions.residues * held / (z[..., None] - np.exp(p * period))
    return z**-whole * terms.sum(axis=-1)


def _held(poles: Complexes, duration: float) -> Complexes:
    """(e^{p t} - 1) / p, t at p = 0."""
    exponent = poles * duration
    grown = np.expm1(exponent)
    return np.divide(grown, poles, out=np.full_like(poles, duration), where=poles != 0.0)


def _distinct(poles: Complexes) -> Complexes:
    gaps = np.abs(poles[:, None] - poles[None, :]) + np.diag(np.full(poles.size, np.inf))
    if gaps.min() <= DISTINCT * np.abs(poles).max():
        raise ValueError(
            "the device has two equal poles, which partial fractions do not allow: give it some"
            " damping to ground, or use the linear boundary alone"
        )
    return poles

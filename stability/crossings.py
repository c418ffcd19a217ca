"""All gains at which an eigenvalue of A - k b c is on the unit circle, in one eigenproblem.

z is an eigenvalue of A - k b c (and not of A) iff 1 + k g(z) = 0, g(z) = c (z I - A)^-1 b. For a
real k and |z| = 1, g(z) = g(1/z) = conj g(z): every crossing, of whatever k, is a zero of g(z) -
g(1/z), and these zeros are the finite eigenvalues of the symplectic pencil

    [A - z I     0       b  ]
    [   0     I - z A  -z b ]
    [   c       -c       0  ]

QZ finds all of them at once. Between two neighbouring gains of the list no eigenvalue can pass the
circle, so the eigenvalues at one gain decide for the whole interval, and no band of instability is
missed. False gains in the list do no harm (each only splits an interval in two), so zeros up to
`NEAR_CIRCLE` off the circle are accepted, where rounding moves a simple zero by 1e-13 and a double
one by 1e-7.

Limits: an eigenvalue of A on the circle cancels in g(z) - g(1/z) and reappears as a false zero, so
zeros closer than `NEAR_POLE` to an eigenvalue of A are dropped: a mode that decays by less per tick
counts as undamped. At z = 1, where rounding moves a double eigenvalue by 1e-8, the distance is
`NEAR_ONE`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigvals, matrix_balance

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
NEAR_CIRCLE = 1e-2
NEAR_POLE = 1e-9
NEAR_ONE = 1e-6
LARGEST_STEP = 1e-4


class Crossings(NamedTuple):
    """Gains k > 0 in rising order and the angles [rad], in [0, pi], of z = exp(j angle) there.

    departures: d(ln|z|)/dk, positive if the eigenvalue leaves the circle outwards.
    """

    gains: Floats
    angles: Floats
    departures: Floats


def crossings(a: Floats, b: Floats, c: Floats) -> Crossings:
    """Return every k > 0 at which A - k b c has an eigenvalue on the unit circle.

    a (M, M), b (M,), c (M,). The result may also contain gains at which no eigenvalue crosses.
    """
    a, b, c = _balanced(a, b, c)
    poles = np.linalg.eigvals(a).astype(np.complex128)
    angles = _candidates(a, b, c)
    angles = angles[_distance(angles, poles) > np.where(angles < NEAR_ONE, NEAR_ONE, NEAR_POLE)]
    bound = np.minimum(LARGEST_STEP, 0.5 * _distance(angles, poles))
    angles = _polished(angles, bound, *_response(a, b, c, np.exp(1j * angles)))
    response, slope = _response(a, b, c, np.exp(1j * angles))
    with np.errstate(divide="ignore"):
        gains = -1.0 / response.real
    kept = np.flatnonzero((gains > 0.0) & np.isfinite(gains))
    kept = kept[np.argsort(gains[kept], kind="stable")]
    # 1 + k g = 0: dz/dk = -g / (k g'), and d ln|z| = Re(dz / z).
    z = np.exp(1j * angles[kept])
    departures = (-response[kept] / (gains[kept] * slope[kept] * z)).real
    return Crossings(gains[kept], np.abs(angles[kept]), departures)


def _balanced(a: Floats, b: Floats, c: Floats) -> tuple[Floats, Floats, Floats]:
    """Scale the states so that rows and columns of A have equal norms; g does not change."""
    scaled, (scale, _) = matrix_balance(a, permute=False, separate=True)
    return scaled.astype(np.float64), b / scale, c * scale


def _candidates(a: Floats, b: Floats, c: Floats) -> Floats:
    m = b.size
    left, right = np.zeros((2, 2 * m + 1, 2 * m + 1))
    left[:m, :m], right[:m, :m] = a, np.eye(m)
    left[m:-1, m:-1], right[m:-1, m:-1] = np.eye(m), a
    left[:m, -1] = right[m:-1, -1] = b / np.linalg.norm(b)
    left[-1, :m] = c / np.linalg.norm(c)
    left[-1, m:-1] = -left[-1, :m]
    numerator, denominator = np.asarray(eigvals(left, right, homogeneous_eigvals=True))
    near = np.abs(np.abs(numerator) - np.abs(denominator)) < NEAR_CIRCLE * np.abs(denominator)
    zeros = numerator[near] / denominator[near]
    return np.append(np.angle(zeros[zeros.imag >= 0.0]), [0.0, np.pi])


def _distance(angles: Floats, poles: Complexes) -> Floats:
    return np.abs(np.exp(1j * angles)[:, None] - poles[None, :]).min(axis=1)


def _response(a: Floats, b: Floats, c: Floats, z: Complexes) -> tuple[Complexes, Complexes]:
    """g(z) and dg/dz = -c (z I - A)^-2 b at several z, by two solves each."""
    system = z[:, None, None] * np.eye(b.size) - a
    states = np.linalg.solve(system, np.broadcast_to(b[:, None], (z.size, b.size, 1)))[..., 0]
    costates = np.linalg.solve(
        system.transpose(0, 2, 1), np.broadcast_to(c[:, None], (z.size, b.size, 1))
    )[..., 0]
    return states @ c, -np.sum(costates * states, axis=1)


def _polished(angles: Floats, bound: Floats, response: Complexes, slope: Complexes) -> Floats:
    """One Newton step on the phase of g(exp(j angle)) towards the real axis.

    d arg g / d angle = Re(z g'/g). A candidate that is not a crossing has no such phase nearby, so
    the step is bounded by the largest displacement that rounding can cause, and by half the
    distance to the nearest pole.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        phase = np.arctan(response.imag / response.real)
        step = phase / (np.exp(1j * angles) * slope / response).real
    return np.where(np.abs(step) < bound, angles - step, angles)

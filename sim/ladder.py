"""The chain as a ladder of impedances: its response at m1, in closed form.

Seen from m1, the rest of the chain hangs in series with its link, and so on down to the last mass:

    D_n = m_n s^2 + b_n s,    D_i = m_i s^2 + b_i s + L_i D_{i+1} / (L_i + D_{i+1}),    L = k + b s,

and force = (k0 + D_1) x position. With D_i = p_i / q_i the recursion needs no division:

    q_i = L_i q_{i+1} + p_{i+1},    p_i = (m_i s^2 + b_i s) q_i + L_i p_{i+1},

p_1 = det(M s^2 + C s + K) and q_1 = the same without m1, so p_1 has the poles of position over
force as its roots, q_1 the zeros (both for k0 = 0; `dynamic_stiffness` adds k0).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zwidth.sim.chain import Chain, Floats

Complexes = NDArray[np.complex128]


def determinants(chain: Chain, s: ArrayLike) -> tuple[Complexes, Complexes]:
    """Return (p_1, q_1) at complex s [rad/s], each of the shape of s; k0 is left out.

    The chain's arrays may have further axes after the first; they broadcast against s.
    """
    s = np.asarray(s, dtype=np.complex128)
    own = [(m * s + b) * s for m, b in zip(chain.masses, chain.ground_dampers, strict=True)]
    p, q = own[-1], np.ones_like(own[-1])
    for i in reversed(range(len(own) - 1)):
        link = chain.link_springs[i] + chain.link_dampers[i] * s
        q, below = link * q + p, p
        p = own[i] * q + link * below
    return p, q


def dynamic_stiffness(chain: Chain, s: ArrayLike) -> Complexes:
    """Return force at m1 over position of m1 [N m/rad | N/m] at complex s [rad/s], shape of s."""
    p, q = determinants(chain, s)
    return chain.ground_spring + p / q


def frequency_response(chain: Chain, frequency: ArrayLike) -> Complexes:
    """Return position of m1 over force at m1 [rad/(N m) | m/N] at frequency [Hz], same shape.

    At 0 Hz it is infinite for a chain without ground spring.
    """
    s = 2j * np.pi * np.asarray(frequency, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        return 1.0 / dynamic_stiffness(chain, s)


def scaled(chain: Chain, inertia: float, rate: float) -> Chain:
    """Return the chain with masses multiplied by inertia and frequencies by rate."""
    return Chain(
        chain.masses * inertia,
        chain.ground_dampers * (inertia * rate),
        chain.ground_spring * (inertia * rate**2),
        chain.link_springs * (inertia * rate**2),
        chain.link_dampers * (inertia * rate),
    )


def to_vector(chain: Chain) -> Floats:
    """Return (masses, ground dampers, link springs, link dampers) as one vector, (4n - 2,)."""
    return np.concatenate(
        [chain.masses, chain.ground_dampers, chain.link_springs, chain.link_dampers]
    )


def from_vector(values: Floats, ground_spring: float = 0.0) -> Chain:
    """Return the chain of such a vector, unvalidated; axes after the first are kept."""
    n = (values.shape[0] + 2) // 4
    masses, dampers, springs, links = np.split(values, [n, 2 * n, 3 * n - 1])
    return Chain(masses, dampers, ground_spring, springs, links)

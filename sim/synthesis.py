"""Finds every chain with a given response, by removing one mass after another.

Let D = P/N be force over position at m1: P of degree 2n with P(0) = 0, N monic of degree 2n - 2.
Division gives D = m1 s^2 + a s + r + R/N. The ladder (`sim/ladder.py`) with link L = k (1 + u s)
and A = L + D_2 = m2 N/N' (N, N' monic) reads

    D = m1 s^2 + (b1 + k u) s + k - L^2/A,    L^2/A = (k^2/m2) (1 + u s)^2 N'/N,

hence kappa N - R = (k^2/m2) (1 + u s)^2 N' with kappa = k^2 u^2/m2: the left side has a double root
at s = -1/u, which is therefore a stationary point of R/N, a root of R'N - R N'. Each real u
(0 for a link without damper) gives kappa, then g = k^2/m2 and N' by division, then
h = k/m2 = N(0)/N'(0) because D_2(0) = 0, so k = g/h, m2 = g/h^2, b1 = a - k u; and
D_2 = (m2 N - L N')/N' is the same problem with one mass fewer. All real solutions are found. Of
15 000 random responses with damping ratios up to 0.3, each had exactly one with positive masses and
springs (with absurd dampers where v > omega); with overdamped modes there may be none or several.
"""

from collections.abc import Iterator

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike

from zwidth.sim.chain import Chain, Floats
from zwidth.sim.ladder import Complexes, determinants, from_vector, to_vector

REAL = 1e-6


def chains(stiffness: Floats, minor: Floats) -> Iterator[Chain]:
    """Yield every chain with positive masses and springs whose D is stiffness / minor.

    Coefficients in ascending powers of s, in units that keep them near one: stiffness (2n + 1,)
    with stiffness[0] = 0, minor (2n - 1,) with minor[-1] = 1. Accurate to about 1e-8 (roots of
    polynomials); `polish` makes it exact.
    """
    degree = minor.size - 1
    if degree == 0:
        if stiffness[2] > 0.0:
            yield Chain(stiffness[2:], stiffness[1:2], 0.0, np.empty(0), np.empty(0))
        return
    quotient, short = map(_floats, polynomial.polydiv(stiffness, minor))
    rest = np.pad(short, (0, degree - short.size))
    for u in _link_times(rest, minor):
        power = (-1.0) ** np.arange(degree + 1) * u ** np.arange(degree, -1.0, -1.0)
        kappa = float(rest @ power[:-1]) / float(minor @ power)
        product = kappa * minor - np.append(rest, 0.0)
        factor = _without_double_root(product, u)
        g, following = factor[-1], factor / factor[-1]
        h = minor[0] / following[0]
        if not (g > 0.0 and h > 0.0 and quotient[2] > 0.0):
            continue
        spring, damper = g / h, u * g / h
        remaining = (g / h**2) * minor
        remaining[:-2] -= spring * following
        remaining[1:-1] -= damper * following
        remaining[0] = 0.0
        for below in chains(remaining, following):
            yield Chain(
                np.append(quotient[2], below.masses),
                np.append(quotient[1] - damper, below.ground_dampers),
                0.0,
                np.append(spring, below.link_springs),
                np.append(damper, below.link_dampers),
            )


def _link_times(rest: Floats, minor: Floats) -> Iterator[float]:
    """Yield the real u = -1/s where R/N is stationary; u = 0 where that s is infinite."""
    stationary = polynomial.polysub(
        polynomial.polymul(polynomial.polyder(rest), minor),
        polynomial.polymul(rest, polynomial.polyder(minor)),
    )
    size = 2 * minor.size - 3
    stationary = np.pad(stationary, (0, max(0, size - stationary.size)))[:size]
    in_u = (stationary * (-1.0) ** np.arange(size))[::-1]
    for u in polynomial.polyroots(in_u):
        if abs(u.imag) <= REAL * max(abs(u), REAL):
            yield float(u.real)


def _floats(values: ArrayLike) -> Floats:
    return np.asarray(values, dtype=np.float64)


def _without_double_root(product: Floats, u: float) -> Floats:
    """Divide by (1 + u s)^2, from the side where the recursion is stable."""
    if abs(u) > 1.0:
        return _floats(polynomial.polydiv(product, [1.0, 2.0 * u, u * u])[0])
    factor = np.zeros(product.size)
    for k in range(product.size - 2):
        factor[k] = product[k] - 2.0 * u * factor[k - 1] - u * u * factor[k - 2]
    return factor[:-2]


def polish(
    chain: Chain, poles: Complexes, zeros: Complexes, damping: float, inertia: float
) -> Chain:
    """Return the chain near this one with exactly these poles and zeros (Newton's method).

    poles, zeros: the roots of the quadratic factors, only one of a complex pair; damping = sum of
    the ground dampers; inertia = m1. The determinants are affine in every parameter, so a
    difference of any size is their exact derivative.
    """
    x = to_vector(chain)
    n = chain.masses.size
    best, smallest = x, np.inf
    for _ in range(5):
        step = _sizes(x, n)
        sets = np.column_stack([x, x[:, None] + np.diag(step)])
        p, _ = determinants(from_vector(sets[:, :, None]), poles)
        _, q = determinants(from_vector(sets[:, :, None]), zeros)
        at_roots = np.hstack([p, q])
        equations = np.column_stack(
            [at_roots.real, at_roots.imag, sets[n : 2 * n].sum(axis=0) - damping, sets[0] - inertia]
        )
        slope = (equations[1:] - equations[0]).T
        row = np.abs(slope).max(axis=1)
        used = row > 0.0
        error = equations[0, used] / row[used]
        if np.abs(error).max() < smallest:
            best, smallest = x, np.abs(error).max()
        x = x - np.linalg.lstsq(slope[used] / row[used, None], error)[0] * step
    return from_vector(best)


def _sizes(x: Floats, n: int) -> Floats:
    """Return a natural size for each parameter: zero dampers must not freeze."""
    chain = from_vector(x)
    rate = np.sqrt(chain.link_springs.mean() / chain.masses.mean()) if n > 1 else 1.0
    floor = 1e-3 * rate * chain.masses.mean()
    return to_vector(
        Chain(
            np.abs(chain.masses),
            np.maximum(np.abs(chain.ground_dampers), floor),
            0.0,
            np.abs(chain.link_springs),
            np.maximum(np.abs(chain.link_dampers), floor),
        )
    )

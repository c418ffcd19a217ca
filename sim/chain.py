"""The mechanism: masses in a row, each link a spring and a damper, force and encoder at m1.

F, x -> [m1] --k12,b12-- [m2] --k23,b23-- [m3] ...     each mass with a damper to ground,
                                                       m1 with a spring k0 to ground
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.shown import fields_html

Floats = NDArray[np.float64]
MAX_MASSES = 5


class Chain(NamedTuple):
    """A chain of n = 1..5 masses; make it with `make_chain`, which validates.

    masses [kg m2 | kg] (n,), ground_dampers [N m s/rad | N s/m] (n,), ground_spring k0 at m1
    [N m/rad | N/m], link_springs (n-1,), link_dampers (n-1,).
    """

    masses: Floats
    ground_dampers: Floats
    ground_spring: float
    link_springs: Floats
    link_dampers: Floats

    _repr_html_ = fields_html


class Chains(NamedTuple):
    """Many chains of n masses: the fields of `Chain` with a first axis of chains, unvalidated."""

    masses: Floats
    ground_dampers: Floats
    ground_spring: Floats
    link_springs: Floats
    link_dampers: Floats


class Matrices(NamedTuple):
    """M q'' + C q' + K q = f, each (n, n), or (..., n, n) for many."""

    mass: Floats
    damping: Floats
    stiffness: Floats


def make_chain(
    masses: Sequence[float] | Floats,
    ground_dampers: Sequence[float] | Floats,
    ground_spring: float = 0.0,
    link_springs: Sequence[float] | Floats = (),
    link_dampers: Sequence[float] | Floats = (),
) -> Chain:
    """Build a chain; raises ValueError with a sentence: field, value and what is allowed.

    Dampers may be negative (as in some fitted models; see `negative_dampers`), masses and springs
    may not.
    """
    chain = Chain(
        np.array(masses, dtype=np.float64),
        np.array(ground_dampers, dtype=np.float64),
        float(ground_spring),
        np.array(link_springs, dtype=np.float64),
        np.array(link_dampers, dtype=np.float64),
    )
    n = chain.masses.size
    if not 1 <= n <= MAX_MASSES:
        raise ValueError(f"masses has {n} entries; a chain has 1 to {MAX_MASSES}")
    counts = (("ground_dampers", n), ("link_springs", n - 1), ("link_dampers", n - 1))
    for field, expected in counts:
        if getattr(chain, field).size != expected:
            raise ValueError(
                f"{field} has {getattr(chain, field).size} entries; {n} masses need {expected}"
            )
    for field, values in chain._asdict().items():
        finite = np.isfinite(values)
        if not np.all(finite):
            wrong = np.atleast_1d(values)[~np.atleast_1d(finite)][0]
            raise ValueError(f"{field} contains {wrong}; only finite numbers are allowed")
    for field in ("masses", "link_springs"):
        values = getattr(chain, field)
        if np.any(values <= 0.0):
            wrong = values[values <= 0.0][0]
            raise ValueError(f"{field} contains {wrong:g}; only values > 0 are allowed")
    if chain.ground_spring < 0.0:
        raise ValueError(f"ground_spring is {chain.ground_spring:g}; it must be >= 0")
    return chain


def negative_dampers(chain: Chain) -> dict[str, float]:
    """Return the dampers below zero by name (b1, b12, ...): no passive chain has any."""
    named = {f"b{i + 1}": b for i, b in enumerate(chain.ground_dampers)}
    named |= {f"b{i + 1}{i + 2}": b for i, b in enumerate(chain.link_dampers)}
    return {name: float(value) for name, value in named.items() if value < 0.0}


def matrices(chain: Chain | Chains) -> Matrices:
    """Assemble M, C, K of a chain (n, n), or of many (..., n, n); n = number of masses."""
    n, each = chain.masses.shape[-1], np.arange(chain.masses.shape[-1])
    mass, damping, stiffness = np.zeros((3, *chain.masses.shape[:-1], n, n))
    mass[..., each, each] = chain.masses
    damping[..., each, each] = chain.ground_dampers
    stiffness[..., 0, 0] = chain.ground_spring
    link = np.array([[1.0, -1.0], [-1.0, 1.0]])
    for i in range(n - 1):
        ends = slice(i, i + 2)
        stiffness[..., ends, ends] += chain.link_springs[..., i, None, None] * link
        damping[..., ends, ends] += chain.link_dampers[..., i, None, None] * link
    return Matrices(mass, damping, stiffness)


def rigid_body(chain: Chain) -> Chain:
    """Collapse all masses into one, keeping total inertia, ground damping and k0 (Fig. 7)."""
    return make_chain([chain.masses.sum()], [chain.ground_dampers.sum()], chain.ground_spring)

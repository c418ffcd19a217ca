"""Tables of learned laws: the positions of their points and their forces."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_law import points_of, table_values

Floats = NDArray[np.float64]
BOTH_WAYS = 0.3  # share of the largest state on one side that the other must reach for an odd law
MET = 10  # samples nearest to a point; fewer do not determine the force there


def law_at(law: Physics, states: Floats) -> Floats:
    """Return the force of a learned law at some states (...,)."""
    s, f = np.array(points_of(law.values)).T
    return _through(s, f, is_odd(law), law.values["period"], states)


def _through(s: Floats, f: Floats, odd: bool, period: float, states: Floats) -> Floats:
    """The curve at states (n,) through forces f (points,) or (points, laws) at states s."""
    x = np.asarray(states, dtype=np.float64)
    if period > 0.0:
        x = s[0] + np.mod(x - s[0], period)
        s, f = np.concatenate([s - period, s, s + period]), np.concatenate([f, f, f])
    elif odd:
        s, f = np.concatenate([-s[:0:-1], s]), np.concatenate([-f[:0:-1], f])
    slopes = np.gradient(f, s, axis=0, edge_order=1 if s.size == 2 else 2)
    smooth = CubicHermiteSpline(s, f, slopes, axis=0)
    return np.asarray(smooth(np.clip(x, s[0], s[-1])))


def left_out(law: Physics) -> Floats:
    """Return the likely error of a table at each of its points (points,)."""
    s, f = np.array(points_of(law.values)).T
    return left_out_of(s, f, is_odd(law), law.values["period"])


def left_out_of(s: Floats, f: Floats, odd: bool = False, period: float = 0.0) -> Floats:
    """Return the likely error of a curve through laws f (points, ...) at each of its states s.

    A cubic through points h apart with tangents from differences has an error of order h^3, so its
    error is an eighth of that of a curve without the point. Ends have the error of their
    neighbours; an odd law is known at zero.
    """
    found = np.zeros_like(f)
    if s.size < (3 if odd or period > 0.0 else 4):
        return found
    inner = range(s.size) if period > 0.0 else range(1, s.size - 1)
    for k in inner:
        at, forces = np.delete(s, k), np.delete(f, k, axis=0)
        found[k] = np.abs(_through(at, forces, odd, period, s[k]) - f[k]) / 8.0
    if period == 0.0:
        found[0], found[-1] = 0.0 if odd else found[1], found[-2]
    return found


def is_odd(law: Physics) -> bool:
    """Whether a law's table is over |s|."""
    return law.values["odd"] > 0.5


def points_over(seen: Floats, count: int, odd: bool, period: float = 0.0) -> Floats | None:
    """Return states for a table over visited states (samples,); None if these do not suffice.

    An odd law needs samples on both sides. Points are halfway between the quantiles of the samples
    and even spacing, since a law shows at the ends, which are seldom visited. A state with few
    values (a command of some levels) gets fewer points. The points of a periodic law are even over
    its period.
    """
    if period > 0.0:
        return period * np.arange(count) / count
    low, high = float(seen.min()), float(seen.max())
    if odd and min(-low, high) < BOTH_WAYS * max(-low, high):
        return None
    share = np.linspace(0.0, 1.0, count)
    even = (0.0 if odd else low) + share * (max(-low, high) if odd else high - low)
    where = np.sort(np.abs(seen) if odd else seen)
    at = 0.5 * (np.quantile(where, share) + even)
    at[0], at[-1] = even[0], even[-1]
    return None if np.any(np.diff(at) <= 0.0) else _met(at, where)


def between(at: Floats, seen: Floats) -> Floats:
    """Return states of a table (points,) with one more between each two, if it has samples."""
    return _met(np.sort(np.concatenate([at, 0.5 * (at[1:] + at[:-1])])), np.sort(seen))


def _met(at: Floats, where: Floats) -> Floats:
    """The states that are nearest to enough samples, and the ends; where: sorted samples."""
    while at.size > 2:
        edges = np.searchsorted(where, 0.5 * (at[1:] + at[:-1]))
        nearest = np.diff(edges)
        k = int(np.argmin(nearest))
        if nearest[k] >= MET:
            break
        at = np.delete(at, k + 1)
    return at


def table(
    effect: str, at: str, states: Floats, forces: Floats, odd: bool, period: float = 0.0
) -> Physics:
    """Return a law through points (states, forces), each (points,)."""
    points: Sequence[tuple[float, float]] = list(zip(states.tolist(), forces.tolist(), strict=True))
    return make_physics(effect, at, **table_values(points, odd, period))


def basis(law: Physics, states: Floats, odd: bool, at: Floats) -> Floats:
    """Return the contribution of each free point of another table at states (points, numbers)."""
    units = np.eye(states.size)[:, int(odd) :]
    return _through(states, units, odd, law.values["period"], at)

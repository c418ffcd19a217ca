"""Tables of laws of no name: where their points stand, and what they give."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_law import points_of, table_values

Floats = NDArray[np.float64]


def law_at(law: Physics, states: Floats) -> Floats:
    """Return the force of a table over one state at some states (...,)."""
    s, f = np.array(points_of(law.values)).T
    return through(s, f, is_odd(law), law.values["period"], states)


def through(s: Floats, f: Floats, odd: bool, period: float, states: Floats) -> Floats:
    """Return the curve at states (n,) through points s (points,) of f (points,) or (points, laws).

    The interpolation of `sim/physics/free_law.py`.
    """
    x = np.asarray(states, dtype=np.float64)
    if period > 0.0:
        x = s[0] + np.mod(x - s[0], period)
        s, f = np.concatenate([s - period, s, s + period]), np.concatenate([f, f, f])
    elif odd:
        s, f = np.concatenate([-s[:0:-1], s]), np.concatenate([-f[:0:-1], f])
    slopes = np.gradient(f, s, axis=0, edge_order=1 if s.size == 2 else 2)
    smooth = CubicHermiteSpline(s, f, slopes, axis=0)
    return np.asarray(smooth(np.clip(x, s[0], s[-1])))


def basis(at: Floats, odd: bool, period: float, states: Floats) -> Floats:
    """Return what each point of a table (points,) adds to it at states (n,): (n, numbers).

    The first point of an odd table is at 0 and adds nothing: it has no column.
    """
    return through(at, np.eye(at.size)[:, int(odd) :], odd, period, states)


def left_out_of(s: Floats, f: Floats, odd: bool = False, period: float = 0.0) -> Floats:
    """Return the likely error of a curve through f (points, ...) at states s, at each point.

    A cubic through points h apart with tangents from differences errs as h^3, so that of every
    other point an eighth of what the curve through its neighbours misses it by is left: that is
    told by leaving each point out. Ends err as their neighbours do; what an odd law is at nothing
    is known.
    """
    found = np.zeros_like(f)
    if s.size < (3 if odd or period > 0.0 else 4):
        return found
    inner = range(s.size) if period > 0.0 else range(1, s.size - 1)
    for k in inner:
        at, forces = np.delete(s, k), np.delete(f, k, axis=0)
        found[k] = np.abs(through(at, forces, odd, period, s[k]) - f[k]) / 8.0
    if period == 0.0:
        found[0], found[-1] = 0.0 if odd else found[1], found[-2]
    return found


def is_odd(law: Physics) -> bool:
    """Whether a law's table is of |s|."""
    return law.values["odd"] > 0.5


def points_over(
    seen: Floats, count: int = 16, odd: bool = False, period: float = 0.0, both_ways: float = 0.3
) -> Floats | None:
    """Return at most so many states for a table over those seen (samples,); None where none fit.

    Half by where the recording was, half evenly: the ends are where a law shows, and are seldom
    visited. Fewer where a state takes few values, as a command of some levels does. Of a law that
    repeats they stand evenly over its period. An odd law must have been seen on both sides, to this
    share (both_ways) of the larger one.
    """
    if period > 0.0:
        return period * np.arange(count) / count
    low, high = float(seen.min()), float(seen.max())
    if odd and min(-low, high) < both_ways * max(-low, high):
        return None
    share = np.linspace(0.0, 1.0, count)
    even = (0.0 if odd else low) + share * (max(-low, high) if odd else high - low)
    where = np.sort(np.abs(seen) if odd else seen)
    at = 0.5 * (np.quantile(where, share) + even)
    at[0], at[-1] = even[0], even[-1]
    return None if np.any(np.diff(at) <= 0.0) else met(at, where)


def between(at: Floats, seen: Floats) -> Floats:
    """Return states of a table (points,) with one more between each two, where samples tell it."""
    return met(np.sort(np.concatenate([at, 0.5 * (at[1:] + at[:-1])])), np.sort(seen))


def met(at: Floats, where: Floats, enough: int = 10) -> Floats:
    """Return the ends of some states and those that enough samples are nearest to; where: sorted.

    A point that fewer samples are nearest to says nothing of the force there.
    """
    while at.size > 2:
        edges = np.searchsorted(where, 0.5 * (at[1:] + at[:-1]))
        nearest = np.diff(edges)
        k = int(np.argmin(nearest))
        if nearest[k] >= enough:
            break
        at = np.delete(at, k + 1)
    return at


def table(
    effect: str, at: str, states: Floats, forces: Floats, odd: bool, period: float = 0.0
) -> Physics:
    """Return a law of points (states, forces), each (points,)."""
    points: Sequence[tuple[float, float]] = list(zip(states.tolist(), forces.tolist(), strict=True))
    return make_physics(effect, at, **table_values(points, odd, period))

"""Chooses the number of points of a learned table, and whether it is odd or acts in one direction.

A fit of a table of many points determines their forces f with the precision P, all else free: with
the information A, P = A_ff - A_fo A_oo^-1 A_of. A table of fewer numbers g with f = B g (fewer
points, or an odd law over |s|) costs to second order

    (f - B g)' P (f - B g) + ln det B'PB + 2 sum_k ln range_k - k ln 2 pi,    range_k ~ |g_k|,

minimised over g, as `selection.evidence` rates every hypothesis. So one fit shows which points pay:
points are removed one at a time, always the one that costs least, and the cheapest table is fitted.

If no hypothesis is true, a likelihood is overconfident by the factor phi of `evidence.compared`. P
and the gain of a fit are then divided by phi (`tempered`). Otherwise a table of sixteen points fits
errors that do not depend on its state.

A law that only rises, or only falls, has steps of one sign: its numbers are its first value and its
steps, each equally likely in every octave like all magnitudes. Steps are smaller than levels, so
such a law costs less if it is true, by 2 sum ln |g_k| / |g_k - g_(k-1)|. The constraint is also
applied to second order. Limit: it is not applied if a constant in the law is equivalent to another
origin.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from zwidth.diagnosis.learning.tables import basis, is_odd, points_over, table
from zwidth.diagnosis.learning.where import held
from zwidth.diagnosis.selection.evidence import freedom
from zwidth.diagnosis.selection.hypothesis import SWEEP, Hypothesis, against, judged, priced
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_law import FORCE, points_of

Floats = NDArray[np.float64]
FEWEST = {False: 3, True: 2}  # points of a law, by whether it is odd
REFINED = 3  # most times that points are added between those that pay
ODD = 12  # least initial points of an odd law
JUDGED = 1e-9  # of the largest of P, added to its diagonal: a sum of forces may be unknown


@dataclass(frozen=True)
class Known:
    """The last table of a fit: indices in x, scales, forces, and their precision P.

    others, follows: as in `precision_of`. held: whether one point is fixed, because a constant is
    equivalent to another origin; P is then that of differences.
    """

    which: NDArray[np.int64]
    scales: Floats
    forces: Floats
    precision: Floats
    others: NDArray[np.int64]
    follows: Floats
    held: bool = False


def tempered(h: Hypothesis, phi: float) -> float:
    """Return the cost of a hypothesis with misfit and information divided by phi, in -2 ln."""
    return h.cost.total - (1.0 - 1.0 / phi) * h.cost.misfit - h.x.size * math.log(phi)


def refined(
    h: Hypothesis,
    phi: float,
    pays: Callable[[Hypothesis, float], Hypothesis],
    finer: Callable[[Hypothesis], Hypothesis],
) -> Hypothesis:
    """Return a law with the points that pay, after adding points between them and removing again.

    So points gather where the law bends: at a corner, or at a bump narrower than the original
    spacing. pays: returns the law with the points that pay for some phi; finer: returns a law with
    more points, or the same if these are not believed.
    """
    best = h = pays(h, phi)
    for _ in range(REFINED):
        more = finer(h)
        if more is h:
            break
        phi = against(more, h).phi
        h = pays(more, phi)
        best = min((best, more, h), key=lambda one: tempered(one, phi))
    return best


def known(h: Hypothesis, phi: float = 1.0) -> Known:
    """Return the last table of a fit with its precision; phi: overconfidence of the likelihood."""
    last = len(h.model.effects) - 1
    own = [
        (j, p.scale, p.key)
        for j, p in enumerate(h.model.parameters)
        if p.kind == "effect" and p.index == last and p.key in FORCE
    ]
    which = np.array([j for j, _, _ in own])
    scales = np.array([scale for _, scale, _ in own])
    law = h.model.effects_at(h.x)[-1]
    forces = np.array([law.values[key] for _, _, key in own])
    p, others, follows = precision_of(h, which, scales, phi)
    count = len(points_of(law.values))
    if which.size == count - int(is_odd(law)):
        return Known(which, scales, forces, p, others, follows)
    apart = np.eye(count)
    apart[:, held(count)] -= 1.0  # differences of all points from the fixed one
    apart = np.delete(apart, held(count), axis=0)
    every = np.array([f for _, f in points_of(law.values)])
    return Known(which, scales, every, apart.T @ p @ apart, others, follows, held=True)


def precision_of(
    h: Hypothesis, which: NDArray[np.int64], scales: Floats, phi: float
) -> tuple[Floats, NDArray[np.int64], Floats]:
    """Return the precision (numbers, numbers) of parameters in their own units, all else free.

    which: their indices in x, in units of their scales. Also returns the indices of the others, and
    how far each of these moves with each number, (others, numbers).
    """
    assert h.slopes is not None
    others = np.setdiff1d(np.arange(h.x.size), which)
    a = h.slopes.T @ h.slopes
    inverse = np.linalg.pinv(a[np.ix_(others, others)], hermitian=True)
    follows = -inverse @ a[np.ix_(others, which)]
    p = a[np.ix_(which, which)] + a[np.ix_(which, others)] @ follows
    p = 0.5 * (p + p.T)
    p += JUDGED * float(np.diag(p).max()) * np.eye(which.size)
    return p / np.outer(scales, scales) / phi, others, follows / scales


def nearest(basis: Floats, target: Floats, precision: Floats) -> tuple[Floats, float]:
    """Return y (fewer,) with basis @ y nearest to a target of known precision, and its cost."""
    a = basis.T @ precision @ basis
    y = np.asarray(
        np.linalg.lstsq(a, basis.T @ precision @ target, rcond=1e-12)[0], dtype=np.float64
    )
    off = target - basis @ y
    deviation = np.sqrt(np.maximum(np.diag(np.linalg.pinv(a, hermitian=True)), 0.0))
    ranges = SWEEP * np.maximum(np.abs(y), deviation)
    paid = freedom(a, ranges.tolist()) if np.all(ranges > 0.0) else math.inf
    return y, float(off @ precision @ off) + paid


@dataclass(frozen=True)
class Shape:
    """A table with fewer numbers, and its cost relative to others of the same fit."""

    law: Physics
    cost: float


def shapes(h: Hypothesis, seen: Floats, phi: float = 1.0) -> list[Shape]:
    """Return a fit's cheapest table that is not odd, and the cheapest odd one, if possible."""
    law = h.model.effects_at(h.x)[-1]
    there, states = known(h, phi), np.array(points_of(law.values))[:, 0]
    if is_odd(law):
        return [_fewer(law, there, states, states, True)]
    found = [_fewer(law, there, states, states, False)]
    period = law.values["period"]
    most = max(ODD, states.size // 2 + 1)
    odd = None if period > 0.0 else points_over(seen, most, True)
    return found if odd is None else [*found, _fewer(law, there, states, odd, True)]


def spared(h: Hypothesis, seen: Floats) -> float:
    """Return how much less a hypothesis would cost with only the points that pay (`shapes`)."""
    law = h.model.effects_at(h.x)[-1]
    states = np.array(points_of(law.values))[:, 0]
    now = _priced(law, known(h), states, states, is_odd(law)).cost
    return max(0.0, now - min(shape.cost for shape in shapes(h, seen)))


def _fewer(law: Physics, there: Known, states: Floats, begin: Floats, odd: bool) -> Shape:
    """The table with the initial points that pay; its ends stay."""
    best = _priced(law, there, states, begin, odd)
    cheapest = best
    while best.at.size > FEWEST[odd]:
        fewer = [np.delete(best.at, k) for k in range(1, best.at.size - 1)]
        best = min((_priced(law, there, states, at, odd) for at in fewer), key=lambda one: one.cost)
        cheapest = best if best.cost < cheapest.cost else cheapest
    forces = np.concatenate([[0.0], cheapest.g]) if odd else cheapest.g
    period = law.values["period"]
    own = table(law.effect.name, law.at, cheapest.at, forces, odd, period)
    return Shape(own, cheapest.cost)


class _Priced(NamedTuple):
    """A table of numbers g (numbers,) at states (points,), and its cost."""

    at: Floats
    g: Floats
    cost: float


def _priced(law: Physics, there: Known, states: Floats, at: Floats, odd: bool) -> _Priced:
    """A table with points at some states, as near as possible to the known one."""
    columns = basis(law, at, odd, states[int(is_odd(law)) :])
    free = np.arange(columns.shape[1])
    if there.held and not odd:
        free = np.delete(free, held(at.size))
        columns = columns[:, free]
    g, cost = nearest(columns, there.forces, there.precision)
    every = np.zeros(at.size - int(odd))
    every[free] = g
    return _Priced(at, every, cost)


def one_way(h: Hypothesis, phi: float = 1.0) -> Hypothesis:
    """Return a hypothesis whose last table only rises or only falls, if that costs less."""
    law, there = h.model.effects_at(h.x)[-1], known(h, phi)
    if law.values["period"] > 0.0 or there.held:
        return h
    first = 0.0 if is_odd(law) else None
    free = _ranges(there, there.forces, np.eye(there.forces.size))
    best = h
    for way in (1.0, -1.0):
        g = _nearest_one_way(there, way, first)
        steps = _steps(g.size)
        less = sum(np.log(_ranges(there, g, steps))) - sum(np.log(free))
        x = h.x.copy()
        x[there.which] += (g - there.forces) / there.scales
        x[there.others] += there.follows @ (g - there.forces)
        if not np.array_equal(h.model.within(x), x) and np.any(g != there.forces):
            x = h.model.within(x)
        other = h if np.array_equal(x, h.x) else priced(_at(h, x))
        cost = replace(other.cost, freedom=other.cost.freedom + 2.0 * float(less))
        other = replace(other, cost=cost)
        if tempered(other, phi) < tempered(best, phi):
            best = other
    return best


def _at(h: Hypothesis, x: Floats) -> Hypothesis:
    return judged(h.experiments, h.model, x, h.family, h.family.near(h.ratio), h.prices)


def _steps(count: int) -> Floats:
    """Rows that compute steps of forces; the first step is from zero."""
    rows = np.eye(count)
    rows[1:, :-1] -= np.eye(count - 1)
    return rows


def _ranges(there: Known, g: Floats, rows: Floats) -> Floats:
    """Ranges of numbers rows @ g, at least their uncertainty."""
    spread = rows @ np.linalg.pinv(there.precision, hermitian=True) @ rows.T
    return SWEEP * np.maximum(np.abs(rows @ g), np.sqrt(np.maximum(np.diag(spread), 1e-300)))


def _nearest_one_way(there: Known, way: float, first: float | None) -> Floats:
    """The forces that only rise (way 1) or fall (-1) and are nearest to the known ones."""
    count = there.forces.size
    sums = np.tril(np.ones((count, count)))  # forces from steps
    root = np.linalg.cholesky(there.precision).T
    low, high = np.zeros(count), np.full(count, np.inf)
    if first is None:  # the first level is free
        low[0] = -np.inf
    else:  # steps from zero
        low[0] = 0.0
    if way < 0.0:
        low, high = -high, -low
    found = lsq_linear(root @ sums, root @ there.forces, (low, high)).x
    return np.asarray(sums @ found, dtype=np.float64)

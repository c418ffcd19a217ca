"""When the force of an event begins and ends, by the likelihood of each possible time.

A force of free shape may be arbitrarily small for arbitrarily long, so its beginning depends on the
description of its shape. Here the force is a polyline over [b, e) with values at b, at e and at
knots between, and zero elsewhere: it may start suddenly (a jam, a stop) or rise from zero (a hand).
Near the fitted force f, a force g at each tick gives the whitened innovations r + S (g - f) in its
window, where S are the slopes through sticking and slipping. With G = S'S and p = S' (S f - r), a
polyline B c with values c has

    |r|^2 = const - p'B (B'G B)^-1 B'p

at its best. The cost, as of every hypothesis, is |r|^2 divided by the overdispersion w, plus ln det
A + 2 sum ln range - k ln 2 pi for the values, each uniform up to the largest of them in both
directions, plus the same for the places of the m knots in the window, less 2 ln m! since their
order is arbitrary. Knots are added and removed while that pays, for every b and e anew. The
interval of b (with e at its best) contains the times that cost at most 7.35 more than the best: for
a force that starts suddenly, -2 ln of the likelihood ratio is distributed as xi, P(xi <= z) = (1 -
exp(-z / 2))^2 (Hansen, Econometrica 68, 2000); for one that rises from zero it is a chi-square of
one degree of freedom, which is smaller. A force acts during a whole tick, so an interval is
extended by one tick.

w is the overdispersion of the recording, or of the window under the best polyline if that is
larger, so that an error which no polyline describes does not sharpen the times.

A long event is first sought in bins of several ticks each, and its edges then to a tick, in bins of
one tick near them. The best polyline is also the force that is reported for a long event, since
hats at fixed places overshoot beside a sudden start.

Limits: several pulses are one polyline, from the beginning of the first to the end of the last. A
jam of a mass that friction already holds begins only when the motion shows it.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.uncertainty import inflation
from zwidth.diagnosis.learning.event_force import FAR, Happened, Window, slope_of
from zwidth.diagnosis.selection.evidence import freedom
from zwidth.diagnosis.selection.hypothesis import Hypothesis
from zwidth.diagnosis.settings import EVIDENCE
from zwidth.sim.place import place_at

Floats = NDArray[np.float64]
Knots = tuple[int, ...]
PLACES, MOST = 32, 24  # evenly spaced places for knots, and the most knots
NEAR = (1, 2, 4, 8)  # bins from both ends, where knots may be too
GRID = 16  # times that are tried first
CELLS = 200  # bins in which edges are sought first, of several ticks in a longer window
BESIDE = 2  # of these bins on both sides, in which an edge is then sought tick by tick
TURNS = 3  # alternations of beginning and end, each with the other at its best
HALF = 0.5  # tick: the force of a tick is at its middle
LITTLE = 1e-12  # relative information that counts as none, such as while a mass sticks

Edge = tuple[float, float, float]  # earliest, most likely, latest


@dataclass
class Polylines:
    """The cost of polylines, from G (bins, bins) and p (bins,) of the bins of their window.

    rest: the constant; rows: number of r; wide: overdispersion; at (bins + 1,): ticks where bins
    begin and end, one tick each by default; costs: cost and inner knots by both ends, in bins.
    """

    squares: Floats
    pulls: Floats
    rest: float
    rows: int
    wide: float
    at: Floats = field(default_factory=lambda: np.zeros(0))
    knots: Knots = ()
    costs: dict[tuple[int, int], tuple[float, Knots]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Use bins of one tick if `at` is not given."""
        if not self.at.size:
            self.at = np.arange(self.bins + 1.0)

    @property
    def bins(self) -> int:
        """The number of bins."""
        return self.pulls.size

    def edges(self, begins: int, ends: int) -> tuple[Edge, Edge]:
        """Return beginning and end with their intervals, in ticks, sought from two bins."""
        first, last = (0, ends - 1), (begins + 1, self.bins)
        for turn in range(TURNS):
            before = begins, ends, self.wide
            of_first = partial(self.cost, ends=ends)
            asked = first if turn else _evenly(*first)
            begins, first = _sought(of_first, [begins, *asked], 0, ends - 1)
            of_last = partial(self.cost, begins)
            asked = last if turn else _evenly(*last)
            ends, last = _sought(of_last, [ends, *asked], begins + 1, self.bins)
            self.knots = self.costs[begins, ends][1]
            left = self.rows - 4 - 2 * len(self.knots)
            self.wide = max(self.wide, self.solved(begins, ends, self.knots).chi2 / left)
            if (begins, ends, self.wide) == before:
                break
            self.costs.clear()
        self.costs = {(begins, ends): (0.0, self.knots)}
        return self._edge(begins, first), self._edge(ends, last)

    def _edge(self, bin: int, between: tuple[int, int]) -> Edge:
        first, likeliest, last = self.at[[between[0], bin, between[1]]].tolist()
        return first - 1.0, likeliest, last + 1.0

    def best(self) -> "Polyline":
        """Return the best polyline, after `edges`."""
        ((begins, ends), (_, knots)) = next(iter(self.costs.items()))
        return self.solved(begins, ends, knots)

    def cost(self, begins: int, ends: int) -> float:
        """Return the cost of the best polyline from one bin to another."""
        key = begins, ends
        if key not in self.costs:
            inner = tuple(k for k in self.knots if begins < k < ends)
            self.costs[key] = self._improved(begins, ends, inner)
        return self.costs[key][0]

    def _improved(self, begins: int, ends: int, inner: Knots) -> tuple[float, Knots]:
        """Add and remove knots while that pays."""
        even = np.linspace(begins, ends, PLACES + 1).round().astype(np.int64).tolist()
        near = [begins + d for d in NEAR] + [ends - d for d in NEAR]
        places = sorted({k for k in (*even, *near, *self.knots) if begins < k < ends})
        best = self._priced(begins, ends, inner), inner
        while True:
            fewer = [tuple(k for k in best[1] if k != gone) for gone in best[1]]
            more = [tuple(sorted((*best[1], k))) for k in places if k not in best[1]]
            tried = [*fewer, *(more if len(best[1]) < MOST else [])]
            new = min(((self._priced(begins, ends, k), k) for k in tried), default=best)
            if new[0] >= best[0]:
                return best
            best = new

    def solved(self, begins: int, ends: int, inner: Knots) -> "Polyline":
        """Return the polyline with the best values for its ends and inner knots."""
        own = 0.5 * (self.at[begins:ends] + self.at[begins + 1 : ends + 1])
        knots = self.at[[begins, *inner, ends]]
        hats = np.array([np.interp(own, knots, unit) for unit in np.eye(knots.size)])
        hats = hats if ends - begins > 1 else np.ones((1, 1))
        there = slice(begins, ends)
        a = hats @ self.squares[there, there] @ hats.T
        pull = hats @ self.pulls[there]
        values = np.asarray(np.linalg.lstsq(a, pull, rcond=LITTLE)[0], dtype=np.float64)
        return Polyline(self.rest - float(pull @ values), values, own, knots, hats)

    def _priced(self, begins: int, ends: int, inner: Knots) -> float:
        line = self.solved(begins, ends, inner)
        moves = np.vstack([line.hats, line.by_knots])
        there, count = slice(begins, ends), line.values.size
        known = moves @ self.squares[there, there] @ moves.T / self.wide
        deviation = 1.0 / np.sqrt(np.maximum(np.diag(known)[:count], 1e-300))
        ranges = np.maximum(2.0 * float(np.abs(line.values).max()), deviation)
        ranges = np.append(ranges, np.full(len(inner), self.at[-1] - self.at[0]))
        known += np.diag(12.0 / ranges**2)  # the variance of the uniform prior
        chosen = 2.0 * math.lgamma(len(inner) + 1.0)
        return line.chi2 / self.wide + freedom(known, ranges.tolist()) - chosen


class Polyline(NamedTuple):
    """A polyline: |r|^2, the best values at its knots, the middles of its bins, and its hats."""

    chi2: float
    values: Floats
    own: Floats
    knots: Floats
    hats: Floats

    @property
    def by_knots(self) -> Floats:
        """The change of the force when each inner knot moves by a tick (knots, bins)."""
        if self.knots.size <= 2:
            return np.zeros((0, self.own.size))
        slopes = np.diff(self.values) / np.diff(self.knots)
        piece = np.searchsorted(self.knots, self.own, side="right") - 1
        return -slopes[piece] * self.hats[1:-1]


def edges(h: Hypothesis, one: Happened) -> tuple[Edge, Edge, Happened]:
    """Return when a force begins and ends, in ticks from its first, with 95 % intervals.

    Also returns the event, if long, with the most likely force for these edges. h: fitted with all
    other events known, but not this one.
    """
    beside = max(8, (one.last - one.first) // 3)
    ticks = h.experiments[one.recording].ticks
    window = Window(h, one.recording, max(0, one.first - beside), min(ticks, one.last + beside))
    low = max(0, one.first - beside, window.begins)
    high = min(ticks, one.last + beside, window.ends)
    about, wide = _About(window, one), inflation(h.residual[: h.samples])
    cell = math.ceil((high - low) / CELLS)
    at = np.append(np.arange(low, high, cell), high)
    lines = about.polylines(at, wide)
    begins = min(max(0, _bin(at, min(p.first for p in one.pulses))), lines.bins - 2)
    ends = min(max(begins + 1, _bin(at, max(p.first + p.ticks for p in one.pulses))), lines.bins)
    first, last = lines.edges(begins, ends)
    if cell > 1:
        fine = [np.arange(edge[1] - BESIDE * cell, edge[1] + BESIDE * cell + 1.0)
                for edge in (first, last)]  # fmt: skip
        at = np.unique(np.concatenate([at, *fine]).clip(low, high).astype(np.int64))
        knots = lines.at[list(lines.knots)]
        lines = about.polylines(at, lines.wide)
        lines.knots = tuple(_bin(at, int(k)) for k in knots)
        about_first, about_last = first, last
        first, last = lines.edges(_bin(at, round(first[1])), _bin(at, round(last[1])))
        first = _no_shorter(first, about_first, BESIDE * cell)
        last = _no_shorter(last, about_last, BESIDE * cell)
    if any(len(p.shapes[0][1]) > 1 for p in one.pulses):  # it lasts
        one = _of_polyline(one, lines)
    return _moved(first, -one.first), _moved(last, -one.first), one


def _bin(at: NDArray[np.int64], tick: int) -> int:
    """The bin that contains a tick."""
    return int(np.searchsorted(at, tick, side="right")) - 1


def _of_polyline(one: Happened, lines: Polylines) -> Happened:
    """The event with the best polyline as its force, and its covariance for known edges."""
    line = lines.best()
    there = np.arange(math.floor(line.knots[0]), math.ceil(line.knots[-1])) + HALF
    first, last = min(one.first, int(line.knots[0])), max(one.last, int(line.knots[-1]))
    hats = np.array([np.interp(there, line.knots, unit) for unit in np.eye(line.values.size)])
    basis = np.zeros((last - first, line.values.size))
    basis[int(line.knots[0]) - first : int(line.knots[-1]) - first] = hats.T
    bins = slice(*np.searchsorted(lines.at, line.knots[[0, -1]]))
    known = line.hats @ lines.squares[bins, bins] @ line.hats.T
    size = FAR * max(float(np.abs(one.force).max()), 1e-300)  # while a mass sticks
    covariance = np.linalg.inv(known / lines.wide + np.eye(known.shape[0]) / size**2)
    return replace(
        one, first=first, last=last, force=basis @ line.values,
        covariance=basis @ covariance @ basis.T,
    )  # fmt: skip


def _no_shorter(edge: Edge, cells: Edge, beside: int) -> Edge:
    """A refined edge, its interval extended to that in cells beyond the refined part."""
    low, at, high = cells
    return (
        min(edge[0], low) if at - low > beside else edge[0],
        edge[1],
        max(edge[2], high) if high - at > beside else edge[2],
    )


def _moved(edge: Edge, by: int) -> Edge:
    return edge[0] + by, edge[1] + by, edge[2] + by


class _About:
    """The innovations of a window for forces near the fitted force f, averaged in bins."""

    def __init__(self, window: Window, one: Happened) -> None:
        self.window, self.row = window, place_at(one.source.place).row(window.dof)
        self.own = np.zeros(window.ends - window.begins)
        self.own[one.first - window.begins : one.last - window.begins] = one.force

    def polylines(self, at: NDArray[np.int64], wide: float) -> Polylines:
        """Return the polylines over bins of ticks; at (bins + 1,): where these begin and end."""
        ticks = np.arange(self.own.size) + self.window.begins
        bins = np.array([(ticks >= a) & (ticks < b) for a, b in pairwise(at.tolist())], np.float64)
        f = (bins @ self.own) / bins.sum(axis=1)
        own = f @ bins
        r, unit, slopes = self.window.white(own, self.row), 1e-6, list[Floats]()
        for there in bins:
            unit, slope = slope_of(
                lambda by, t=there: self.window.white(own + by * t, self.row), r, unit
            )
            slopes.append(slope)
        by = np.array(slopes)
        without = r - f @ by
        rest = float(without @ without)
        return Polylines(by @ by.T, -(by @ without), rest, r.size, wide, at.astype(np.float64))


def _evenly(low: int, high: int) -> list[int]:
    return np.linspace(low, high, GRID).round().astype(np.int64).tolist()


def _sought(
    cost: Callable[[int], float], begin: Sequence[int], low: int, high: int
) -> tuple[int, tuple[int, int]]:
    """Return the tick of least cost, and the first and last that cost less than 7.35 more.

    Gaps beside these are halved until closed. begin: ticks that are tried first.
    """
    known = {k: cost(k) for k in sorted(set(begin)) if low <= k <= high}
    while True:
        best = min(known, key=lambda k: known[k])
        inside = [k for k in known if known[k] <= known[best] + EVIDENCE.dated]
        gaps = ((min(inside), -1), (max(inside), 1), (best, -1), (best, 1))
        halves = [_halved(known, end, way, low, high) for end, way in gaps]
        asked = {k for k in halves if k is not None}
        if not asked:
            return best, (min(inside), max(inside))
        known |= {k: cost(k) for k in asked}


def _halved(known: Mapping[int, float], end: int, way: int, low: int, high: int) -> int | None:
    """The middle of the gap beside a tick on one side, None if there is no gap."""
    beyond = [k for k in known if (k - end) * way > 0]
    other = min(beyond, key=lambda k: abs(k - end), default=(low if way < 0 else high) + way)
    return (end + other) // 2 if abs(other - end) > 1 else None

"""When a force of an event begins and when it ends, by the likelihood of every time for either.

A force that may have any shape may also be as small as it likes for as long as it likes, so that
when it begins is a question of how its shape is described. Here it is a polyline over [b, e), with
values at b, at e and at knots between, and nothing before b and from e on: it may set in at once (a
jam, a stop) or rise from nothing (a hand). About the force f that was fitted the whitened
innovations r of its window are r + S (g - f) for a force g at each tick, S their slopes through
what sticks and gives way. So with G = S'S and p = G f - S'r a polyline B c of values c has

    |r|^2 = const - p'B (B'G B)^-1 B'p

at its best, and costs what every hypothesis costs: that over its overdispersion w, and ln det A +
2 sum ln range - k ln 2 pi for its values, anywhere within the largest of them to both sides, and
for where its m knots stand, anywhere in the window, less 2 ln m! since none of them is the first.
Knots are added and taken away while that pays, at every b and e anew. Of b (e at its best) the
times that cost less than `DATED` more than the best are the interval: of a force that sets in at
once -2 ln of the likelihood ratio falls off by xi, P(xi <= z) = (1 - exp(-z / 2))^2 (Hansen,
Econometrica 68, 2000); of one that rises from nothing it is a chi-square of one, which is less. A
force acts all through a tick, and what costs as much lies between the last tick that does not and
its neighbour, so that an interval reaches a tick beyond.

w is that of the recording, or that of the window under the best polyline where it is more: what no
polyline follows is then no knowledge of times.

What lasts long is first sought in cells of several ticks each, and its edges then to a tick where
knots stand as they did in cells.

Limits: of several pulses the first begins and the last ends, all in one polyline. A jam that holds
a mass that friction held already begins when that is seen.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.uncertainty import inflation
from zwidth.diagnosis.learning.event_force import Happened, Window, units
from zwidth.diagnosis.selection.evidence import freedom
from zwidth.diagnosis.selection.hypothesis import Hypothesis
from zwidth.sim.place import place_at

Floats = NDArray[np.float64]
Knots = tuple[int, ...]
PLACES, MOST = 32, 24  # that a knot may stand at, evenly, and how many knots there may be
NEAR = (1, 2, 4, 8)  # ticks from both ends, where one may stand as well
DATED = -2.0 * math.log(1.0 - math.sqrt(0.95))  # 7.35
GRID = 16  # times that are asked first
CELLS = 200  # in which edges are sought first; what is longer has cells of several ticks
BESIDE = 2  # cells to both sides, in which an edge is then sought to a tick, its knots as they are
TURNS = 3  # of beginning and end, each with the other at its best
HALF = 0.5  # a tick, from its first to where its force stands
LITTLE = 1e-12  # of what is known, that is nothing: of what sticks nothing is known

Edge = tuple[float, float, float]  # first, likeliest, last


@dataclass
class Polylines:
    """What polylines cost, by G (ticks, ticks) and p of the ticks they may stand in.

    rest: the constant; rows: of r; wide: overdispersion; knots: the best that are known, without
    ends; costs: by both ends.
    """

    squares: Floats
    pulls: Floats
    rest: float
    rows: int
    wide: float
    knots: Knots = ()
    costs: dict[tuple[int, int], tuple[float, Knots]] = field(default_factory=dict)

    @property
    def ticks(self) -> int:
        """Where it may begin and end: 0 to so many."""
        return self.pulls.size

    def edges(self, begins: int, ends: int) -> tuple[Edge, Edge]:
        """Return beginning and end with their intervals, in ticks; sought from two of them on."""
        wide = math.ceil(self.ticks / CELLS)
        if wide == 1:
            return self._edges(begins, ends)
        cells = self.in_cells(wide)
        begins = min(begins // wide, cells.ticks - 2)
        ends = min(max(ends // wide, begins + 1), cells.ticks)
        first, last = cells._edges(begins, ends)
        self.wide, inner = cells.wide, [k * wide for k in cells.knots]
        b, e = (min(round(at) * wide, self.ticks) for at in (first[1], last[1]))

        def cost(begins: int, ends: int) -> float:
            return self._priced(begins, ends, tuple(k for k in inner if begins < k < ends))

        def within(cell: Edge, low: int, high: int, of: Callable[[int], float]) -> Edge:
            """The edge to a tick, in the cells beside; its interval no shorter than of cells."""
            about = round(cell[1]) * wide
            low, high = max(low, about - BESIDE * wide), min(high, about + BESIDE * wide)
            costs = {k: of(k) for k in range(low, high + 1)}
            best = min(costs, key=lambda k: costs[k])
            near = [k for k in costs if costs[k] <= costs[best] + DATED]
            near += [round(c) * wide for c in (cell[0] + 1.0, cell[2] - 1.0)
                     if abs(c - cell[1]) > BESIDE]  # fmt: skip
            return _edge(best, (min(near), max(near)))

        first = within(first, 0, e - 1, partial(cost, ends=e))
        b = round(first[1])
        return first, within(last, b + 1, self.ticks, partial(cost, b))

    def in_cells(self, wide: int) -> "Polylines":
        """Return the same with so many ticks taken together, which all have one force."""
        starts = np.arange(0, self.ticks, wide)
        squares = np.add.reduceat(np.add.reduceat(self.squares, starts, 0), starts, 1)
        pulls = np.add.reduceat(self.pulls, starts)
        return Polylines(squares, pulls, self.rest, self.rows, self.wide)

    def _edges(self, begins: int, ends: int) -> tuple[Edge, Edge]:
        first, last = (0, ends - 1), (begins + 1, self.ticks)
        for turn in range(TURNS):
            before = begins, ends, self.wide
            of_first = partial(self.cost, ends=ends)
            asked = first if turn else _evenly(*first)
            begins, first = _sought(of_first, [begins, *asked], 0, ends - 1)
            of_last = partial(self.cost, begins)
            asked = last if turn else _evenly(*last)
            ends, last = _sought(of_last, [ends, *asked], begins + 1, self.ticks)
            self.knots = self.costs[begins, ends][1]
            left = self.rows - 4 - 2 * len(self.knots)
            self.wide = max(self.wide, self._solved(begins, ends, self.knots).chi2 / left)
            if (begins, ends, self.wide) == before:
                break
            self.costs.clear()
        return _edge(begins, first), _edge(ends, last)

    def cost(self, begins: int, ends: int) -> float:
        """What the best polyline from a tick to another costs."""
        key = begins, ends
        if key not in self.costs:
            start = tuple(k for k in self.knots if begins < k < ends)
            self.costs[key] = self._improved(begins, ends, start)
        return self.costs[key][0]

    def _improved(self, begins: int, ends: int, inner: Knots) -> tuple[float, Knots]:
        """Knots added and taken away while that pays."""
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

    def _solved(self, begins: int, ends: int, inner: Knots) -> "_Polyline":
        """A polyline at its best."""
        own = np.arange(begins, ends, dtype=np.float64) + HALF
        knots = np.array([begins, *inner, ends], dtype=np.float64)
        hats = np.array([np.interp(own, knots, unit) for unit in np.eye(knots.size)])
        hats = hats if ends - begins > 1 else np.ones((1, 1))
        there = slice(begins, ends)
        a = hats @ self.squares[there, there] @ hats.T
        pull = hats @ self.pulls[there]
        values = np.asarray(np.linalg.lstsq(a, pull, rcond=LITTLE)[0], dtype=np.float64)
        return _Polyline(self.rest - float(pull @ values), values, own, knots, hats)

    def _priced(self, begins: int, ends: int, inner: Knots) -> float:
        line = self._solved(begins, ends, inner)
        moves = np.vstack([line.hats, line.by_knots])
        there, count = slice(begins, ends), line.values.size
        known = moves @ self.squares[there, there] @ moves.T / self.wide
        deviation = 1.0 / np.sqrt(np.maximum(np.diag(known)[:count], 1e-300))
        ranges = np.maximum(2.0 * float(np.abs(line.values).max()), deviation)
        ranges = np.append(ranges, np.full(len(inner), float(self.ticks)))
        known += np.diag(12.0 / ranges**2)  # uniform: no direction is known worse
        chosen = 2.0 * math.lgamma(len(inner) + 1.0)
        return line.chi2 / self.wide + freedom(known, ranges.tolist()) - chosen


class _Polyline(NamedTuple):
    """|r|^2 with its best values at its knots; ticks that it stands in, what a value adds there."""

    chi2: float
    values: Floats
    own: Floats
    knots: Floats
    hats: Floats

    @property
    def by_knots(self) -> Floats:
        """What moving each inner knot by a tick adds (knots, ticks)."""
        if self.knots.size <= 2:
            return np.zeros((0, self.own.size))
        slopes = np.diff(self.values) / np.diff(self.knots)
        piece = np.searchsorted(self.knots, self.own, side="right") - 1
        return -slopes[piece] * self.hats[1:-1]


def edges(h: Hypothesis, one: Happened) -> tuple[Edge, Edge]:
    """Return when a force begins and ends, in ticks from its first, with 95 % intervals.

    h: judged on recordings that know of all other events, and not of this one.
    """
    beside = max(8, (one.last - one.first) // 3)
    ticks = h.experiments[one.recording].ticks
    low, high = max(0, one.first - beside), min(ticks, one.last + beside)
    window = Window(h, one.recording, low, high)
    low, high = max(low, window.begins), min(high, window.ends)
    lines = _linear(window, one, low, high, inflation(h.residual[: h.samples]))
    begins = min(max(0, min(p.first for p in one.pulses) - low), lines.ticks - 2)
    ends = min(max(begins + 1, max(p.first + p.ticks for p in one.pulses) - low), lines.ticks)
    first, last = lines.edges(begins, ends)
    off = low - one.first
    return _moved(first, off), _moved(last, off)


def _moved(edge: Edge, by: int) -> Edge:
    return edge[0] + by, edge[1] + by, edge[2] + by


def _linear(window: Window, one: Happened, low: int, high: int, wide: float) -> Polylines:
    """What polylines from a tick to another leave of the innovations of a window."""
    count = window.ends - window.begins
    row = place_at(one.source.place).row(window.dof)
    at = np.arange(low, high) - window.begins
    own = np.zeros(count)
    own[one.first - window.begins : one.last - window.begins] = one.force
    r = window.white(own, row)

    def white(f: Floats) -> Floats:
        force = own.copy()
        force[at] += f
        return window.white(force, row)

    unit = units(white, r, at.size)
    slopes = np.array([(white(u * e) - r) / u for u, e in zip(unit, np.eye(at.size), strict=True)])
    squares, pulls = slopes @ slopes.T, slopes @ r
    f = own[at]
    rest = float(r @ r) - 2.0 * float(pulls @ f) + float(f @ squares @ f)
    return Polylines(squares, squares @ f - pulls, rest, r.size, wide)


def _evenly(low: int, high: int) -> list[int]:
    return np.linspace(low, high, GRID).round().astype(np.int64).tolist()


def _edge(at: int, between: tuple[int, int]) -> Edge:
    return between[0] - 1.0, float(at), between[1] + 1.0


def _sought(
    cost: Callable[[int], float], begin: Sequence[int], low: int, high: int
) -> tuple[int, tuple[int, int]]:
    """Return the tick of the least cost, and the first and last that cost less than `DATED` more.

    Gaps beside these are halved until they are closed. begin: ticks that are asked first.
    """
    known = {k: cost(k) for k in sorted(set(begin)) if low <= k <= high}
    while True:
        best = min(known, key=lambda k: known[k])
        inside = [k for k in known if known[k] <= known[best] + DATED]
        gaps = ((min(inside), -1), (max(inside), 1), (best, -1), (best, 1))
        halves = [_halved(known, end, way, low, high) for end, way in gaps]
        asked = {k for k in halves if k is not None}
        if not asked:
            return best, (min(inside), max(inside))
        known |= {k: cost(k) for k in asked}


def _halved(known: Mapping[int, float], end: int, way: int, low: int, high: int) -> int | None:
    """The middle of the gap that one tick has on one side, None where it is closed."""
    beyond = [k for k in known if (k - end) * way > 0]
    other = min(beyond, key=lambda k: abs(k - end), default=(low if way < 0 else high) + way)
    return (end + other) // 2 if abs(other - end) > 1 else None

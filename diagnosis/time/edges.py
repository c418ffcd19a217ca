"""When a force of an event begins and when it ends, by the likelihood of every time for either.

A force that may have any shape may also be as small as it likes for as long as it likes, so that
when it begins is a question of how its shape is described. Here it is a polyline over [b, e), with
values at b, at e and at knots between, and nothing before b and from e on: it may set in at once (a
jam, a stop) or rise from nothing (a hand). About the force f that was fitted the whitened
innovations r of its window are r + S (g - f) for a force g at each tick, S their slopes through
what sticks and gives way. So with G = S'S and p = G f - S'r a polyline B c of values c has

    |r|^2 = const - p'B (B'G B)^-1 B'p

at its best, and costs what every hypothesis costs: that over its overdispersion w, and ln det A +
2 sum ln range - k ln 2 pi for its values, anywhere within the largest of them to both sides. Knots
stand evenly, as many as cost least. Of b (e at its best) the times that cost less than
`CHANGES.dated` more than the best are the interval: of a force that sets in at once -2 ln of the
likelihood ratio falls off by xi, P(xi <= z) = (1 - exp(-z / 2))^2 (Hansen, Econometrica 68, 2000);
of one that rises from nothing it is a chi-square of one, which is less. A force acts all through a
tick, and what costs as much lies between the last tick that does not and its neighbour, so that an
interval reaches a tick beyond. What lasts is asked in steps of several ticks, some 250 in all.

w is that of the recording, or that of the window under the best polyline where it is more: what no
polyline follows is then no knowledge of times.

Limits: of several pulses the first begins and the last ends, all in one polyline. A jam that holds
a mass that friction held already begins when that is seen.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.uncertainty import inflation
from zwidth.diagnosis.selection.evidence import freedom
from zwidth.diagnosis.selection.hypothesis import Hypothesis
from zwidth.diagnosis.settings import CHANGES
from zwidth.diagnosis.time.force import Happened, Window, units

Floats = NDArray[np.float64]
Edge = tuple[float, float, float]  # first, likeliest, last


def edges(h: Hypothesis, one: Happened, most: int = 250) -> tuple[Edge, Edge]:
    """Return when a force begins and ends, in ticks from its first, with 95 % intervals.

    h: judged on recordings that know of all other events, and not of this one. most: steps in which
    it is asked when.
    """
    beside = max(8, (one.last - one.first) // 3)
    ticks = h.experiments[one.recording].ticks
    window = Window(h, one.recording, max(0, one.first - beside), min(ticks, one.last + beside))
    low, high = max(one.first - beside, window.begins), min(one.last + beside, window.ends)
    step = max(1, math.ceil((high - low) / most))
    own = np.zeros(window.ticks)
    own[one.first - window.begins : one.last - window.begins] = one.force
    count = (high - low) // step
    span = slice(low - window.begins, low - window.begins + count * step)
    r = window.along(one.source, own)

    def white(f: Floats) -> Floats:
        force = own.copy()
        force[span] += np.repeat(f, step)
        return window.along(one.source, force)

    unit = units(white, r, count)
    slopes = np.array([(white(u * e) - r) / u for u, e in zip(unit, np.eye(count), strict=True)])
    squares, pulls = slopes @ slopes.T, slopes @ r
    f = own[span].reshape(count, step).mean(axis=1)
    rest = float(r @ r) - 2.0 * float(pulls @ f) + float(f @ squares @ f)
    lines = Polylines(
        squares, squares @ f - pulls, rest, r.size, inflation(h.residual[: h.samples])
    )
    begins = min(max(0, (min(p.first for p in one.pulses) - low) // step), count - 2)
    ends = (max(p.first + p.ticks for p in one.pulses) - low) // step
    first, last = lines.edges(begins, min(max(begins + 1, ends), count))
    return _in_ticks(first, low - one.first, step), _in_ticks(last, low - one.first, step)


def _in_ticks(edge: Edge, first: int, step: int) -> Edge:
    return first + step * edge[0], first + step * edge[1], first + step * edge[2]


@dataclass
class Polylines:
    """What polylines cost, by G (steps, steps) and p of the steps they may stand in.

    rest: the constant; rows: of r; wide: overdispersion; costs: by both ends, and with how many
    pieces.
    """

    squares: Floats
    pulls: Floats
    rest: float
    rows: int
    wide: float
    costs: dict[tuple[int, int], tuple[float, int]] = field(default_factory=dict)

    def edges(self, begins: int, ends: int, turns: int = 3) -> tuple[Edge, Edge]:
        """Return beginning and end with their intervals, in steps; sought from two of them on.

        turns: of each with the other at its best.
        """
        size = self.pulls.size
        first, last = (0, ends - 1), (begins + 1, size)
        for _ in range(turns):
            before = begins, ends, self.wide
            begins, first = _sought(partial(self.cost, ends=ends), begins, 0, ends - 1)
            ends, last = _sought(partial(self.cost, begins), ends, begins + 1, size)
            line = self._best(begins, ends, self.costs[begins, ends][1])
            self.wide = max(self.wide, line.chi2 / (self.rows - 3 - line.values.size))
            if (begins, ends, self.wide) == before:
                break
            self.costs.clear()
        return (first[0] - 1.0, begins, first[1] + 1.0), (last[0] - 1.0, ends, last[1] + 1.0)

    def cost(self, begins: int, ends: int) -> float:
        """What the best polyline from a step to another costs."""
        if (begins, ends) not in self.costs:
            pieces = [1, 2, 3, 4, 6, 8, 12, 16, 24]
            asked = [n for n in pieces if n <= ends - begins] or [1]
            self.costs[begins, ends] = min((self._best(begins, ends, n).cost, n) for n in asked)
        return self.costs[begins, ends][0]

    def _best(self, begins: int, ends: int, pieces: int) -> "_Polyline":
        own = np.arange(begins, ends) + 0.5  # where the force of a step stands
        knots = np.linspace(begins, ends, pieces + 1)
        hats = np.array([np.interp(own, knots, unit) for unit in np.eye(knots.size)])
        hats = hats if ends - begins > 1 else np.ones((1, 1))
        there = slice(begins, ends)
        a, pull = hats @ self.squares[there, there] @ hats.T, hats @ self.pulls[there]
        # Of what sticks nothing is known: its value is the smallest.
        values = np.asarray(np.linalg.lstsq(a, pull, rcond=1e-12)[0], dtype=np.float64)
        chi2 = self.rest - float(pull @ values)
        known = a / self.wide
        deviation = 1.0 / np.sqrt(np.maximum(np.diag(known), 1e-300))
        ranges = np.maximum(2.0 * float(np.abs(values).max()), deviation)
        known += np.diag(12.0 / ranges**2)  # uniform: no direction is known worse
        return _Polyline(chi2, values, chi2 / self.wide + freedom(known, ranges.tolist()))


class _Polyline(NamedTuple):
    """|r|^2 with its best values at its knots (pieces + 1,), and what it costs."""

    chi2: float
    values: Floats
    cost: float


def _sought(
    cost: Callable[[int], float], begin: int, low: int, high: int, grid: int = 16
) -> tuple[int, tuple[int, int]]:
    """Return the step of the least cost, and the first and last that cost less than `dated` more.

    Asked on a grid, then in the gaps beside these, halved until they are closed.
    """
    even: Sequence[int] = np.linspace(low, high, grid).round().astype(np.int64).tolist()
    known = {k: cost(k) for k in sorted({*even, min(max(begin, low), high)})}
    while True:
        best = min(known, key=lambda k: known[k])
        inside = [k for k in known if known[k] <= known[best] + CHANGES.dated]
        asked: set[int] = set()
        for end, way in ((min(inside), -1), (max(inside), 1), (best, -1), (best, 1)):
            beyond = [k for k in known if (k - end) * way > 0]
            if beyond:
                other = min(beyond, key=lambda k: abs(k - end))
                if abs(other - end) > 1:
                    asked.add((end + other) // 2)
        if not asked:
            return best, (min(inside), max(inside))
        known |= {k: cost(k) for k in asked}

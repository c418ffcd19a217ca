"""Compare a log with its replay, bit by bit, block after block."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.shown import fields_html
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
TIME = "time"


class Difference(NamedTuple):
    """The first place where a log and its replay differ.

    tick k and time t [s] of the sample; topic "/tick" or "/substep"; channel, "time" if a sample is
    additional, missing or displaced; the value logged and the value replayed (None: no sample).
    """

    tick: int
    time: float
    topic: str
    channel: str
    logged: float | None
    replayed: float | None

    def __str__(self) -> str:
        logged, replayed = (
            "nothing" if value is None else repr(value) for value in (self.logged, self.replayed)
        )
        return (
            f"tick {self.tick} (t = {self.time:.9g} s), {self.topic} {self.channel}: logged"
            f" {logged}, replayed {replayed}"
        )

    _repr_html_ = fields_html


class Found(NamedTuple):
    """A difference at a place in a block."""

    place: int
    channel: str
    logged: float | None
    replayed: float | None


@dataclass
class Comparison:
    """One topic of a log, compared with a replay that comes in blocks.

    per_tick: samples in a tick. whole: every replayed sample must be in the log; if parts of the
    log are lost, only the remaining ones are compared. Samples are matched by their times.
    """

    topic: str
    logged: Trace
    period: float
    per_tick: int
    whole: bool
    _order: Ints = field(init=False)
    _sorted: Floats = field(init=False)
    _next: int = 0
    _ticks: int = 0

    def __post_init__(self) -> None:
        self._order = np.argsort(self.logged.t, kind="stable")
        self._sorted = self.logged.t[self._order]

    @property
    def exhausted(self) -> bool:
        """Whether all logged samples have been compared."""
        return self._next == self._order.size

    def block(self, replayed: Trace) -> Difference | None:
        """Compare the next block of the replay; return its first difference."""
        count = len(replayed)
        half = 0.5 * float(np.diff(replayed.t).min()) if count > 1 else 0.5 * self.period
        end = max(self._next, int(np.searchsorted(self._sorted, replayed.t[-1] + half)))
        rows, self._next = self._order[self._next : end], end
        edges = 0.5 * (replayed.t[1:] + replayed.t[:-1])
        places = np.searchsorted(edges, self.logged.t[rows])
        first_tick, self._ticks = self._ticks, self._ticks + count // self.per_tick
        candidates = [_miscounted(places, replayed)] if self.whole else []
        for name in (TIME, *replayed.channels):
            candidates.append(self._differing(rows, places, replayed, name))
        found = [c for c in candidates if c is not None]
        if not found:
            return None
        first = min(found, key=lambda f: f.place)
        tick = first_tick + first.place // self.per_tick
        return Difference(tick, float(replayed.t[first.place]), self.topic, *first[1:])

    def rest(self) -> Difference | None:
        """Return the first logged sample beyond the end of the replay."""
        if self.exhausted:
            return None
        t = float(self._sorted[self._next])
        tick = round(t / self.period) if np.isfinite(t) else self._ticks
        return Difference(tick, t, self.topic, TIME, t, None)

    def _differing(self, rows: Ints, places: Ints, replayed: Trace, name: str) -> Found | None:
        time = name == TIME
        logged = (self.logged.t if time else self.logged[name])[rows]
        again = (replayed.t if time else replayed[name])[places]
        same = logged.view(np.uint64) == again.view(np.uint64)
        wrong = np.flatnonzero(~same & ~(np.isnan(logged) & np.isnan(again)))
        if wrong.size == 0:
            return None
        i = int(wrong[np.argmin(places[wrong])])
        return Found(int(places[i]), name, float(logged[i]), float(again[i]))


def _miscounted(places: Ints, replayed: Trace) -> Found | None:
    """Find the first sample that the log lacks, or has more than once."""
    counts = np.bincount(places, minlength=len(replayed))
    wrong = np.flatnonzero(counts != 1)
    if wrong.size == 0:
        return None
    place = int(wrong[0])
    t = float(replayed.t[place])
    return Found(place, TIME, None, t) if counts[place] == 0 else Found(place, TIME, t, None)

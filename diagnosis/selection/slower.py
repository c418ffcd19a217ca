"""The second judge: compares hypotheses over a longer horizon than the next sample.

If no model is true, one-step errors mislead: a lag, a limit of rate and a further mass explain more
of them than the friction that governs the machine, and displace friction, which free runs need. (A
linear axis under pulses at 1 kHz: in -2 ln, lag and limit of rate gain 58 856 one step ahead and
friction 650; over 50 ms they gain 4810 and 64 788.) So a gain one step ahead may not displace an
effect that a longer horizon needs. If the family contains the truth, both horizons agree and
nothing changes.

Only independent errors count, as without physics (`hypothesis.independent`). Each hypothesis is
first fitted a little with that noise, since its parameters were fitted with another. An unfinished
fit may lag behind by a share of everything that is explained (`PURSUIT.lagging`), and only counts
as worse beyond that: on a recording without noise, a pendulum lagged behind an equivalent ripple of
one turn by more than near rivals do.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from zwidth.diagnosis.account import reason
from zwidth.diagnosis.fitting.descend import descend
from zwidth.diagnosis.noise.family import Family, as_far_as
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.selection.hypothesis import Hypothesis, independent, judged
from zwidth.diagnosis.settings import PURSUIT

FAR_S = 0.05  # [s]: the longer horizon
ROUNDS = 4  # rounds of the descent before a comparison


@dataclass
class Slower:
    """The fits of hypotheses over the horizon `FAR_S`, by structure; plain: without physics."""

    plain: Hypothesis
    family: Family | None = None
    fitted: dict[frozenset[str], Hypothesis] = field(default_factory=dict)

    def prefers(self, old: Hypothesis, new: Hypothesis) -> bool:
        """Whether `old` is clearly better than `new` over the horizon."""
        return self._apart(self._fit(new), self._fit(old))

    def first(self, believed: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Return hypotheses, in front the first that is not clearly worse than the best."""
        best = min(believed, key=lambda h: _cost(self._fit(h)))
        front = next(h for h in believed if h is best or not self.prefers(best, h))
        return [front, *(h for h in believed if h is not front)]

    def ahead_of(
        self, likely: Sequence[Hypothesis], more: Sequence[Hypothesis]
    ) -> list[Hypothesis]:
        """Return those of `more` that are clearly better than all `likely` ones, without a new fit.

        Leaves out those clearly worse than the best of `more`; returns at most as many as `likely`.
        """
        seen = [(there, h) for h in more if (there := self._at(h)) is not None]
        if not likely or not seen:
            return []
        least = min((self._at(h) for h in likely), key=_cost)
        best = min((there for there, _ in seen), key=_cost)
        found = [
            h for there, h in seen if self._apart(least, there) and not self._apart(there, best)
        ]
        return found[: len(likely)]

    def _apart(self, worse: Hypothesis | None, better: Hypothesis | None) -> bool:
        explained = max(_cost(self._fit(self.plain)) - _cost(better), 0.0)
        return _cost(worse) - _cost(better) > PURSUIT.near_rival + PURSUIT.lagging * explained

    def _fit(self, h: Hypothesis) -> Hypothesis | None:
        """A hypothesis fitted a little with this horizon's noise; None without an observer."""
        known = self.fitted.get(h.labels)
        if known is not None and known.experiments is h.experiments:
            return known
        there = self._at(h)
        if there is None:
            return None
        with reason("longer horizon"):
            x = descend(there.far_ground, there.x, ROUNDS, there.creased, first=True).x
            moved = judged(there.experiments, there.model, x, there.family, None, there.prices)
        best = moved if moved.cost.misfit < there.cost.misfit else there
        self.fitted[h.labels] = best
        return best

    def _at(self, h: Hypothesis) -> Hypothesis | None:
        """A hypothesis with this horizon's noise, not fitted; None without an observer."""
        with suppress(NoObserver), reason("longer horizon"):
            if self.family is None:
                far, bare = as_far_as(FAR_S, h.experiments), self.plain
                own = judged(bare.experiments, bare.model, bare.x, far)
                self.family = independent(own, FAR_S).family
            return judged(h.experiments, h.model, h.x, self.family, None, h.prices)
        return None


def _cost(h: Hypothesis | None) -> float:
    return np.inf if h is None else h.cost.misfit

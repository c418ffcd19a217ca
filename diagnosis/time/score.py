"""Which parameter does not stay the same, asked of a fit that holds it constant: a score test.

To first order the residual is r_0 + J d, J its slopes by the parameters. Of a parameter j that is
delta g(t) more than at the end, the slopes are those of j itself times g, since an observer has
forgotten after some ticks what was before: c = g J_j. Fitted together with all d, with A = J'J,

    S = c'r_0 - c'J A^-1 J'r_0,    V = c'c - c'J A^-1 J'c,    delta = -V^-1 S,    gain = S'V^-1 S

in chi-square. So one pass over slopes that are there already asks every parameter for a step at
every time, for a drift, for settling at several rates, for what follows a quantity that was
recorded beside (a temperature: g that quantity), for one recording unlike the others, and for
another value in every recording, of which g has as many rows (a score test: Andrews, Econometrica
61, 1993). Nothing is simulated for it. A change is suspected where its gain pays all that it would
have to pay once fitted: its freedom, by V; how rare changes are; for how many it was asked; and the
odds of `Evidence.alpha`, under the overdispersion that its gain has over stretches of the
recordings. Only what is suspected is fitted (`time.changes`).

Limits: one parameter changes at a time; a change within three times what an observer needs to
settle of either end is not seen, nor are two that undo each other within as many ticks.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.evidence import Compared, compared, freedom
from zwidth.diagnosis.selection.hypothesis import Hypothesis
from zwidth.diagnosis.settings import CHANGES, EVIDENCE

Floats = NDArray[np.float64]
STEP, DRIFT, SETTLES, RUN = "step", "drift", "settling", "run"
FOLLOWS, EACH = "follows", "each recording"
SHAPES = (STEP, DRIFT, SETTLES, RUN, FOLLOWS, EACH)
CUT = (STEP, RUN, EACH)  # hold in parts of the recordings wholly, and not at all in the others


class Followed(NamedTuple):
    """A quantity that a parameter follows: at `origin`, its value at the end, it is as at last."""

    name: str
    unit: str
    origin: float
    span: float

    def share(self, e: Experiment) -> Floats:
        """Return how much of the change holds at each sample (ticks,)."""
        (own,) = (c for c in e.covariates if c.name == self.name)
        return (own.values - self.origin) / self.span

    def over(self, experiments: Sequence[Experiment], ticks: Floats) -> Floats:
        """Return the same at ticks of all recordings, one after the other."""
        every = np.concatenate([self.share(e) for e in experiments])
        return every[np.minimum(ticks.astype(np.int64), every.size - 1)]


@dataclass(frozen=True)
class Suspect:
    """A change that would gain: of which parameter, of which shape, when.

    at: of a step, ticks of all recordings one after the other; between: the same of its 95 %
    interval. rate: of what settles, in ticks; of a run that is unlike the others, where it ends and
    `at` where it begins; rates: of what settles, the 95 % interval. amounts: in x of the parameter;
    one, or where every recording has its own (by name: recordings) those of all but the last. told:
    the gain in -2 ln and its overdispersion. price: of how rare changes are and of having asked for
    so many; freedom: of the amounts. covariate: what it follows. as_well: other courses of the same
    parameter that are not told from it.
    """

    of: str
    shape: str
    at: float
    between: tuple[float, float]
    rate: float
    rates: tuple[float, float]
    amounts: tuple[float, ...]
    told: Compared
    price: float
    freedom: float
    covariate: Followed | None = None
    recordings: tuple[str, ...] = ()
    as_well: tuple[str, ...] = ()

    @property
    def worth(self) -> float:
        """What it would gain, all paid but the odds."""
        return self.told.gain - self.price - self.freedom

    @property
    def course(self) -> str:
        """Its shape in words."""
        if self.covariate is not None:
            return f"following {self.covariate.name}"
        return {STEP: "a step", DRIFT: "a drift over time"}.get(self.shape, self.shape)

    def shares(self, experiments: Sequence[Experiment], ticks: Floats) -> Floats:
        """Return how much of each amount holds at ticks of all recordings (amounts, ticks)."""
        if self.covariate is not None:
            return self.covariate.over(experiments, ticks)[None]
        if self.shape == EACH:
            return _in_each(experiments, ticks)
        return self._over_time(ticks, sum(e.ticks for e in experiments))[None]

    def _over_time(self, ticks: Floats, end: float) -> Floats:
        return _over_time(self.shape, ticks, end, np.array(self.at), np.array(self.rate))

    def held(self, part: Experiment, first: float, end: float) -> tuple[float, ...]:
        """Return how much of each amount holds in a part that begins at a tick of all recordings.

        In the middle of what counts, once an observer has settled; of what follows the mean.
        """
        if self.covariate is not None:
            return (float(self.covariate.share(part)[min(SETTLING, part.ticks // 2) :].mean()),)
        if self.shape == EACH:
            return tuple(float(part.name == name) for name in self.recordings[:-1])
        middle = np.array(first + 0.5 * (SETTLING + part.ticks))
        return (float(self._over_time(middle, end)),)


def _over_time(shape: str, ticks: Floats, end: float, at: Floats, rate: Floats) -> Floats:
    """How much of a change holds at ticks; all are broadcast."""
    if shape == STEP:
        return (ticks < at).astype(np.float64)
    if shape == RUN:
        return ((at <= ticks) & (ticks < rate)).astype(np.float64)
    return np.exp(-ticks / rate) if shape == SETTLES else 1.0 - ticks / end + 0.0 * at


def suspected(h: Hypothesis) -> Suspect | None:
    """Return the change that a fitted hypothesis would gain most by, None where none would pay."""
    smooth = {v.of for v in h.model.varying if v.smooth}  # what is left is that it is cut in parts
    sums = _sums(h)
    every = [s for asked in _asked(h.experiments, sums) for s in _best(h, sums, asked)]
    found = [s for s in every if s.shape in CUT or s.of not in smooth]
    best = max(found, key=lambda s: s.worth, default=None)
    odds = 2.0 * math.log(1.0 / EVIDENCE.alpha)
    if best is None or best.worth <= best.told.phi * odds:
        return None
    alike = [s for s in found if s.of == best.of and s is not best and s.worth > best.worth - odds]
    return replace(best, as_well=tuple(dict.fromkeys(s.course for s in alike)))


class _Sums(NamedTuple):
    """Of blocks of rows: J'J (blocks, p, p), J'r (blocks, p), where they begin, in ticks of all.

    whole: J'J of all rows, inverse: its pseudo-inverse, left: A^-1 J'r, priors among them.
    """

    squares: Floats
    scores: Floats
    begins: Floats
    end: float
    whole: Floats
    inverse: Floats
    left: Floats

    @property
    def middles(self) -> Floats:
        """Middle of each block (blocks,) in ticks of all recordings."""
        return 0.5 * (self.begins + np.append(self.begins[1:], self.end))


def _sums(h: Hypothesis, most: int = 1000, ticks: int = 4) -> _Sums:
    """Sums over at most so many blocks, of at least so many ticks."""
    assert h.slopes is not None
    o, p = h.noise.observer.deviation.size, h.x.size
    rows = [e.ticks - SETTLING for e in h.experiments]
    each = max(ticks, math.ceil(sum(rows) / most))
    squares: list[Floats] = []
    scores: list[Floats] = []
    begins: list[float] = []
    row, before = 0, 0
    for e, own in zip(h.experiments, rows, strict=True):
        for a in range(0, own, each):
            mine = slice((row + a) * o, (row + min(a + each, own)) * o)
            j, r = h.slopes[mine].reshape(-1, p), h.residual[mine]
            squares.append(j.T @ j)
            scores.append(j.T @ r)
            # What was left out while the observer settled is the first block's.
            begins.append(before + (a + SETTLING if a else 0))
        row, before = row + own, before + e.ticks
    whole = h.slopes.T @ h.slopes
    inverse = np.asarray(np.linalg.pinv(whole, hermitian=True), dtype=np.float64)
    left = inverse @ (h.slopes.T @ h.residual)
    return _Sums(
        np.array(squares), np.array(scores), np.array(begins), before, whole, inverse, left
    )


class _Asked(NamedTuple):
    """Courses of one shape: g (courses, amounts, blocks), and what each is (courses,)."""

    shape: str
    shares: Floats
    at: Floats
    rate: Floats
    followed: Sequence[Followed] = ()


def _asked(experiments: Sequence[Experiment], sums: _Sums) -> Iterator[_Asked]:
    """Yield all courses that are asked for."""
    middles, end, none = sums.middles, sums.end, np.zeros(1)
    near = 3.0 * SETTLING
    ends = np.cumsum([e.ticks for e in experiments]).astype(np.float64)
    steps = sums.begins[(sums.begins > near) & (sums.begins < end - near)]
    rates = end * np.geomspace(0.05, 1.0, 16)
    over_time = [(STEP, steps, 0.0 * steps), (DRIFT, none, none), (SETTLES, 0.0 * rates, rates)]
    several = len(named(experiments)) > 2 and not any(e.shares for e in experiments)
    if several:  # of two recordings it is a step
        over_time.append((RUN, np.append(0.0, ends[:-1]), ends))
    for shape, at, rate in over_time:
        shares = _over_time(shape, middles, end, at[:, None], rate[:, None])
        yield _Asked(shape, shares[:, None], at, rate)
    followed = _covariates(experiments)
    for one in followed:
        yield _Asked(FOLLOWS, one.over(experiments, middles)[None, None], none, none, (one,))
    if several:
        yield _Asked(EACH, _in_each(experiments, middles)[None], none, none)


def named(experiments: Sequence[Experiment]) -> tuple[str, ...]:
    """Return the names of recordings, each once: parts of one have one name."""
    return tuple(dict.fromkeys(e.name for e in experiments))


def _in_each(experiments: Sequence[Experiment], ticks: Floats) -> Floats:
    """Whether a tick is of each recording but the last (recordings - 1, ticks), 0 or 1."""
    ends = np.cumsum([e.ticks for e in experiments])
    place = np.minimum(np.searchsorted(ends, ticks, side="right"), ends.size - 1)
    of = np.array([e.name for e in experiments])[place]
    return np.array([of == name for name in named(experiments)[:-1]], dtype=np.float64)


def _covariates(experiments: Sequence[Experiment], last: float = 1.0 / 16.0) -> list[Followed]:
    """What all recordings have beside the motion, that does not stay the same.

    last: the share of the last recording over which the value at the end is a mean.
    """
    found: list[Followed] = []
    for c in experiments[-1].covariates:
        own = [d for e in experiments for d in e.covariates if d.name == c.name]
        span = float(np.ptp(np.concatenate([d.values for d in own])))
        if len(own) == len(experiments) and span > 0.0:
            count = max(1, int(last * c.values.size))
            found.append(Followed(c.name, c.unit, float(c.values[-count:].mean()), span))
    return found


def _best(h: Hypothesis, sums: _Sums, asked: _Asked) -> Iterator[Suspect]:
    """Yield the best change of one shape of each parameter."""
    shares, kept = asked.shares, [i for i, p in enumerate(h.model.parameters) if p.kind != "change"]
    if not shares.size:
        return
    mixed = np.tensordot(shares, sums.squares, 1)  # (courses, amounts, p, p): row j is c_j' J
    score = shares @ sums.scores - mixed @ sums.left
    for j in kept:
        c, own = mixed[:, :, j], sums.squares[:, j, j]
        size = np.einsum("skb,slb,b->skl", shares, shares, own)
        spread = size - c @ sums.inverse @ np.swapaxes(c, 1, 2)
        largest = np.max(np.diagonal(size, axis1=1, axis2=2), axis=1)
        told = np.linalg.eigvalsh(spread)[:, 0] > 1e-6 * largest  # else other parameters do it
        if not np.any(told):
            continue
        spread[~told] = np.eye(shares.shape[1])
        amounts = -np.linalg.solve(spread, score[:, :, j, None])[:, :, 0]
        gained = np.where(told, -np.sum(amounts * score[:, :, j], axis=1), 0.0)
        i = int(np.argmax(gained))
        if gained[i] <= 0.0:
            continue
        over = _over_stretches(sums, amounts[i] @ shares[i], j)
        likely = CHANGES.dated if asked.shape == STEP else CHANGES.within
        near = np.flatnonzero(gained > gained[i] - likely * over.phi)
        first, last = int(near[0]), int(near[-1])  # others between them may gain less
        alike = last - first + 1.0 if asked.shape in (STEP, SETTLES) else 1.0
        choices = len(kept) * len(SHAPES) * max(1.0, gained.size / alike)
        size_of = 2.0 * h.model.size_of(j, h.x)
        ranges = np.maximum(size_of, np.diag(spread[i]) ** -0.5)
        at, rate = asked.at, asked.rate
        yield Suspect(
            h.model.parameters[j].name, asked.shape, float(at[i]),
            (float(at[first]), float(at[last])), float(rate[i]),
            (float(rate[first]), float(rate[last])), tuple(amounts[i].tolist()), over,
            2.0 * math.log(choices) + CHANGES.rarity,
            freedom(spread[i] + np.diag(12.0 / ranges**2), ranges.tolist()),
            asked.followed[i] if asked.followed else None,
            named(h.experiments) if asked.shape == EACH else (),
        )  # fmt: skip


def _over_stretches(sums: _Sums, share: Floats, j: int, stretches: int = 40) -> Compared:
    """What a change of so much over the blocks gains, held against its scatter over stretches."""
    p = sums.left.size
    blocks = np.zeros((share.size, p + 1, p + 1))
    blocks[:, :p, :p] = sums.squares
    blocks[:, p, :p] = blocks[:, :p, p] = share[:, None] * sums.squares[:, j]
    blocks[:, p, p] = share**2 * sums.squares[:, j, j]
    scores = np.column_stack([sums.scores, share * sums.scores[:, j]])
    total, score = blocks.sum(axis=0), scores.sum(axis=0)
    total[:p, :p], score[:p] = sums.whole, sums.whole @ sums.left
    with_it = -np.linalg.pinv(total, hermitian=True) @ score
    without = np.append(-sums.left, 0.0)

    def costs(d: Floats) -> Floats:
        return 2.0 * scores @ d + np.einsum("i,bij,j->b", d, blocks, d)

    gains = costs(without) - costs(with_it)
    foretold = np.einsum("i,bij,j->b", with_it - without, blocks, with_it - without)
    parts = np.array_split(np.column_stack([gains, foretold]), min(stretches, share.size))
    each = np.array([part.sum(axis=0) for part in parts])
    return compared(each[:, 0], each[:, 1])


class Windows(NamedTuple):
    """A parameter in windows of recordings: ticks (windows,) of all from the first on, in x."""

    ticks: Floats
    x: Floats
    errors: Floats


def windows(h: Hypothesis, index: int, count: int = 24) -> Windows:
    """Return a parameter as each window of the recordings tells it by itself, to first order.

    All others are the same everywhere. h: fitted, with the parameter the same everywhere as well.
    """
    sums, p = _sums(h), h.x.size
    every = np.array_split(np.arange(sums.begins.size), min(count, sums.begins.size))
    others = [i for i in range(p) if i != index]
    size, rest = len(others) + len(every), slice(0, len(others))
    total, score = np.zeros((size, size)), np.zeros(size)
    total[rest, rest] = sums.whole[np.ix_(others, others)]
    score[rest] = (sums.whole @ sums.left)[others]
    ends = np.append(sums.begins[1:], sums.end)
    for at, blocks in enumerate(every, len(others)):
        own = sums.squares[blocks].sum(axis=0)
        total[at, at] = own[index, index]
        total[at, rest] = total[rest, at] = own[index, others]
        score[at] = sums.scores[blocks].sum(axis=0)[index]
    middles = [0.5 * float(sums.begins[b[0]] + ends[b[-1]]) for b in every]
    inverse = np.linalg.pinv(total, hermitian=True)
    moved = -(inverse @ score)[len(others) :]
    errors = np.sqrt(np.maximum(np.diag(inverse)[len(others) :], 0.0))
    return Windows(np.array(middles), h.x[index] + moved, errors)

"""Finds parameters that change in a recording (step, drift, settling, dependence), and when.

To first order the residual is r_0 + J d, where J are its slopes by the parameters. If parameter j
differs by delta g(t) from its value at the end, the corresponding slopes are the slopes by j times
g, since an observer forgets earlier values after some ticks: c = g J_j. In a joint fit with all d,
with A = J'J,

    S = c'r_0 - c'J A^-1 J'r_0,    V = c'c - c'J A^-1 J'c,    delta = -S / V,    gain = S^2 / V

in chi-square. So one pass over existing slopes tests every parameter for a step at every time, a
drift, settling at several rates, a dependence on a recorded quantity (with g that quantity, such as
a temperature), and one recording unlike the others (a score test: Andrews, Econometrica 61, 1993).
A value for each recording is the same test with as many numbers, gain = S' V^-1 S. The change with
the largest gain is fitted: the recording is cut there, and its parts share all parameters and one
more, the change (`Model.varying`). Its penalty is that of any parameter, plus how rare changes are
and how many were tried.

Just after a step, an observer that has not yet forgotten earlier values shows less than c, so
slopes date the step tens of ticks late. So the step is dated again: runs switch between the fitted
values at each tick around it. The 95 % interval contains the times that cost at most 7.35 more than
the best: for a step that is small against its noise, 2 ln of the likelihood ratio is distributed as
xi, P(xi <= z) = (1 - exp(-z / 2))^2 (Hansen, Econometrica 68, 2000).

Limits: a slow change is fitted in `PIECES` parts of a recording, each with the mean of the change.
One parameter changes at a time (a constant force between two parameters counts as one:
`Effect.holds_constant`), and few times in all. A step within `NEAREST` ticks of either end is not
found, nor are two steps that cancel each other within as many. A missing law over a state that
differs between parts of a recording (its level, for example) looks like a change; held-out data
decide (`answer.changes`). A change that goes with the level of the command, its rms nearby, is
marked (`WITH_LEVEL`): nothing then distinguishes it from such a law.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from zwidth.diagnosis.model.parameters import Model, Varying
from zwidth.diagnosis.noise.family import followed_by
from zwidth.diagnosis.noise.predictor import (
    SEARCHING,
    SETTLING,
    memory_at,
    prepared,
)
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.evidence import Compared, believed, compared
from zwidth.diagnosis.selection.hypothesis import Hypothesis, against, judged, priced, settled
from zwidth.diagnosis.settings import EVIDENCE
from zwidth.sim.device import place_label
from zwidth.sim.kernel import Memory
from zwidth.sim.predict import alone, copied

Floats = NDArray[np.float64]
BLOCKS = 1000  # most blocks; a step may be at the beginning of each
TICKS = 4  # least ticks of a block
NEAREST = 3 * SETTLING  # least ticks between a step and an end of the recordings
PIECES = 16  # most parts of a drift; with 8, a drift by 7 % left a gain of 213
SHORTEST = 3 * SETTLING  # ticks of such a part
RATES = np.geomspace(0.05, 1.0, 16)  # time constants of settling, over the recorded time
ABOUT = 2 * SETTLING  # ticks to both sides, in which a step is dated
WINDOWS = 24  # each with its own value of a parameter, for the report
DATES, LOOKS = 150, 3  # ticks tried there; most repetitions if the best is at the edge
STEP, DRIFT, SETTLES, RUN = "step", "drift", "settling", "run"
FOLLOWS, EACH, LEVEL = "follows", "each recording", "level"
SHAPES = (STEP, DRIFT, SETTLES, RUN, FOLLOWS, EACH)
WITH_LEVEL = "a dependence on the level of the command"
IN_WORDS = {
    STEP: "a step", DRIFT: "a drift over time", SETTLES: "settling", LEVEL: WITH_LEVEL,
}  # fmt: skip
CUT = (
    STEP,
    RUN,
    EACH,
)  # changes that are present in some parts of the recordings only
FEWEST_RUNS = 3  # recordings; with two, a difference is a step


@dataclass(frozen=True)
class Suspect:
    """A possible change of a parameter.

    of: the parameter. at: time of a step, in ticks of all recordings in order; between: its 95 %
    interval. rate: time constant of settling, in ticks; rates: its 95 % interval. For a recording
    unlike the others, `at` is where it begins and `rate` where it ends. amount: of the change, in
    x. told: gain and phi (`evidence.compared`). price: penalty for rarity and for having tried so
    many. covariate: the recorded quantity that the parameter depends on. amounts: if every
    recording has its own value, the changes of all but the last, for which the fit pays about
    `freedom`. as_well: other courses of the parameter that gain as much. against: a parameter that
    changes by as much the other way, "" if `of` changes alone.
    """

    of: str
    shape: str
    at: float
    between: tuple[float, float]
    rate: float
    amount: float
    told: Compared
    price: float
    rates: tuple[float, float] = (0.0, 0.0)
    covariate: "Followed | None" = None
    amounts: tuple[float, ...] = ()
    freedom: float = 0.0
    as_well: tuple[str, ...] = ()
    against: str = ""

    @property
    def worth(self) -> float:
        """The gain, less all penalties."""
        return self.told.gain - self.price - self.freedom


class Followed(NamedTuple):
    """A quantity on which a parameter depends; origin: its value at the end, span: its range."""

    name: str
    unit: str
    origin: float
    span: float

    def share(self, e: Experiment) -> Floats:
        """Return the share of the change at each sample (ticks,)."""
        (own,) = (c for c in e.covariates if c.name == self.name)
        return (own.values - self.origin) / self.span


class _Way(NamedTuple):
    """A possible change of a parameter, alone or against another, and its direction in x."""

    of: str
    against: str
    x: Floats


def _ways(model: Model) -> list[_Way]:
    parameters = model.parameters
    places = {p.name: i for i, p in enumerate(parameters) if p.kind != "change"}
    each = np.eye(len(parameters))
    found = [_Way(name, "", each[i]) for name, i in places.items()]
    for physics in model.effects:
        if physics.effect.holds_constant is None:
            continue
        of, against = (f"{place_label(physics)}.{key}" for key in physics.effect.holds_constant)
        if of in places and against in places:
            found.append(_Way(of, against, each[places[of]] - each[places[against]]))
    return found


class _Sums(NamedTuple):
    """For blocks of rows: J'J (blocks, p, p), J'r (blocks, p), and the ticks where they begin."""

    squares: Floats
    scores: Floats
    begins: Floats
    end: float


def suspected(h: Hypothesis) -> Suspect | None:
    """Return the change by which a fitted hypothesis would gain most, None if none would pay."""
    smooth = {(v.of, v.against) for v in h.model.varying if v.smooth}  # the rest: cut in parts
    sums = _sums(h)
    every = [s for shape in SHAPES for s in _best_of(h, sums, shape)]
    found = [s for s in every if s.shape in CUT or (s.of, s.against) not in smooth]
    best = max(found, key=lambda s: s.worth, default=None)
    if best is None:
        return None
    alike = [
        s
        for s in (*found, *_best_of(h, sums, LEVEL))
        if (s.of, s.against) == (best.of, best.against)
        and s is not best
        and s.worth > best.worth - EVIDENCE.as_well
    ]
    best = replace(best, as_well=tuple(dict.fromkeys(_course_in_words(s) for s in alike)))
    # A fit is only worth its time if the gain that slopes predict is at least half of the penalty.
    paid = best.price + 2.0 * best.told.phi * math.log(1.0 / EVIDENCE.alpha)
    return best if best.told.gain > 0.5 * paid else None


def _course_in_words(s: Suspect) -> str:
    if s.covariate is not None:
        return f"a dependence on {s.covariate.name}"
    return IN_WORDS.get(s.shape, s.shape)


def _sums(h: Hypothesis) -> _Sums:
    assert h.slopes is not None
    o, p = h.noise.observer.deviation.size, h.x.size
    rows = [e.ticks - SETTLING for e in h.experiments]
    each = max(TICKS, math.ceil(sum(rows) / BLOCKS))
    squares: list[Floats] = []
    scores: list[Floats] = []
    begins: list[float] = []
    row, before = 0, 0
    for e, own in zip(h.experiments, rows, strict=True):
        edges = np.append(np.arange(0, own, each), own)
        for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            mine = slice((row + a) * o, (row + b) * o)
            j, r = h.slopes[mine].reshape(-1, p), h.residual[mine]
            squares.append(j.T @ j)
            scores.append(j.T @ r)
            # The ticks in which the observer settled count to the first block.
            begins.append(before + (a + SETTLING if a else 0))
        row, before = row + own, before + e.ticks
    return _Sums(np.array(squares), np.array(scores), np.array(begins, dtype=np.float64), before)


def _best_of(h: Hypothesis, sums: _Sums, shape: str) -> list[Suspect]:
    """The best change of one shape for each parameter."""
    assert h.slopes is not None
    at, end = sums.begins, sums.end
    middle = 0.5 * (at + np.append(at[1:], end))
    followed = _covariates(h.experiments)
    if shape == EACH:
        return _best_each(h, sums)
    if shape == STEP:
        asked = np.flatnonzero((at > NEAREST) & (at < end - NEAREST))
        shares = (np.arange(at.size)[None, :] < asked[:, None]).astype(np.float64)
        times, rates = at[asked], np.zeros(asked.size)
    elif shape == RUN:
        ends = np.cumsum([e.ticks for e in h.experiments]).astype(np.float64)
        times, rates = np.append(0.0, ends[:-1]), ends
        if ends.size < FEWEST_RUNS or any(e.shares for e in h.experiments):
            return []
        shares = ((at >= times[:, None]) & (at < ends[:, None])).astype(np.float64)
    elif shape == DRIFT:
        shares, times, rates = (1.0 - middle / end)[None, :], np.zeros(1), np.zeros(1)
    elif shape == FOLLOWS:
        here = np.minimum(middle.astype(np.int64), int(end) - 1)
        own = [np.concatenate([f.share(e) for e in h.experiments])[here] for f in followed]
        shares = np.array(own).reshape(len(followed), at.size)
        times, rates = np.zeros(len(followed)), np.zeros(len(followed))
    elif shape == LEVEL:
        level = level_of(h.experiments)
        if level is None:
            return []
        shares = level[None, np.minimum(middle.astype(np.int64), int(end) - 1)]
        times, rates = np.zeros(1), np.zeros(1)
    else:
        rates = end * RATES
        shares, times = np.exp(-middle[None, :] / rates[:, None]), np.zeros(rates.size)
    if not shares.size:
        return []
    whole = h.slopes.T @ h.slopes
    inverse = np.linalg.pinv(whole, hermitian=True)
    left = inverse @ (h.slopes.T @ h.residual)
    ways = _ways(h.model)
    turned = np.array([way.x for way in ways])
    squares = turned @ sums.squares  # (blocks, ways, parameters)
    mixed = np.einsum("sb,bwj->swj", shares, squares)  # row w: c_w' J
    own = np.einsum("sb,bwj,wj->sw", shares**2, squares, turned)
    score = shares @ sums.scores @ turned.T - mixed @ left
    spread = own - np.einsum("sjk,kl,sjl->sj", mixed, inverse, mixed)
    known = spread > 1e-6 * own  # else it is a combination of the parameters
    spread = np.where(known, spread, np.inf)
    gained = score**2 / spread
    found: list[Suspect] = []
    for j, way in enumerate(ways):
        i = int(np.argmax(gained[:, j]))
        if gained[i, j] <= 0.0:
            continue
        amount = float(-score[i, j] / spread[i, j])
        told = _told(h, sums, shares[i], way.x)
        within = EVIDENCE.dated if shape == STEP else EVIDENCE.told
        near = np.flatnonzero(gained[:, j] > gained[i, j] - within * told.phi)
        # An interval also contains times between these that gain less.
        between = (float(times[near[0]]), float(times[near[-1]])) if shape == STEP else (0.0, 0.0)
        alike = near[-1] - near[0] + 1.0 if shape in (STEP, SETTLES) else 1.0
        choices = times.size / alike
        price = (
            2.0 * math.log(len(ways) * len(SHAPES) * max(1.0, choices)) + EVIDENCE.rarity_of_once
        )
        found.append(Suspect(
            way.of, shape, float(times[i]), between, float(rates[i]), amount, told, price,
            (float(rates[near[0]]), float(rates[near[-1]])),
            followed[i] if shape == FOLLOWS else None, against=way.against,
        ))  # fmt: skip
    return found


def _covariates(experiments: Sequence[Experiment]) -> list[Followed]:
    """The quantities besides the motion that all recordings contain, if they vary."""
    found: list[Followed] = []
    for c in experiments[-1].covariates:
        own = [d for e in experiments for d in e.covariates if d.name == c.name]
        values = np.concatenate([d.values for d in own])
        span, last = float(np.ptp(values)), max(1, c.values.size // PIECES)
        if len(own) == len(experiments) and span > 0.0:
            found.append(Followed(c.name, c.unit, float(c.values[-last:].mean()), span))
    return found


def level_of(experiments: Sequence[Experiment]) -> Floats | None:
    """Return the level of the command (ticks,): its rms about each sample, over its largest.

    None if levels differ too little to explain a change.
    """
    each = [
        uniform_filter1d(e.command[: e.ticks] ** 2, min(NEAREST, e.ticks), mode="nearest")
        for e in experiments
    ]
    level = np.sqrt(np.maximum(np.concatenate(each), 0.0))  # a running sum may fall below 0
    most = float(level.max())
    return level / most if np.ptp(level) > EVIDENCE.levels_differ * most else None


def groups(experiments: Sequence[Experiment]) -> list[list[int]]:
    """Return the indices of the parts of each recording, which share its name."""
    names = list(dict.fromkeys(e.name for e in experiments))
    return [[i for i, e in enumerate(experiments) if e.name == name] for name in names]


def _best_each(h: Hypothesis, sums: _Sums) -> list[Suspect]:
    """Each parameter with another value in every recording: one number for all but the last."""
    assert h.slopes is not None
    own = groups(h.experiments)
    if len(own) < FEWEST_RUNS or any(e.shares for e in h.experiments):
        return []
    ends = np.cumsum([e.ticks for e in h.experiments])
    of = np.searchsorted(ends, sums.begins, side="right")  # the part of each block
    shares = np.array([np.isin(of, which) for which in own[:-1]], dtype=np.float64)
    inverse = np.linalg.pinv(h.slopes.T @ h.slopes, hermitian=True)
    left = inverse @ (h.slopes.T @ h.residual)
    ways, found = _ways(h.model), list[Suspect]()
    for way in ways:
        squares = sums.squares @ way.x
        mixed = shares @ squares
        score = shares @ (sums.scores @ way.x) - mixed @ left
        size = np.diag(shares**2 @ (squares @ way.x))
        spread = size - mixed @ inverse @ mixed.T
        if np.linalg.eigvalsh(spread)[0] <= 1e-6 * size.max():
            continue
        amounts = -np.linalg.solve(spread, score)
        told = _told(h, sums, amounts @ shares, way.x)
        price = 2.0 * math.log(len(ways) * len(SHAPES)) + EVIDENCE.rarity_of_once
        freedom = (len(own) - 2) * math.log(h.noise.observer.told * h.samples)
        found.append(Suspect(way.of, EACH, 0.0, (0.0, 0.0), 0.0, 0.0, told, price,
                             amounts=tuple(amounts.tolist()), freedom=freedom,
                             against=way.against))  # fmt: skip
    return found


def _told(h: Hypothesis, sums: _Sums, share: Floats, way: Floats) -> Compared:
    """The gain of a change that slopes predict, compared over stretches of the recordings."""
    assert h.slopes is not None
    p, squares = h.x.size, sums.squares @ way
    blocks = np.zeros((share.size, p + 1, p + 1))
    blocks[:, :p, :p] = sums.squares
    blocks[:, p, :p] = blocks[:, :p, p] = share[:, None] * squares
    blocks[:, p, p] = share**2 * (squares @ way)
    scores = np.column_stack([sums.scores, share * (sums.scores @ way)])
    total, score = blocks.sum(axis=0), scores.sum(axis=0)
    total[:p, :p] = h.slopes.T @ h.slopes
    score[:p] = h.slopes.T @ h.residual
    with_it = -np.linalg.pinv(total, hermitian=True) @ score
    inverse = np.linalg.pinv(total[:p, :p], hermitian=True)
    without = np.append(-inverse @ score[:p], 0.0)

    def costs(d: Floats) -> Floats:
        return 2.0 * scores @ d + np.einsum("i,bij,j->b", d, blocks, d)

    gains = costs(without) - costs(with_it)
    foretold = np.einsum("i,bij,j->b", with_it - without, blocks, with_it - without)
    parts = np.array_split(np.column_stack([gains, foretold]), min(EVIDENCE.blocks, share.size))
    each = np.array([part.sum(axis=0) for part in parts])
    return compared(each[:, 0], each[:, 1])


def share_at(suspect: Suspect, tick: float, end: float) -> float:
    """Return the share of a change over time that holds at a tick of all recordings."""
    if suspect.shape == STEP:
        return float(tick < suspect.at)
    if suspect.shape == RUN:
        return float(suspect.at <= tick < suspect.rate)
    return math.exp(-tick / suspect.rate) if suspect.shape == SETTLES else 1.0 - tick / end


def share_of(suspect: Suspect, part: Experiment, before: float, end: float) -> float:
    """Return the mean share of a change in a part that begins at a tick of all recordings.

    For a change over time, the share in the middle of the samples after the observer has settled.
    """
    if suspect.covariate is not None:
        return float(suspect.covariate.share(part)[min(SETTLING, part.ticks // 2) :].mean())
    return share_at(suspect, before + 0.5 * (SETTLING + part.ticks), end)


def cut(
    experiments: Sequence[Experiment], suspect: Suspect, names: Sequence[str]
) -> list[Experiment]:
    """Return recordings in parts in which the share of each change of `names` is constant."""
    if suspect.shape == EACH:
        return _each_its_own(experiments, names)
    (name,) = names
    end, before = sum(e.ticks for e in experiments), 0
    found: list[Experiment] = []
    for e in experiments:
        step = None if suspect.shape not in CUT else suspect.at - before
        for a, b in [(0, e.ticks)] if suspect.shape == RUN else _parts(e.ticks, step, end):
            part = e.part(a, b) if (a, b) != (0, e.ticks) else e
            share = share_of(suspect, part, before + a, end)
            own = ((name, share),) if share else ()
            found.append(replace(part, shares=(*e.shares, *own)))
        before += e.ticks
    return found


def _each_its_own(experiments: Sequence[Experiment], names: Sequence[str]) -> list[Experiment]:
    found = list(experiments)
    for name, which in zip(names, groups(experiments)[:-1], strict=True):
        for i in which:
            found[i] = replace(found[i], shares=(*found[i].shares, (name, 1.0)))
    return found


def _parts(ticks: int, step: float | None, end: int) -> list[tuple[int, int]]:
    """The parts of a recording, cut at a step or evenly."""
    if step is not None:
        # A step this near to an end counts as at the end.
        if step < 2 * SETTLING or step > ticks - 2 * SETTLING:
            return [(0, ticks)]
        return [(0, round(step)), (round(step), ticks)]
    count = max(1, min(round(PIECES * ticks / end), ticks // SHORTEST))
    edges = np.linspace(0, ticks, count + 1).round().astype(np.int64).tolist()
    return list(itertools.pairwise(edges))


@dataclass(frozen=True)
class Varied:
    """A fitted change.

    hypothesis: with the change, on recordings in parts; without: on the same parts without it.
    names: of the change; several if every recording has its own value.
    """

    suspect: Suspect
    names: tuple[str, ...]
    hypothesis: Hypothesis
    without: Hypothesis

    @property
    def gained(self) -> float:
        """In -2 ln, less all penalties."""
        return self.without.cost.total - self.hypothesis.cost.total


def varied(h: Hypothesis, suspect: Suspect) -> Varied | None:
    """Fit a suspected change; None if it is not believed. May raise NoObserver."""
    first, amounts = len(h.model.varying) + 1, suspect.amounts or (suspect.amount,)
    names = tuple(f"change {first + i}" for i in range(len(amounts)))
    parts = cut(h.experiments, suspect, names)
    if len({e.shares for e in parts}) < 2:
        return None
    model = replace(
        h.model,
        varying=(
            *h.model.varying,
            *(
                Varying(
                    name,
                    suspect.of,
                    suspect.shape not in CUT,
                    0.0 if i else suspect.price,
                    against=suspect.against,
                )
                for i, name in enumerate(names)
            ),
        ),
    )
    best = settled(judged(parts, model, model.within(np.append(h.x, amounts)), h.family))
    # Compared first with the unfitted constant model, which costs no less than its fit.
    unfitted = judged(parts, h.model, h.x, h.family)
    if best.against_physics or not believed(best.cost, priced(unfitted).cost):
        return None
    without = settled(unfitted)
    if not believed(best.cost, without.cost, against(best, without).phi):
        return None
    if suspect.shape == STEP:
        at, between = _dated(h.experiments, best, suspect)
        suspect = replace(suspect, at=at, between=between)
        parts = cut(h.experiments, suspect, names)
        best = settled(judged(parts, model, best.x, h.family))
        without = settled(judged(parts, h.model, without.x, h.family))
    return Varied(suspect, names, best, without)


def _dated(
    experiments: Sequence[Experiment], h: Hypothesis, suspect: Suspect
) -> tuple[float, tuple[float, float]]:
    """Return the time of a step and its 95 % interval, in ticks of all recordings."""
    before, place = 0, 0
    while place < len(experiments) - 1 and suspect.at >= before + experiments[place].ticks:
        before += experiments[place].ticks
        place += 1
    e = experiments[place]
    at = round(suspect.at) - before
    if len(_parts(e.ticks, at, 0)) < 2:  # between two recordings the time is unknown
        return suspect.at, suspect.between
    half = min(max(ABOUT, round(0.5 * (suspect.between[1] - suspect.between[0]))), e.ticks // 3)
    ticks, costs, best = np.array([at]), np.zeros(1), 0
    for _ in range(LOOKS):
        first, last = max(SETTLING, at - half), min(e.ticks - SETTLING, at + half)
        ticks = np.unique(np.linspace(first, last, DATES).round().astype(np.int64))
        costs = _going_through(e, h, ticks, min(e.ticks, last + SETTLING))
        best = int(np.argmin(costs))
        at = int(ticks[best])
        if 0 < best < ticks.size - 1:
            break
    near = np.flatnonzero(costs < costs[best] + EVIDENCE.dated * suspect.told.phi)
    # The step may be anywhere between two tried ticks.
    ends = ticks[max(0, near[0] - 1)], ticks[min(ticks.size - 1, near[-1] + 1)]
    return before + at, (float(before + ends[0]), float(before + ends[1]))


def _going_through(e: Experiment, h: Hypothesis, ticks: NDArray[np.int64], stop: int) -> Floats:
    """The cost (ticks,) of a recording with a step at each of some ticks."""
    model, x, observer = h.model, h.x, h.noise.observer
    device = model.acting(x)
    held = [model.seen(replace(e, shares=(*e.shares, *own)), x)
            for own in (((model.varying[-1].name, 1.0),), ())]  # fmt: skip
    early, late = (prepared(own.on(device), SEARCHING) for own in held)
    places, begun_there = held[0].places(early.coarse), followed_by(device, held[0], observer)
    memory, full = memory_at(early, begun_there, device, observer.gain)
    forces = held[0].external(early.coarse.dof)
    readings = [own.readings for own in held]
    known = None if e.uncounted is None else e.uncounted[:stop]

    def through(side: int, a: int, b: int, memory: Memory) -> Floats:
        own, eq = held[side], (early, late)[side]
        found = alone(eq.coarse, eq.fine, places, own.command[a:b], readings[side][a:b], full,
                      forces[a:b], memory, own.strengths_in(slice(a, b)))  # fmt: skip
        if e.uncounted is not None:
            found[e.uncounted[a:b]] = 0.0
        return found

    start, here = int(ticks[0]), 0
    before: list[Floats] = [through(0, 0, start, memory)]
    costs: list[float] = []
    for here, tick in zip([start, *ticks[:-1].tolist()], ticks.tolist(), strict=True):
        before.append(through(0, here, tick, memory))
        after = through(1, tick, stop, copied(memory))
        white = observer.weigh(np.concatenate([*before, after]), known)[start - SETTLING // 2 :]
        costs.append(float(np.sum(white**2)))
    return np.nan_to_num(np.array(costs), nan=np.inf, posinf=np.inf)


def with_varying(h: Hypothesis, model: Model, parts: Sequence[Experiment]) -> Hypothesis:
    """Return a hypothesis fitted again to parts, with the changes of another model."""
    own = replace(h.model, varying=model.varying)
    more = len(own.parameters) - h.x.size
    return settled(judged(parts, own, np.append(h.x, np.zeros(more)), h.family))


class Course(NamedTuple):
    """A parameter, in x, in windows of recordings; times (windows,) [s] from the first sample."""

    times: Floats
    x: Floats
    errors: Floats


def course(h: Hypothesis, index: int, against: int | None) -> Course:
    """Return a parameter in each window of the recordings by itself, to first order.

    All others are constant. h: fitted with a constant parameter. against: see `Parameter`; then
    half the difference of both varies, and half their sum is constant.
    """
    p, assumed = h.x.size, h.x[index]
    assert h.slopes is not None
    if against is not None:
        turned = np.eye(p)
        turned[[against, index], [index, against]] = -1.0, 1.0
        h, assumed = replace(h, slopes=h.slopes @ turned), 0.5 * (assumed - h.x[against])
    sums = _sums(h)
    assert h.slopes is not None
    windows = np.array_split(np.arange(sums.begins.size), min(WINDOWS, sums.begins.size))
    others = [i for i in range(p) if i != index]
    size = len(others) + len(windows)
    rest = slice(0, len(others))
    total, score = np.zeros((size, size)), np.zeros(size)
    whole, residual = h.slopes.T @ h.slopes, h.slopes.T @ h.residual
    total[rest, rest], score[rest] = whole[np.ix_(others, others)], residual[others]
    times: list[float] = []
    ends = np.append(sums.begins[1:], sums.end)
    for w, blocks in enumerate(windows):
        at, own = len(others) + w, sums.squares[blocks].sum(axis=0)
        total[at, at] = own[index, index]
        total[at, rest] = total[rest, at] = own[index, others]
        score[at] = sums.scores[blocks].sum(axis=0)[index]
        times.append(0.5 * float(sums.begins[blocks[0]] + ends[blocks[-1]]))
    inverse = np.linalg.pinv(total, hermitian=True)
    moved = -(inverse @ score)[len(others) :]
    errors = np.sqrt(np.maximum(np.diag(inverse)[len(others) :], 0.0))
    return Course(h.experiments[0].period * np.array(times), assumed + moved, errors)

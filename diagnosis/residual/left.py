"""Is a force left that no effect explains? One bank of forces, one statistic, one level of chance.

At every mass and in every link a force may stand that is

    a step function of position, velocity, command (or time, for the map alone),
    the cube of velocity,
    q times a drift, or q cos(phase + 2 pi s / period): q a velocity, an acceleration, a deflection
    or its rate, s time or the position of m1, or
    cos(phase + 2 pi t / period) alone, and over position beside a ripple, whose harmonics it is.

The statistic is the -2 log likelihood that its k strengths gain, off the span of the fit. Chance is
what the best of N such forces (waves, or others) exceeds once in 1 / RESIDUAL.odds recordings, the
quantile of chi-square with k degrees at odds / N, times `inflation` where the residual is coloured.

Under the likeliest noise the gain is a chi-square to first order. That noise hides a force in part
(it takes motion for disturbance), so the forces are also solved for under a slower observer, on all
that was recorded; there the likeliest is added to the recordings and what counts is how much
likelier they are with it, each model under its own likeliest noise. Limits: q is what the observer
predicts; a force that turns the motion over is not followed to its end in a few turns.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d, median_filter, uniform_filter1d
from scipy.stats import chi2

from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.fitting.uncertainty import inflation
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import NEXT_SAMPLE, Family, likeliest
from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.residual.remainder import Remainder, Solved, correlated
from zwidth.diagnosis.residual.spectrum import Pull, peaks
from zwidth.diagnosis.settings import RESIDUAL
from zwidth.jobs.parallel import in_parallel, threads
from zwidth.sim.place import Place, masses_and_links

Floats = NDArray[np.float64]
STATES = ("position", "velocity", "command", "time")
# Of the samples, between steps: narrow at the ends, where a stop is.
QUANTILES = (0.0, 0.005, 0.02, 0.06, 0.15, 0.3, 0.5, 0.7, 0.85, 0.94, 0.98, 0.995, 1.0)


@dataclass(frozen=True)
class Left:
    """What a model leaves: -2 log likelihood that an unknown force would gain, 0 for chance.

    whole: in all that was recorded, and not where it was fitted.
    """

    gained: float
    sentence: str
    whole: bool = False


@dataclass(frozen=True)
class Shape:
    """A force of free shape at a place: columns (ticks, k) of each recording, k its strengths.

    edges: of the steps (k + 1,), of a step function; none else.
    """

    place: Place
    follows: str
    columns: list[Floats]
    edges: Floats

    @property
    def levels(self) -> bool:
        """Whether a constant in it is a force: on a link it is another beginning, no more."""
        return self.place.kind == "mass" or not self.edges.size


@dataclass(frozen=True)
class Line:
    """The strongest wave. at: "m1"..; follows: q; over: "time" or "position"; period: of that."""

    gained: float
    at: str
    follows: str
    over: str
    period: float

    def sentence(self, rotary: bool) -> str:
        """Say what is left."""
        unit = "s" if self.over == "time" else "rad" if rotary else "m"
        q = "" if self.follows == "1" else f" proportional to the {self.follows}"
        return (
            f"a force at {self.at}{q} that repeats over {self.over} every {self.period:.3g} {unit}"
            f" would gain a chi-square of {self.gained:.0f}"
        )


def chance(unknowns: int, among: int, odds: float = RESIDUAL.odds) -> float:
    """Return the chi-square that the best of so many forces gains by chance, of k unknowns each."""
    return float(chi2.isf(odds / max(1, among), unknowns))


def left_over(problem: Problem, final: Fitted, acted: Sequence[Experiment]) -> Left:
    """Return the force that a final fit leaves, first where it was fitted, then in all of `acted`.

    Nothing of what is recorded beyond the fit is kept, and a stop may first be hit there.
    """
    rest = Remainder(problem, final)
    line, lines = strongest_line(rest)
    gains = [(s, g) for s, g in solved_bank(rest) if s.follows != "time"]
    wide, among = inflation(final.white), len(gains)
    told = [
        (g.gained - wide * chance(g.strength.size, among), g.gained, explaining(s))
        for s, g in gains
    ]
    if line is not None:
        said = line.sentence(final.model.nominal.rotary)
        told.append((line.gained - wide * chance(2, lines), line.gained, said))
    beyond, gained, sentence = max(told, default=(0.0, 0.0, ""))
    if beyond > 0.0:
        return Left(gained, sentence)
    with suppress(NoObserver):  # no observer follows what was held out
        if (free := _free_force(final, acted, wide, among)) is not None:
            return free
    return Left(0.0, "")


def explaining(shape: Shape) -> str:
    """Say that a force explains what is left."""
    return f"a force at {shape.place} that follows {shape.follows} explains most of it"


def bank(rest: Remainder) -> Iterator[Shape]:
    """Return every force that is no wave."""
    n, none = rest.masses, np.zeros(0)
    stepped = {state: _steps(values_of(rest, state)) for state in STATES}
    for place in masses_and_links(n):
        for state, (edges, columns) in stepped.items():
            if edges.size > 1:  # a state that never changes (no command) tells nothing
                yield Shape(place, state, columns, edges)
        for name, q in factors(rest, place).items():
            if name == "velocity":
                yield Shape(place, "the cube of velocity", [v[:, None] ** 3 for v in q], none)
            yield Shape(place, f"a drift times {name}", [_drifting(one) for one in q], none)


def solved_bank(rest: Remainder) -> list[tuple[Shape, Solved]]:
    """Return every such force with the strengths that explain most."""
    every = list(bank(rest))
    asked = [partial(rest.solved, s.place, s.columns, s.levels) for s in every]
    return list(zip(every, in_parallel(asked, threads()), strict=True))


def values_of(rest: Remainder, state: str) -> list[Floats]:
    """Return the values (ticks,) of a state of `STATES` in every recording."""
    experiments = rest.problem.experiments
    if state == "time":
        return [np.asarray(e.period * np.arange(e.ticks), dtype=np.float64) for e in experiments]
    if state == "command":
        return [e.command for e in experiments]
    return [motion[STATES.index(state)] for motion in rest.motions]


def _steps(values: list[Floats]) -> tuple[Floats, list[Floats]]:
    """Edges of steps, and for every recording whether a tick is in each of them (ticks, k)."""
    edges = np.unique(np.quantile(np.concatenate(values), QUANTILES))
    last = max(edges.size - 2, 0)
    at = [np.clip(np.searchsorted(edges, v, "right") - 1, 0, last) for v in values]
    return edges, [np.eye(last + 1)[i] for i in at]


def factors(rest: Remainder, place: Place) -> dict[str, list[Floats]]:
    """Return what a force at a place may be in proportion to (ticks,), by name, once settled.

    While an observer settles its states jump, which would be on every line.
    """
    n, row = rest.masses, place.row(rest.masses)
    found: dict[str, list[Floats]] = {}
    for x in rest.states:
        way, speed = x[:, :n] @ row, x[:, n:] @ row
        both = {"velocity": speed, "acceleration": np.gradient(speed) / rest.period}
        if place.kind == "link":
            both = {"deflection": way, "rate of deflection": speed}
        for name, q in both.items():
            found.setdefault(name, []).append(np.where(np.arange(q.size) < SETTLING + 5, 0.0, q))
    return found


def _drifting(q: Floats, cosines: int = 5) -> Floats:
    return q[:, None] * np.cos(np.pi * np.outer(np.arange(q.size) / q.size, 1 + np.arange(cosines)))


def strongest_line(rest: Remainder, draws: int = 24, seed: int = 0) -> tuple[Line | None, int]:
    """Return the strongest wave in what a fit leaves, and how many were looked at.

    Noise is never quite white near a resonance, and louder where motion is fast: drawn noise has
    the colour and the envelope of the residual, phases drawn. For a force of time alone, a hum, the
    line would be in that very colour: so `_hum` compares it with the lines around.
    """
    rest = rest.coarsely()
    random = np.random.default_rng(seed)
    drawn = [rest.off(_alike(rest.fitted, random)) for _ in range(draws)]
    times, before = list[Floats](), 0.0
    for t in values_of(rest, "time"):
        times.append(before + t)
        before += t.size * rest.period
    positions = [x[:, 0] for x in rest.states]
    slowest = max(1.0 / 40.0, 10.0 * rest.period)  # of a parameter that sways: 40 Hz
    finest = max(float(x.max()) for x in positions) - min(float(x.min()) for x in positions)
    finest /= 60.0  # periods over the travel
    rippled = {p.at for p in rest.fitted.model.effects if p.effect.sought == "waves"}
    found: list[Line] = []
    lines = 0
    for place in masses_and_links(rest.masses):
        at, answer = str(place), rest.answer(place)
        own = correlated(rest.problem, rest.left, answer)
        noise = [correlated(rest.problem, one, answer) for one in drawn]
        hums, seen = _hum(rest, own, answer)
        lines += seen
        found += [Line(gained, at, "1", "time", period) for gained, period in hums]
        asked = [(name, q, "time", 1.0) for name, q in factors(rest, place).items()]
        asked += [(name, q, "position", 0.5) for name, q, *_ in asked]
        if at in rippled:  # longer than a third of the travel, a ripple is a bent spring
            asked.append(("1", [np.ones(x.size) for x in positions], "position", 3.0))
        for name, q, over, fewest in asked:
            pulled = [
                Pull(one * g, one * np.array([d[i] for d in noise]))
                for i, (one, g) in enumerate(zip(q, own, strict=True))
            ]
            along, least = (times, slowest) if over == "time" else (positions, finest)
            best, seen = peaks(pulled, along, least, 1, fewest=fewest) if least > 0.0 else ([], 0)
            lines += seen
            found += [Line(p.gained, at, name, over, p.period) for p in best]
    return max(found, key=lambda line: line.gained, default=None), lines


def _hum(
    rest: Remainder, own: list[Floats], answer: Floats
) -> tuple[list[tuple[float, float]], int]:
    """Chi-square and period of the strongest hum, as many as there are, and the lines looked at.

    Over the power that white noise has there, and where more is around, over that: the median of 51
    lines says how much colour is left, the mean of a few beside it, nearer than which is the hum's
    own leakage, whether it is a narrow antiresonance.
    """
    together = np.concatenate(own)
    frequency = np.fft.rfftfreq(together.size, rest.period)
    kept = (frequency > 0.0) & (frequency < 0.45 / rest.period)
    level = np.sum(np.abs(np.fft.rfft(answer, together.size, axis=0)) ** 2, axis=1)[kept]
    if not kept.any() or not np.all(level > 0.0):
        return [], 0
    over = np.abs(np.fft.rfft(together)[kept]) ** 2 / (together.size * level)
    many = median_filter(over, min(51, over.size), mode="reflect") / np.log(2.0)
    weights = np.ones(17)
    weights[7:10] = 0.0
    few = convolve1d(over, weights / weights.sum(), mode="reflect")
    gained = 2.0 * over / np.maximum(1.0, np.maximum(many, few))
    k = int(np.argmax(gained))
    return [(float(gained[k]), float(1.0 / frequency[kept][k]))], gained.size


def _alike(fitted: Fitted, random: np.random.Generator) -> Floats:
    """Return a residual of the same envelope, over 300 samples, and colour: smoothed, drawn."""
    envelope = np.sqrt(uniform_filter1d(fitted.white**2, 300, mode="reflect"))
    envelope[envelope == 0.0] = 1.0
    waves = np.fft.rfft(fitted.white / envelope)
    size = np.sqrt(uniform_filter1d(np.abs(waves) ** 2, 15, mode="reflect"))
    turned = size * np.exp(2j * np.pi * random.random(size.size))
    residual = fitted.residual.copy()
    residual[: fitted.samples] = envelope * np.fft.irfft(turned, fitted.samples)
    return residual


@dataclass(frozen=True)
class _Forced:
    """Recordings with a force added, a model on them, and what it costs."""

    experiments: list[Experiment]
    problem: Problem
    fitted: Fitted
    cost: float


def _free_force(
    final: Fitted, acted: Sequence[Experiment], wide: float, among: int, asked: int = 3
) -> Left | None:
    """Return the force that makes recordings likeliest, None where chance does as much.

    wide, among: as in `left_over`. asked: of the forces that gain most under each observer, how
    many are added to the recordings.
    """
    model = final.model
    plain = _settled(acted, model, final.x)
    ratio = plain.problem.observer.ratio
    views = [Remainder(plain.problem, plain.fitted)]
    with suppress(NoObserver):  # so slow that it does not hold the device
        slower = Family((RESIDUAL.slower * ratio,), whitening=False)
        _, there = _under(acted, model, plain.fitted.x, slower)
        views.append(Remainder(*_under(acted, model, there.x, slower, 4)))  # in its own units
    best: tuple[float, Shape, Solved, _Forced] | None = None
    for rest in views:
        gains = [
            (g.gained - wide * chance(g.strength.size, among), s, g)
            for s, g in solved_bank(rest)
            if s.follows != "time"
        ]
        hopeful = sorted((one for one in gains if one[0] > 0.0), key=itemgetter(0), reverse=True)
        for _, shape, solved in hopeful[:asked]:
            with suppress(NoObserver):
                x = model.within(rest.fitted.x + _absorbed(rest, shape, solved.strength))
                added = _with_force(rest, acted, shape, solved.strength)
                if likeliest(added, model, x, NEXT_SAMPLE.near(ratio)).cost > plain.cost:
                    continue
                forced = _followed(rest, acted, shape, solved.strength, plain.cost)
                # A likelihood may gain by more than the force, as by another beginning.
                cost = max(forced.cost, plain.cost - solved.gained)
                if best is None or cost < best[0]:
                    best = cost, shape, solved, forced
    if best is None:
        return None
    found, shape, solved, forced = best
    unknowns, base = solved.strength.size, plain.cost
    least = wide * chance(unknowns, among)
    # A model that is not fitted to its end gains by anything, and by another observer alone: so
    # both are fitted from where either stood, under the same observers.
    ratio = forced.problem.observer.ratio
    for own in (ratio, RESIDUAL.slower * ratio):
        if base - found < least:
            return None
        with suppress(NoObserver):
            for x in (plain.fitted.x, forced.fitted.x):
                problem, fitted = _under(acted, model, x, Family((own,)))
                base = min(base, problem.cost(fitted))
            problem, fitted = _under(forced.experiments, model, forced.fitted.x, Family((own,)))
            found = min(found, max(problem.cost(fitted), plain.cost - solved.gained))
    if base - found < least:
        return None
    said = (
        f"a force at {shape.place} that follows {shape.follows} would make the recording likelier"
        f" by {base - found:.0f} in -2 log likelihood with {unknowns} unknowns"
    )
    return Left(base - found, said, True)


def _under(
    experiments: Sequence[Experiment], model: Model, x: Floats, family: Family, rounds: int = 12
) -> tuple[Problem, Fitted]:
    """Return recordings under the likeliest noise of a family at x, and the fit there."""
    problem = likeliest(experiments, model, x, family).problem(experiments)
    return problem, problem.fit(model, x, rounds)


def _settled(experiments: Sequence[Experiment], model: Model, x: Floats, turns: int = 3) -> _Forced:
    """Fit and choose the noise in turn, until a turn gains less than half."""
    best: _Forced | None = None
    for _ in range(turns):
        at = NEXT_SAMPLE if best is None else NEXT_SAMPLE.near(best.problem.observer.ratio)
        problem, fitted = _under(experiments, model, x, at, 4)
        found, x = problem.cost(fitted), fitted.x
        gained = np.inf if best is None else best.cost - found
        if gained > 0.0:
            best = _Forced(list(experiments), problem, fitted, found)
        if gained < 0.5:
            break
    assert best is not None
    return best


def _followed(
    rest: Remainder, acted: Sequence[Experiment], shape: Shape, strength: Floats, base: float
) -> _Forced:
    """Fit beside a force, which is computed again along the motion predicted then, in turn.

    Raises NoObserver where no observer follows the recordings with it.
    """
    model, best = rest.fitted.model, None
    x = rest.fitted.x + _absorbed(rest, shape, strength)
    for _ in range(3):
        forced = _with_force(rest, acted, shape, strength)
        found = _settled(forced, model, model.within(x), 1)
        if best is not None and found.cost > best.cost - 0.5:
            break
        best, x = found, found.fitted.x
        if found.cost > base - 10.0:  # too little for a further turn to make something of
            break
        rest = Remainder(found.problem, found.fitted)
        same = (s for s in bank(rest) if (s.place, s.follows) == (shape.place, shape.follows))
        shape = next(same)
        strength = strength + rest.solved(shape.place, shape.columns, shape.levels).strength
    assert best is not None
    return best


def _with_force(
    rest: Remainder, acted: Sequence[Experiment], shape: Shape, strength: Floats
) -> list[Experiment]:
    """Return recordings with a force added; raises NoObserver where it overflows."""
    found: list[Experiment] = []
    for e, columns in zip(acted, shape.columns, strict=True):
        f = (columns @ strength)[:, None] * shape.place.row(rest.masses)
        if not np.isfinite(f).all():
            raise NoObserver(f"the motion beside a force at {shape.place} overflows")
        found.append(replace(e, force=f if e.force is None else e.force + f))
    return found


def _absorbed(rest: Remainder, shape: Shape, strength: Floats) -> Floats:
    """Return the change of x by which the fit makes room for a force, none above 1."""
    moved = rest.fitted.residual + rest.signatures(shape.place, shape.columns) @ strength
    way = rest.off.absorbing(moved)
    return way / max(1.0, float(np.abs(way).max(initial=0.0)))

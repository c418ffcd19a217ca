"""Unknown physics that a fast observer hides: sought with slower ones, judged by likelihood.

Missing physics without a name is modelled as a force of free shape at one place,

    f = sum over bins of a state (position, velocity, command, time) of a_i in bin i,
    f = q sum_k a_k cos(k pi t / length), q a speed, an acceleration, a deflection or its rate, or
    f = a v^3,

The second form describes a damper, mass or spring that drifts, the third the remainder of a drag
with another power. Under a slower observer, which attributes no motion to disturbance, least
squares gives the a, orthogonal to the refit. The best shapes are then added to the recording as a
known force, computed in each round along the motion that the model with the force predicts. The
criterion is the likelihood with and without the force, each with its own most likely observer.
Limits: a force that changes the motion completely is not found in so few rounds.

A named effect may imitate unknown physics: a hum resembles a mode without damping, the cube of a
velocity resembles its square and some friction. So in place of each named effect, and of all
together, the strongest repeating force and the cube of a velocity are tried (`instead`). If such a
force is more likely with no more unknowns, the effect is not named.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.signal import fftconvolve

from zwidth.diagnosis.fitting.descend import descended, fit, fitted_at, ground_of
from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.fitting.uncertainty import inflation
from zwidth.diagnosis.forces.leftover import Leftover, factors, leftover, predicted_states
from zwidth.diagnosis.forces.locate import STATES, motions, state_of
from zwidth.diagnosis.forces.spatial import response
from zwidth.diagnosis.noise.family import NEXT_SAMPLE, SLOWER, Family, blind
from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.noise.settle import STILL, cost_at, fitted_in_turn, prepared_for
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.seeking.screen import Complement
from zwidth.diagnosis.settings import FREE_FORCES
from zwidth.jobs.parallel import in_parallel, threads
from zwidth.sim.place import MASSES, masses_and_links, place_at

Floats = NDArray[np.float64]
# Quantiles of the samples that separate bins: narrow at the ends, where stops are.
QUANTILES = (0.0, 0.005, 0.02, 0.06, 0.15, 0.3, 0.5, 0.7, 0.85, 0.94, 0.98, 0.995, 1.0)
DRIFTS = 5  # cosines of a drift
TURNS = 3  # most alternations of observer, parameters and strengths
ROUNDS = 4  # rounds of a fit beside such a force
HOPE = 10.0  # gain in -2 log likelihood that justifies another turn
FARTHEST = 1.0  # in x: the most that parameters move beside a force before a fit
CUBE = "the cube of velocity"
WAVING = 3  # unknowns of a repeating force: cosine, sine and period
SWINGS = np.arange(0.5, 10.0, 0.25)  # half periods of a varying inertia over the travel
JUDGED = 3  # shapes of each view whose likelihood is computed


@dataclass(frozen=True)
class Shape:
    """A force of free shape: one column for each unknown, (ticks, unknowns) per recording.

    ends: share (n,) of the force on every mass; -1 at the far end of a link. rebuilt: returns the
    shape along the motion that another problem and fit predict.
    """

    place: str
    follows: str
    ends: Floats
    columns: Sequence[Floats | NDArray[np.bool_]]
    rebuilt: Callable[[Problem, Fitted], "Shape"]

    def forces(self, strength: Floats) -> list[Floats]:
        """Return the forces (ticks, n) at some strengths (unknowns,)."""
        return [(c @ strength)[:, None] * self.ends for c in self.columns]


@dataclass(frozen=True)
class Gained:
    """A shape, the strengths that explain most, and their gain in chi-square."""

    shape: Shape
    strength: Floats
    gained: float


@dataclass(frozen=True)
class Forced:
    """A model fitted with a known force in the experiments: cost, x and the observer's ratio."""

    cost: float
    x: Floats
    ratio: float
    experiments: Sequence[Experiment]


@dataclass(frozen=True)
class Unknown:
    """The most likely shape: gain in -2 log likelihood, and number of unknowns."""

    gained: float
    unknowns: int
    place: str
    follows: str

    @property
    def sentence(self) -> str:
        """Say which force would explain the recording better."""
        return (
            f"a force at {self.place} that depends on {self.follows} would make the recording"
            f" likelier by {self.gained:.0f} in -2 log likelihood with {self.unknowns} unknowns"
        )


@dataclass(frozen=True)
class Instead:
    """A force outside the library in place of named effects: its gain, less its penalty.

    sure: whether it is more likely by `FREE_FORCES.rather`; else it is only mentioned.
    """

    gained: float
    unknowns: int
    place: str
    follows: str
    name: str
    sure: bool = True

    @property
    def sentence(self) -> str:
        """Say which force explains the recording better."""
        number = f"{self.unknowns} unknown{'s' if self.unknowns > 1 else ''}"
        how = self.follows
        how = how if how.startswith(("repeats", "depends on")) else f"depends on {how}"
        return (
            f"a force at {self.place} that {how} makes the recording likelier than"
            f" {self.name} by {self.gained:.0f} in -2 log likelihood, after the penalty for"
            f" {number}"
        )


def unknown(experiments: Sequence[Experiment], fitted: Fitted) -> Unknown | None:
    """Return the most likely force of free shape beside a fitted model, on all recordings.

    None if no observer can follow a recording with such a force. No fit keeps the result, so the
    recordings may be held-out ones.
    """
    best: tuple[float, Gained, Forced] | None = None
    problem = prepared_for(experiments, fitted.model, fitted.x)
    plain = fit(problem, fitted.model, fitted.x)
    asked = list(views_of(problem, plain))
    near = NEXT_SAMPLE.near(problem.observer.ratio)
    without = in_parallel([partial(alone, at, v.experiments, near) for v, at in asked], threads())
    base = min(problem.cost(plain), *without)
    gains = in_parallel([partial(_gains, v, at) for v, at in asked], threads())
    tried = [
        (view, there, one)
        for (view, there), every in zip(asked, gains, strict=True)
        for one in sorted(every, key=_surplus, reverse=True)[:JUDGED]
    ]
    judged = in_parallel([partial(_if_followed, *each, base, near) for each in tried], threads())
    for (_, _, one), forced in zip(tried, judged, strict=True):
        if forced is None:
            continue
        # A likelihood may also gain otherwise, for example by another initial state.
        found = max(forced.cost, base - one.gained)
        if one.shape.follows == "time" and base - found < FREE_FORCES.over_time:
            continue
        if best is None or found < best[0]:
            best = found, one, forced
    if best is None:
        return None
    found, one, forced = best
    # An unfinished fit gains by any change, even by another observer alone. The fit without the
    # force may not leave the x found with the force: also fit from its own x.
    both, model = (plain.x, forced.x), fitted.model
    beside = replace(fitted, x=forced.x)
    base = min(base, alone(beside, experiments, near))
    base = min(base, *(cost_at(forced.ratio, model, x, experiments) for x in both))
    if base - found < FREE_FORCES.weak:  # a slower observer must agree
        slower = SLOWER * forced.ratio
        base = min(base, *(cost_at(slower, model, x, experiments) for x in both))
        found = min(found, cost_at(slower, model, forced.x, forced.experiments))
    return Unknown(base - found, one.strength.size, one.shape.place, one.shape.follows)


def views_of(problem: Problem, current: Fitted) -> Iterator[tuple[Problem, Fitted]]:
    """Yield the given observer, then a slower one with the model refitted, if possible."""
    experiments = problem.experiments
    yield problem, current
    ratio = SLOWER * problem.observer.ratio
    with suppress(NoObserver):  # too slow to stabilize the device
        slow = prepared_for(experiments, current.model, current.x, blind(ratio))
        refitted = fit(slow, current.model, current.x)
        slow = prepared_for(slow.experiments, current.model, refitted.x, blind(ratio))
        yield slow, fit(slow, current.model, refitted.x)


def instead(
    problem: Problem, final: Fitted, without: Fitted, experiments: Sequence[Experiment], name: str
) -> Instead | None:
    """Return a force outside the library that explains more than some effects, or None.

    without: the fit without these effects; name: of them. Tries the cube of a velocity, an inertia
    that varies with position, and the strongest repeating or drifting force, with no more unknowns
    than the effects. Each is judged by likelihood, with its own most likely observer.
    """
    n = final.model.acting(final.x).chain.masses.size
    named = final.x.size - without.x.size
    lost = without.chi2 - final.chi2
    shapes = [s for s in _shapes(problem, without, n) if s.follows == CUBE]
    off = Complement(without.jacobian)
    lines: list[Leftover] = []
    if named >= WAVING:
        line = leftover(problem, without)
        if line.gained > line.chance * inflation(without.white):
            lines.append(line)
        if experiments[0].outputs[0].quantity == "position":  # else the travel may be a drift
            lines.append(_swinging(problem, without, off, n))
    for one in lines:
        shapes.append(_repeating(problem, without, _between_lines(problem, without, off, one), n))
    best: Instead | None = None
    price = float(np.log(problem.observer.told * final.samples))
    near = NEXT_SAMPLE.near(problem.observer.ratio)
    least = alone(final, experiments, near) + named * price - FREE_FORCES.rather
    for shape in shapes:
        one = Gained(shape, *_solved(problem, without, off, shape))
        unknowns = one.strength.size + (shape.follows != CUBE)  # plus its period
        if unknowns > named or one.gained < FREE_FORCES.part * lost:
            continue
        try:
            paid = _with_force(problem, without, one, np.inf, near).cost
        except NoObserver:
            continue
        paid += unknowns * price
        if paid < least:
            gained = float(least + FREE_FORCES.rather - paid)
            best, least = Instead(gained, unknowns, shape.place, shape.follows, name), paid
    return best


def _swinging(problem: Problem, fitted: Fitted, off: Complement, n: int) -> Leftover:
    """The inertia of m1, periodic in its position over few periods, that explains most.

    An eccentric encoder is equivalent by a change of coordinates, except for command and dampers,
    and the part that a refit does not absorb is on other lines of the spectrum.
    """
    positions = np.concatenate([x[SETTLING:, 0] for x in predicted_states(problem, fitted)])
    spacing = 0.5 / float(np.ptp(positions))
    best = Leftover(-np.inf, 0.0, "m1", "acceleration", "position", 1.0, spacing)
    for number in SWINGS:
        line = replace(best, period=1.0 / (number * spacing))
        gained = _solved(problem, fitted, off, _repeating(problem, fitted, line, n))[1]
        if gained > best.gained:
            best = replace(line, gained=gained)
    return best


def _between_lines(problem: Problem, fitted: Fitted, off: Complement, line: Leftover) -> Leftover:
    """The best period between a line and its neighbours: a wave of few periods is on no line."""
    n = fitted.model.acting(fitted.x).chain.masses.size

    def at(further: float) -> Leftover:
        return replace(line, period=1.0 / (1.0 / line.period + further * line.spacing))

    def lost(further: float) -> float:
        return -_solved(problem, fitted, off, _repeating(problem, fitted, at(further), n))[1]

    nearest = max(-1.0, 0.5 - 1.0 / (line.period * line.spacing))  # not beyond half a line
    best = minimize_scalar(lost, bounds=(nearest, 1.0), method="bounded", options={"xatol": 0.02})
    return at(float(best.x)) if best.fun < lost(0.0) else line


def _repeating(problem: Problem, fitted: Fitted, line: Leftover, n: int) -> Shape:
    """The strongest line as a force: cosine and sine times the quantity it is proportional to."""
    states = predicted_states(problem, fitted)
    period = problem.experiments[0].period
    place = place_at(line.at)
    columns: list[Floats] = []
    for x, q in zip(states, factors(line.at, states, n, period)[line.follows], strict=True):
        over = period * np.arange(q.size) if line.over == "time" else x[:, 0]
        turn = 2.0 * np.pi * over / line.period
        both = _settled(q)[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
        if (line.follows, line.over) == ("acceleration", "position"):
            # Without m'(x) v^2 / 2 an inertia m(x) would generate energy. With an eccentric encoder
            # the readings move in the same way, but command and dampers vary too.
            speed = _settled(x[:, n + place.index] ** 2)[:, None]
            both += np.pi / line.period * speed * np.column_stack([-np.sin(turn), np.cos(turn)])
        columns.append(both)
    how = f"depends on {line.follows} and repeats with {line.over}"
    if line.follows == "1":
        how = f"repeats with {line.over}"
    elif (line.follows, line.over) == ("acceleration", "position"):
        how = "depends on acceleration, like an inertia that repeats with position,"
    again = partial(_repeating, line=line, n=n)
    return Shape(line.at, how, place.row(n), columns, again)


def _surplus(one: Gained) -> float:
    return one.gained - 2.0 * one.strength.size


def alone(fitted: Fitted, experiments: Sequence[Experiment], family: Family) -> float:
    """Cost of the model without such a force, fitted for as many turns as one with a force."""
    return fitted_in_turn(experiments, fitted.model, fitted.x, family, TURNS, ROUNDS)[0]


def _if_followed(
    view: Problem, fitted: Fitted, one: Gained, base: float, family: Family
) -> Forced | None:
    """As `_with_force`; None if no observer can follow the recording with that force."""
    with suppress(NoObserver):
        return _with_force(view, fitted, one, base, family)
    return None


def _with_force(view: Problem, fitted: Fitted, one: Gained, base: float, family: Family) -> Forced:
    """Cost and fit of the model with known forces: observer, parameters and strengths in turn.

    view, fitted: for which the strengths were found; family: of the noise in the first round.
    """
    found, strength, shape = np.inf, one.strength, one.shape
    ratio, model = view.observer.ratio, fitted.model
    x, forced = fitted.x + _moved(view, fitted, one), list(view.experiments)
    _refuse_overflow(shape)
    for turn in range(TURNS):
        forced = [
            e.pushed_by(f) for e, f in zip(view.experiments, shape.forces(strength), strict=True)
        ]
        problem = prepared_for(forced, model, x, family)
        ratio = problem.observer.ratio
        family = NEXT_SAMPLE.near(ratio)
        if turn == 0 and ground_of(problem, model).costs([x])[0] > base:
            return Forced(base, x, ratio, forced)
        ended = descended(problem, model, x, ROUNDS)
        x, before, found = ended.x, found, min(found, ended.cost)
        if found > min(base - HOPE, before - STILL):
            break
        fitted = fitted_at(problem, model, x)
        off = Complement(fitted.jacobian)
        shape = shape.rebuilt(problem, fitted)
        _refuse_overflow(shape)
        strength = strength + _solved(problem, fitted, off, shape)[0]
    return Forced(found, x, ratio, forced)


def _refuse_overflow(shape: Shape) -> None:
    if not all(np.isfinite(c).all() for c in shape.columns):
        raise NoObserver(f"the simulated motion under a force at {shape.place} overflows")


def _gains(problem: Problem, fitted: Fitted) -> list[Gained]:
    """Every shape, with its best strengths and gain in chi-square with this observer."""
    n = fitted.model.acting(fitted.x).chain.masses.size
    off = Complement(fitted.jacobian)
    return [
        Gained(shape, *_solved(problem, fitted, off, shape))
        for shape in _shapes(problem, fitted, n)
    ]


def _solved(
    problem: Problem, fitted: Fitted, off: Complement, shape: Shape
) -> tuple[Floats, float]:
    """Return the strengths that explain most beyond the refit, and the chi-square gained.

    Both are zero if the model overflows under the force.
    """
    left, matrix = off(fitted.residual), _signatures(problem, fitted, off, shape)
    if not np.isfinite(matrix).all():
        return np.zeros(matrix.shape[1]), 0.0
    size = np.linalg.norm(matrix, axis=0)
    size[size == 0.0] = 1.0
    solved = np.linalg.lstsq(matrix / size, -left, rcond=1e-6)[0] / size
    if place_at(shape.place).kind == "link" and shape.follows in STATES:
        # Bins add up to one, and a constant force in a link only changes the initial state.
        solved -= float(np.mean(np.concatenate(shape.columns) @ solved))
    gained = float(left @ left - np.sum((left + matrix @ solved) ** 2))
    return np.asarray(solved, dtype=np.float64), gained


def _signatures(problem: Problem, fitted: Fitted, off: Complement, shape: Shape) -> Floats:
    """The signatures of the unknowns, orthogonal to the refit, as columns."""
    answer = _answer(problem, fitted, shape)
    return np.column_stack(
        [
            off(_signature(fitted, answer, [c[:, k] for c in shape.columns]))
            for k in range(shape.columns[0].shape[1])
        ]
    )


def _moved(problem: Problem, fitted: Fitted, one: Gained) -> Floats:
    """The change of the model's x with the force, to first order, at most `FARTHEST`."""
    whole = [c @ one.strength for c in one.shape.columns]
    signature = _signature(fitted, _answer(problem, fitted, one.shape), whole)
    way = -np.linalg.lstsq(fitted.jacobian, fitted.residual + signature, rcond=1e-6)[0]
    return np.asarray(
        way / max(1.0, float(np.abs(way).max(initial=0.0)) / FARTHEST), dtype=np.float64
    )


def _answer(problem: Problem, fitted: Fitted, shape: Shape) -> Floats:
    """Response of the weighted innovations to a unit force of a shape."""
    ends = shape.ends[shape.ends != 0.0]
    answers = [response(problem, fitted, MASSES[i]) for i in np.flatnonzero(shape.ends)]
    return np.tensordot(ends, np.array(answers), 1)


def _signature(
    fitted: Fitted, answer: Floats, forces: Sequence[Floats | NDArray[np.bool_]]
) -> Floats:
    """The contribution of a force, (ticks,) per recording, to the residual."""
    parts = [fftconvolve(f[:, None], answer, axes=0)[SETTLING : f.size].ravel() for f in forces]
    joined = np.concatenate(parts)
    return np.concatenate([joined, np.zeros(fitted.residual.size - joined.size)])


def _shapes(problem: Problem, fitted: Fitted, n: int) -> Iterator[Shape]:
    moved, states = motions(problem, fitted), predicted_states(problem, fitted)
    pairs = list(zip(problem.experiments, moved, strict=True))
    for there in masses_and_links(n):
        place, ends = str(there), there.row(n)
        for state in STATES:
            values = [state_of(e, m, state) for e, m in pairs]
            edges = np.unique(np.quantile(np.concatenate(values), QUANTILES))
            last = edges.size - 2
            if last < 0:  # a state that never changes (no command)
                continue
            bins = [np.clip(np.searchsorted(edges, v, "right") - 1, 0, last) for v in values]
            binned = [np.eye(last + 1, dtype=np.bool_)[b] for b in bins]
            yield Shape(place, state, ends, binned, _same(place, state, n))
        if there.kind == "mass":
            speeds = [x[:, n + there.index] for x in states]
            cubes = [_settled(v**3)[:, None] for v in speeds]
            yield Shape(place, CUBE, ends, cubes, _same(place, CUBE, n))
        for name, q in factors(place, states, n, problem.experiments[0].period).items():
            if name != "1":
                follows = f"{name} times a slow drift"
                drifting = [_drifting(one) for one in q]
                yield Shape(place, follows, ends, drifting, _same(place, follows, n))


def _same(place: str, follows: str, n: int) -> Callable[[Problem, Fitted], Shape]:
    def again(problem: Problem, fitted: Fitted) -> Shape:
        found = _shapes(problem, fitted, n)
        return next(s for s in found if (s.place, s.follows) == (place, follows))

    return again


def _settled(q: Floats) -> Floats:
    """Return q with zeros while the observer settles."""
    return np.where(np.arange(q.size) < SETTLING + 5, 0.0, q)


def _drifting(q: Floats) -> Floats:
    t = np.arange(q.size) / q.size
    return _settled(q)[:, None] * np.cos(np.pi * np.outer(t, np.arange(1, DRIFTS + 1)))

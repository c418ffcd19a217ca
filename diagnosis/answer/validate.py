"""Does an answer hold on recordings that it was not fitted to? Free runs, one step ahead, regimes.

A hypothesis that costs least may still be wrong: it is the best of those that were tried. If it is
right, its free runs err on held-out data as far as its noise and the uncertainty of its parameters
make them, and no farther. How far that is, a parametric bootstrap says (Gelman, Meng & Stern,
Statistica Sinica 6, 1996): parameters are drawn from what the fit knows of them, and the device so
drawn is driven by the recorded command and by innovations e of the process that the hypothesis
believes in, those of its observer (gain L) that its filters W make white,

    x_(k+1) = f(x_k + L e_k, u_k),    y_k = h(x_k) + e_k,    sum_j W_j e_(k-j) = w_k,

w of the covariance that recordings have a step ahead. The answer follows y in free runs as it
follows the recording. With T its log rms error over runs of one length, and T_i those of R
replicates, the answer is adequate where for all lengths

    (T - m) / (s sqrt(1 + 1/R)) < t,    m, s: mean and deviation of T_i,

t the quantile of Student's t with R - 1 degrees of freedom that is exceeded with odds of alpha. An
error below one step of the encoder refuses nothing: where motion is slow, rounding stays as it is
for long, which is no noise of the filters' colour.

Size alone does not refuse what lacks physics. Errors of free runs are innovations filtered, and the
filters take what a lack of friction leaves in the innovations for noise like any other: with
innovations drawn from the recording itself in blocks, errors are foretold to the percent whatever
lacks. What no noise does is follow the motion. So the same is asked of a second T: the log odds of
the share of the square of errors that forces led by the motion explain (`answer.led`).

And held-out data must not speak against what is named: its free runs, or its likelihood a step
ahead, must be better than those of the better one of device file and refit by more than the blocks
scatter (`compared`).

The recording and its replicates run side by side in the lanes of the kernel.

The last part of a recording is mostly more of the same, and judges little: at one level friction
is a smaller command, in one direction it is a constant force. So what was found is also judged
where it was not fitted in another sense: a regime is left out (a recording, a level of the command,
a direction, a half of the travel), parameters are fitted to the rest, and they must predict what
was left out. With r the weighed innovations and priors at the best x and J their slopes, a fit
without the samples of a regime s, on the rest q alone, moves by one Gauss-Newton step

    dx = -(J_q' J_q)^-1 J_q' r_q,    so that    r_s + J_s dx

is what is left of the regime when it had no part in the fit. An effect holds in a regime unless a
model without it, treated so too, is believed over it there (`selection.evidence`).

Limits: the filters see a resolution of 6.6 Hz at 1 kHz, and noise of a far slower colour makes free
runs of seconds err more than they say. Noise that a force drives is led by motion where that force
is. What lacks and leaves nothing but colour (play that rattles, a stiff cubic spring) is foretold.
A regime which alone determines a parameter (the level of a friction in one direction) is left
aside.
"""

import math
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial, wraps
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.linalg import eigh
from scipy.special import expit, logit
from scipy.stats import norm, wilcoxon
from scipy.stats import t as student

from zwidth.diagnosis.answer.led import Span, span
from zwidth.diagnosis.fitting.fit import Fitted
from zwidth.diagnosis.fitting.many import Many
from zwidth.diagnosis.intake.gate import encoder_step_seen
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.beginning import begun, begun_as
from zwidth.diagnosis.noise.predictor import (
    FINAL,
    SETTLING,
    Observer,
    deviation,
    first_motion,
    free_run_starts,
    free_runs,
    innovations,
    observer_memories,
    padded,
    settling,
    window,
)
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.evidence import compared
from zwidth.diagnosis.selection.hypothesis import Hypothesis
from zwidth.diagnosis.settings import ADEQUACY, EVIDENCE
from zwidth.jobs.parallel import in_parallel, threads
from zwidth.sim.device import Device
from zwidth.sim.kernel import Memory
from zwidth.sim.population import Population, Readings, Recorded
from zwidth.sim.predict import GROUND, OVERFLOW, Outputs

if TYPE_CHECKING:
    from zwidth.diagnosis.selection.searched import Searched

Floats = NDArray[np.float64]
Where = NDArray[np.bool_]
P = ParamSpec("P")
R = TypeVar("R")


@dataclass(frozen=True)
class Ahead:
    """Free runs over a horizon [s]: rms error of the first output, and what is to be expected.

    These in the output's unit; most: above it the answer is not adequate. led: share of its square
    that forces which follow the motion explain; most_led: the same of it.
    """

    horizon: float
    error: float
    expected: float
    most: float
    led: float
    most_led: float

    @property
    def adequate(self) -> bool:
        """Whether the error is within what the answer itself foretells."""
        return self.error <= self.most and self.led <= self.most_led


@dataclass(frozen=True)
class Adequacy:
    """What held-out data say of an answer.

    explained: share of the mean square error of free runs (of the better one of device file and
    refit) that the answer takes away. better: sigma by which it predicts better than these, in
    free runs or a step ahead, whichever is more. names: whether it has any effects. runs: how many
    free runs there were, of the length of which there were most.
    """

    ahead: tuple[Ahead, ...]
    explained: float
    better: float
    names: bool
    runs: int

    @property
    def sound(self) -> bool:
        """Whether free runs err no farther than noise and unknown parameters make them."""
        return all(a.adequate for a in self.ahead)

    @property
    def useful(self) -> bool:
        """Whether what it names is better than doing without, by more than blocks scatter."""
        return not self.names or self.better > ADEQUACY.better_sigma

    @property
    def adequate(self) -> bool:
        """Whether the answer is both."""
        return self.sound and self.useful

    def as_json(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "adequate": self.adequate,
            "better_sigma": self.better,
            "explained_share": self.explained,
            "horizons": [vars(a) for a in self.ahead],
        }


@dataclass(frozen=True)
class HeldOut:
    """rms error over rms of the signal on data not fitted to; noise_floor: what must remain."""

    before: float
    refit: float
    after: float
    noise_floor: float

    @property
    def strays(self) -> bool:
        """Whether free runs err too far beyond the noise of readings for a promise.

        Not where that is unknown. By `negligible` of the motion, and by more than that noise is,
        which is not known to a percent. A noise model of slow forces foretells any error of free
        runs as chance, also one that physics of no library makes: an answer is adequate then, and
        promises nothing all the same.
        """
        return wander(self.after, self.noise_floor)

    def as_json(self) -> dict[str, float]:
        """Return the JSON form."""
        return dict(vars(self))


UNKNOWN_FIT = HeldOut(np.nan, np.nan, np.nan, np.nan)


def wander(error: float, floor: float) -> bool:
    """Whether free runs err too far beyond the noise of readings, see `HeldOut.strays`."""
    square = min(error, OVERFLOW) ** 2
    return square - floor**2 > max(ADEQUACY.negligible**2, ADEQUACY.most * square)


def once(function: Callable[P, R], most: int = 12) -> Callable[P, R]:
    """Return a function that keeps its last answers, by the identity of what it was asked.

    Of sequences by that of their items. For arguments that are never changed in place.
    """
    kept: OrderedDict[Any, tuple[Any, R]] = OrderedDict()

    @wraps(function)
    def asked(*args: P.args, **kwargs: P.kwargs) -> R:
        held = tuple(tuple(a) if isinstance(a, list | tuple) else a for a in args)
        key = tuple(tuple(map(id, a)) if isinstance(a, tuple) else id(a) for a in held)
        if key not in kept:
            kept[key] = held, function(*args, **kwargs)
        kept.move_to_end(key)
        while len(kept) > most:
            kept.popitem(last=False)
        return kept[key][1]

    return asked


@once
def as_filed(device: Device) -> tuple[Model, Floats]:
    """Return the device file's own model, without free values, and its x."""
    model = Model(device)
    return model, np.zeros(len(model.parameters))


@dataclass(frozen=True)
class Shown:
    """A model beside recordings, each begun where it fits best.

    ahead: innovations (ticks, o); errors: of free runs over `window` in the first output (runs,
    ticks), and what was measured there about its mean.
    """

    seen: tuple[Experiment, ...]
    ahead: tuple[Floats, ...]
    errors: tuple[Floats, ...]
    signal: tuple[Floats, ...]

    @property
    def free(self) -> tuple[float, float]:
        """What free runs err by, and the motion in their windows; both rms."""
        return rms(self.errors), rms(self.signal)

    def squares(self) -> Floats:
        """Return the mean square error of each free run."""
        return _bounded(np.concatenate([np.mean(e**2, axis=1) for e in self.errors]))

    def steps(self, observer: Observer) -> Floats:
        """Return -2 log likelihood in stretches, a step ahead, under an observer's noise."""
        each = np.sum(self.weighed(observer) ** 2, axis=1)
        parts = np.array_split(each, max(3, min(20, each.size // 50)))
        return _bounded(np.array([p.sum() for p in parts]))

    def weighed(self, observer: Observer) -> Floats:
        """Return the weighed innovations (ticks, o) of all recordings, once they have settled."""
        each = zip(self.ahead, self.seen, strict=True)
        return np.concatenate([observer.weigh(e)[settling(s) :] for e, s in each])


@once
def shown(model: Model, x: Floats, observer: Observer, experiments: Sequence[Experiment]) -> Shown:
    """Run a model along recordings; asked again of the same, from memory."""
    device = model.acting(x)
    seen = tuple(begun(device, model.seen(e, x), observer) for e in experiments)
    ahead = tuple(innovations(device, e, observer.gain) for e in seen)
    errors: list[Floats] = []
    signal: list[Floats] = []
    for e in seen:
        length = window(e)
        (runs,) = free_runs(device, e, observer.gain, [length], e.ticks)
        errors.append(runs.errors[:, :, 0])
        each = [e.measured[first : first + length, 0] for first in free_run_starts(e, length)]
        signal.append(np.array([y - y.mean() for y in each]).reshape(-1, length))
    return Shown(seen, ahead, tuple(errors), tuple(signal))


def held_out(
    device: Device, found: "Searched", judge_by: Sequence[Experiment]
) -> tuple[HeldOut, HeldOut]:
    """Return (one step, free run) of the device before, refitted and augmented; opens the data.

    Errors of the first output over its own variation; free runs start from the observer's state.
    """
    judge = found.judge
    models = [as_filed(device), *((f.model, f.x) for f in (found.refit, found.final))]
    each = [shown(model, x, judge, judge_by) for model, x in models]
    step = [e.measured[settling(e) :, 0] for e in judge_by]
    swing = rms([y - y.mean() for y in step])
    one = [
        rms([e[settling(s) :, 0] for e, s in zip(m.ahead, m.seen, strict=True)]) / swing
        for m in each
    ]
    free = [error / motion for error, motion in (m.free for m in each)]
    model, x = models[-1]
    fitted_on = [model.seen(e, x) for e in found.problem.experiments]
    noise = float(deviation(model.acting(x), fitted_on, judge.gain)[0])
    return (
        HeldOut(one[0], one[1], one[2], noise / swing),
        HeldOut(free[0], free[1], free[2], noise / each[-1].free[1]),
    )


def free_share(
    model: Model, x: Floats, observer: Observer, judge_by: Sequence[Experiment]
) -> float:
    """Return what free runs of a model err by over the motion, as `held_out` counts it."""
    error, motion = shown(model, x, observer, judge_by).free
    return error / motion


def wandering(final: Fitted, observer: Observer, experiments: Sequence[Experiment]) -> bool:
    """Whether free runs of an answer stray on recordings that it was fitted to."""
    run = shown(final.model, final.x, observer, experiments)
    error, motion = run.free
    with np.errstate(all="ignore"):  # infinite after an overflow
        each = zip(run.ahead, run.seen, strict=True)
        floor = rms([e[settling(s) :, 0] for e, s in each])
    return motion > 0.0 and wander(error / motion, floor / motion)


def adequacy(
    nominal: Model, refit: Fitted, final: Fitted, observer: Observer, judge_by: Sequence[Experiment]
) -> Adequacy | None:
    """Judge an answer by recordings that it was not fitted to.

    nominal: of the device as its file says. Returns None where nothing can be said: recordings
    shorter than three of the shortest free runs, or no noise follows.
    """
    return _adequacy(nominal.nominal, refit, final, observer, judge_by)


@once
def _adequacy(
    device: Device, refit: Fitted, final: Fitted, observer: Observer, judge_by: Sequence[Experiment]
) -> Adequacy | None:
    own = shown(final.model, final.x, observer, judge_by)
    lengths, process = _lengths(judge_by), _process(observer, own)
    if process is None or not lengths:
        return None
    runs = _replicated(final, process, judge_by, own.seen, lengths)
    acting, period = final.model.acting(final.x), judge_by[0].period
    spans = [span(acting, judge_by[0], motion) for _, motion in runs]
    step = _step(judge_by)
    ahead: list[Ahead] = []
    for n, (errors, _), directions in zip(lengths, runs, spans, strict=True):
        sizes, shares = _statistics(errors, directions)
        size, share = _band(sizes[1:]), _band(shares[1:])
        if size is None or share is None:
            continue
        expected, most = (math.exp(v) for v in size)
        # A free run that runs away is the worst of errors, and led by nothing.
        away = not math.isfinite(sizes[0])
        ahead.append(
            Ahead(
                n * period, OVERFLOW if away else math.exp(sizes[0]), expected, max(most, step),
                0.0 if away else float(expit(shares[0])),
                max(ADEQUACY.negligible, float(expit(share[1]))),
            )
        )  # fmt: skip
    if not ahead:
        return None
    others = [as_filed(device), (refit.model, refit.x)]
    explained, better = _better(
        observer, own, [shown(model, x, observer, judge_by) for model, x in others]
    )
    most_runs = max(errors.shape[1] for errors, _ in runs)
    return Adequacy(tuple(ahead), explained, better, bool(final.model.effects), most_runs)


def _better(observer: Observer, own: Shown, others: Sequence[Shown]) -> tuple[float, float]:
    """Share of the square error explained, and sigma over the better of device file and refit."""
    free, step = own.squares(), own.steps(observer)
    best_free = min((o.squares() for o in others), key=np.sum)
    best_step = min((o.steps(observer) for o in others), key=np.sum)
    total = float(best_free.sum())
    explained = 1.0 - float(free.sum()) / total if total > 0.0 else 0.0
    return explained, max(_sigma(best_free - free), compared(best_step - step).sigma)


def _lengths(judge_by: Sequence[Experiment], least: int = 3, shortest: int = 5) -> list[int]:
    """Ticks of free runs of which there are enough; of short recordings as long as they allow.

    least: runs of a length, in all recordings; shortest: ticks of a run.
    """
    period = judge_by[0].period
    ticks = [e.ticks - settling(e) for e in judge_by]
    asked = [max(shortest, round(h / period)) for h in ADEQUACY.horizons_s]
    fitting = [n for n in dict.fromkeys(asked) if sum(t // n for t in ticks) >= least]
    longest = max(ticks) // least
    return fitting or ([longest] if longest >= shortest else [])


def _band(logs: Floats, least: int = 3) -> tuple[float, float] | None:
    """Return mean, and what another of the same kind exceeds with odds of alpha."""
    told = logs[np.isfinite(logs)]
    if told.size < least:
        return None
    spread = float(told.std(ddof=1)) * math.sqrt(1.0 + 1.0 / told.size)
    mean = float(told.mean())
    return mean, mean + float(student.isf(EVIDENCE.alpha, told.size - 1)) * spread


def _statistics(errors: Floats, directions: Span) -> tuple[Floats, Floats]:
    """Log rms of errors (members, runs, ticks), and log odds of what motion explains of them."""
    flat = errors.reshape(errors.shape[0], -1)
    with np.errstate(all="ignore"):  # infinite after an overflow
        sizes = np.log(np.sqrt(np.mean(flat**2, axis=1)))
        return sizes, logit(np.array([directions.share(e) for e in flat]))


@dataclass(frozen=True)
class Process:
    """Innovations of an observer that its filters make white, of covariance root root'."""

    observer: Observer
    root: Floats

    def drawn(self, ticks: int, random: np.random.Generator, memory: int = 4000) -> Floats:
        """Return innovations (ticks, o): of a process without end, so that none needs to settle.

        Autoregression by division of spectra, of a period longer than is asked for by the ticks
        that the filters remember.
        """
        filters = self.observer.filters()
        size = next_fast_len(ticks + memory, real=True)
        white = random.standard_normal((size, self.root.shape[0])) @ self.root.T
        response = np.moveaxis(np.fft.rfft(filters, size, axis=2), 2, 0)
        spectrum = np.linalg.solve(response, np.fft.rfft(white, axis=0)[:, :, None])[:, :, 0]
        return np.fft.irfft(spectrum, size, axis=0)[:ticks]


def _process(observer: Observer, own: Shown) -> Process | None:
    """The colour that the answer believes in, as strong as recordings have it a step ahead."""
    white = own.weighed(observer)
    with np.errstate(all="ignore"), suppress(np.linalg.LinAlgError):
        root = np.linalg.cholesky(white.T @ white / white.shape[0])
        return Process(observer, root) if np.all(np.isfinite(root)) else None
    return None


def _known(final: Fitted, told: float = 10.0) -> Floats:
    """Return a root (x, directions) of the covariance of what the recordings tell of x.

    Directions that they do not tell (a free gain against all masses at once) change no motion, and
    are left out: far along them the first order no longer holds. told: information from which one
    is told, of which a device file's own is one.
    """
    slopes = final.jacobian[: final.samples]
    information, directions = np.linalg.eigh(slopes.T @ slopes)
    kept = information > told
    return directions[:, kept] / np.sqrt(information[kept])


def _replicated(
    final: Fitted,
    process: Process,
    judge_by: Sequence[Experiment],
    own: Sequence[Experiment],
    lengths: Sequence[int],
    replicates: int = 15,
) -> list[tuple[Floats, Floats]]:
    """Free runs of each length: errors (1 + replicates, runs, ticks), motion (runs, ticks, 2n).

    Of the first output; the recording comes first, and the motion is what the answer foretells of
    it. own: the recordings as the answer sees them. With 15 replicates all fill the kernel's lanes.
    """
    random = np.random.default_rng(0)
    model, root = final.model, _known(final)
    xs = [
        model.within(final.x + root @ random.standard_normal(root.shape[1]))
        for _ in range(replicates)
    ]
    drawn, same = Many(model, xs, FINAL), Many(model, [final.x] * (1 + replicates), FINAL)
    each: list[list[tuple[Floats, Floats]]] = []
    for e, mine in zip(judge_by, own, strict=True):
        played = _played(model, drawn, process, e, mine, random)
        ((_, population, device),) = same.kinds(e)
        seen = _begun_each(model.acting(final.x), mine, played, process.observer)
        each.append(_Lanes(population, device, seen, process.observer.gain).free_runs(lengths))
    joined: list[tuple[Floats, Floats]] = []
    for of_length in zip(*each, strict=True):
        errors, motion = zip(*of_length, strict=True)
        joined.append((np.concatenate(errors, axis=1), np.concatenate(motion)))
    return joined


def _begun_each(
    device: Device, mine: Experiment, played: Floats, observer: Observer
) -> list[Experiment]:
    """The recording and its replicates (members, ticks, o), each begun where it fits best."""
    each = [replace(mine, measured=y) for y in played[1:]]
    if mine.before is None:
        tasks = [partial(begun, device, e, observer) for e in each]
        each = in_parallel(tasks, threads())
    return [mine, *each]


def _played(
    model: Model,
    drawn: Many,
    process: Process,
    e: Experiment,
    mine: Experiment,
    random: np.random.Generator,
) -> Floats:
    """A recording and its replicates (1 + members, ticks, o), as the answer reads them.

    What the drawn device reads otherwise than the answer (gain, origin) is taken off as the device
    reads it, and put on as the answer does. Infinite where a member overflows.
    """
    found = np.full((1 + drawn.size, *mine.measured.shape), np.inf)
    found[0] = mine.measured
    errors = [process.drawn(e.ticks, random) for _ in range(drawn.size)]
    for which, population, device in drawn.kinds(e):
        theirs = [begun_as(model.seen(e, drawn.xs[i]), mine) for i in which]
        gains = np.array([model.reads(model.there(drawn.xs[i], e)).gain for i in which])
        lanes = _Lanes(population, device, theirs, process.observer.gain, gains)
        y = lanes.driven(np.stack([errors[i] for i in which]))
        found[1 + which] = y + [mine.measured - t.measured for t in theirs]
    return found


class _Lanes:
    """Members of a population side by side, each along a recording of its own.

    The kernel takes one recording for all. So each member's readings are columns of it, which its
    own observer gain reads and those of the others do not. each: a recording as each member sees
    it, under one command, which counts gains (members,) times that of the first.
    """

    def __init__(
        self,
        population: Population,
        device: Device,
        each: Sequence[Experiment],
        gain: Floats,
        gains: Floats | None = None,
    ) -> None:
        self.population, self.e = population, each[0]
        self.measured = np.stack([e.measured for e in each])
        self.masses = device.chain.masses.size
        self.full = padded(gain, device, population, self.e)
        self.gains = np.ones(len(each)) if gains is None else gains / gains[0]
        self.outputs, self.forces = self.e.places(population), self.e.external(population.dof)
        if self.e.before is None:
            motions = np.array([first_motion(e.outputs, e.measured, e.period) for e in each])
            starts = [np.zeros(2 * self.masses) if e.start is None else e.start for e in each]
            self.memories = observer_memories(population, motions, np.stack(starts), self.e.begins)
        else:
            before = [e.before for e in each if e.before is not None]
            first = _Lanes(population, device, before, gain, gains)
            first.follow(slice(0, first.e.ticks))
            self.memories = first.memories

    def follow(self, part: slice) -> None:
        """Go on along a part of what was measured."""
        self._each(self.outputs, self.measured[:, part], self.full, part)

    def _each(self, outputs: Outputs, measured: Floats, gain: Floats, part: slice) -> Floats:
        members, ticks, o = measured.shape
        columns = np.moveaxis(measured, 0, 1).reshape(ticks, members * o)
        wide = _together(*[outputs] * members)
        observers = np.zeros((members, self.population.states, members * o))
        for i in range(members):
            observers[i, :, i * o : (i + 1) * o] = gain
        own = self._run(wide, columns, observers, part, self.memories)
        self.memories = own.memories
        kept = own.innovations.reshape(members, ticks, members, o)
        return kept[np.arange(members), :, np.arange(members)]

    def _run(
        self,
        outputs: Outputs,
        measured: Floats,
        observers: Floats,
        part: slice,
        memories: Sequence[Memory],
    ) -> Any:
        recorded = Recorded(
            self.e.command[part], np.ascontiguousarray(measured), outputs, self.forces[part],
            strengths=self.e.strengths_in(part),
        )  # fmt: skip
        readings = Readings(observers, self.gains)
        with np.errstate(all="ignore"):  # infinite after an overflow
            return self.population.follow(
                recorded, memories, readings, skipped=recorded.ticks, keep=True
            )

    def driven(self, errors: Floats) -> Floats:
        """Return what the members give (members, ticks, o) with innovations e given, as above.

        What reads a place that stays zero has what it measured for innovation; outputs that correct
        nothing, measured as zero, are h turned round.
        """
        o, whole = errors.shape[2], slice(0, self.e.ticks)
        nowhere = Outputs(np.full(o, GROUND), np.zeros(o, dtype=np.bool_), np.full(o, GROUND))
        both = _together(nowhere, self.outputs)
        measured = np.concatenate([errors, np.zeros(errors.shape)], axis=2)
        gain = np.hstack([self.full, np.zeros(self.full.shape)])
        return errors - self._each(both, measured, gain, whole)[:, :, o:]

    def free_runs(self, lengths: Sequence[int], most: int = 100) -> list[tuple[Floats, Floats]]:
        """Return free runs of each length, see `_replicated`; most: of a length, evenly spread.

        The observers go through the recording once, and leave their states where runs begin.
        """
        begins: dict[int, list[int]] = {}
        for i, length in enumerate(lengths):
            possible = np.array(free_run_starts(self.e, length), dtype=np.int64)
            if possible.size > most:
                spread = np.linspace(0, possible.size - 1, most).round().astype(np.int64)
                possible = possible[spread]
            for first in possible.tolist():
                begins.setdefault(first, []).append(i)
        here, tasks, of = 0, list[Callable[[], tuple[Floats, Floats]]](), list[int]()
        for first in sorted(begins):
            self.follow(slice(here, first))
            here = first
            for i in begins[first]:
                run = slice(first, first + lengths[i])
                tasks.append(partial(self._freely, run, self.memories))
                of.append(i)
        found = in_parallel(tasks, threads())
        runs: list[tuple[Floats, Floats]] = []
        for i, length in enumerate(lengths):
            mine = [f for f, at in zip(found, of, strict=True) if at == i]
            errors = [e for e, _ in mine]
            motion = [m for _, m in mine]
            runs.append((
                np.stack(errors, axis=1) if errors else np.zeros((len(self.measured), 0, length)),
                np.stack(motion) if motion else np.zeros((0, length, 2 * self.masses)),
            ))  # fmt: skip
        return runs

    def _freely(self, part: slice, memories: Sequence[Memory]) -> tuple[Floats, Floats]:
        """Errors of the first output (members, ticks), and the first member's motion."""
        measured = self.measured[:, part, 0]
        o, dof, n = len(self.e.outputs), self.population.dof, self.masses
        states = np.concatenate([np.arange(n), np.arange(dof, dof + n)])
        still = Outputs(states, np.zeros(2 * n, dtype=np.bool_), np.full(2 * n, GROUND))
        wide = _together(self.outputs, still)
        blind = np.zeros((self.population.states, o + 2 * n))
        nothing = np.zeros((part.stop - part.start, o + 2 * n))
        seen = -self._run(wide, nothing, blind, part, memories).innovations
        return measured - seen[:, :, 0], seen[0, :, o:]


def _together(*each: Outputs) -> Outputs:
    """Outputs one after the other."""
    return Outputs(
        np.concatenate([o.state for o in each]),
        np.concatenate([o.sensed for o in each]),
        np.concatenate([o.less for o in each]),
    )


Answered = tuple[Fitted, Observer]
"""An answer and the observer that it is judged under."""


def freer(new: Answered, old: Answered, experiments: Sequence[Experiment]) -> bool:
    """Whether one answer runs free better than another.

    Each under its own observer; the horizon that tells most clearly decides, with odds of
    `preferred`: that the other's noise does not hold was shown before, so neither has the odds for
    it. Blocks differ in how much they can show, so that a few of them tell little by their
    differences: where most of an error is gone, the logarithms of their ratios tell as well.
    """
    told: list[float] = []
    for a, b in _each_length(new, old, experiments):
        told.append(_clearly(b - a))
        if max(a.mean(), b.mean()) * ADEQUACY.most**2 > min(a.mean(), b.mean()) > 0.0:
            told.append(_clearly(_log_ratios(a, b)))
    return max(told, key=abs, default=0.0) > float(norm.isf(ADEQUACY.preferred))


def oftener_freer(new: Answered, old: Answered, experiments: Sequence[Experiment]) -> bool:
    """Whether free runs of one answer err less than those of another more often than by chance.

    By Wilcoxon's signed ranks of the ratios of their errors (Biometrics Bulletin 1, 1945), at any
    horizon with odds of `preferred`. A law with a steep branch errs little in most runs and much in
    the few in which it takes the wrong side; their squares would tell nothing.
    """
    each = [_log_ratios(a, b) for a, b in _each_length(new, old, experiments)]
    odds = [wilcoxon(r, alternative="greater").pvalue for r in each if np.any(r)]
    return bool(min(odds, default=1.0) < ADEQUACY.preferred / max(1, len(each)))


def _log_ratios(a: Floats, b: Floats, tiny: float = 1e-300) -> Floats:
    return np.log(np.maximum(b, tiny) / np.maximum(a, tiny))


def _each_length(
    new: Answered, old: Answered, experiments: Sequence[Experiment]
) -> Iterator[tuple[Floats, Floats]]:
    """Yield mean square errors of the free runs of two answers, for each length that fits."""
    lengths = _lengths(experiments)
    each = [_squares(f.model, f.x, observer, experiments, lengths) for f, observer in (new, old)]
    yield from zip(*each, strict=True)


def _squares(
    model: Model,
    x: Floats,
    observer: Observer,
    experiments: Sequence[Experiment],
    lengths: Sequence[int],
) -> list[Floats]:
    """Mean square errors of free runs in the first output, of each length."""
    device, seen = model.acting(x), shown(model, x, observer, experiments).seen
    each = [free_runs(device, e, observer.gain, lengths, e.ticks) for e in seen]
    return [
        _bounded(np.concatenate([np.mean(r.errors[:, :, 0] ** 2, axis=1) for r in of_length]))
        for of_length in zip(*each, strict=True)
    ]


def _clearly(gains: Floats) -> float:
    """Sigma of a normal of the same odds as Student's t of a mean, of which a few tell less."""
    sigma = _sigma(gains)
    odds = float(student.logsf(abs(sigma), max(1, gains.size - 1)))
    return math.copysign(float(norm.isf(max(math.exp(odds), 1e-300))), sigma)


def _sigma(gains: Floats) -> float:
    """Mean over its standard error."""
    spread = float(gains.std(ddof=1)) if gains.size > 1 else 0.0
    return float(gains.mean()) / spread * math.sqrt(gains.size) if spread > 0.0 else 0.0


def _step(judge_by: Sequence[Experiment]) -> float:
    """The step in which positions of the first output were read; 0 where none is seen."""
    if judge_by[0].outputs[0].quantity != "position":
        return 0.0
    return max(encoder_step_seen(e.measured[:, 0]) or 0.0 for e in judge_by)


def _bounded(values: Floats) -> Floats:
    return np.nan_to_num(values, nan=1e300, posinf=1e300)


def rms(parts: Sequence[Floats]) -> float:
    """Return the root mean square of all that several arrays hold, not a number of nothing."""
    joined = np.concatenate([p.ravel() for p in parts])
    with np.errstate(all="ignore"):  # infinite after an overflow
        return float(np.sqrt(np.mean(joined**2))) if joined.size else float("nan")


@dataclass(frozen=True)
class Held:
    """How an effect does in a regime that had no part in the fit.

    other: where the fit was made. sigma: over doing without it; fails: whether doing without it is
    believed there.
    """

    regime: str
    other: str
    sigma: float
    fails: bool


@dataclass(frozen=True)
class Regime:
    """A part of what was recorded. where: (ticks,) of all recordings, less those of settling.

    other: the words for what lies outside of it.
    """

    name: str
    other: str
    where: Where


def regimes(experiments: Sequence[Experiment], least: float = 0.15) -> list[Regime]:
    """Return the regimes that recordings have: `least` of the samples inside, and outside."""
    found = list(_all_regimes(experiments))
    return [r for r in found if least < float(r.where.mean()) < 1.0 - least]


def _all_regimes(experiments: Sequence[Experiment], levels: float = 1.5) -> Iterator[Regime]:
    """levels: ratio of the command's size in its loud half to that in the quiet one: two levels."""
    if len(experiments) > 1:
        which = np.concatenate([
            np.full(e.ticks - SETTLING, i) for i, e in enumerate(experiments)
        ])  # fmt: skip
        for i, e in enumerate(experiments):
            name = e.name or f"recording {i + 1}"
            yield Regime(f"in {name}", "in the other recordings", which == i)
    size = np.concatenate([_size(e)[SETTLING:] for e in experiments])
    high = size > float(np.median(size))
    if high.any() and not high.all() and size[high].mean() > levels * size[~high].mean():
        yield Regime("at high commands", "at low commands", high)
        yield Regime("at low commands", "at high commands", ~high)
    speed = np.concatenate([_speed(e)[SETTLING:] for e in experiments])
    yield Regime("forwards", "backwards", speed > 0.0)
    yield Regime("backwards", "forwards", speed < 0.0)
    if all(e.outputs[0].quantity == "position" for e in experiments):
        place = np.concatenate([e.measured[SETTLING:, 0] for e in experiments])
        upper = place > float(np.median(place))
        yield Regime("in the upper half of the travel", "in the lower half", upper)
        yield Regime("in the lower half of the travel", "in the upper half", ~upper)


def _size(e: Experiment, stretch_s: float = 0.25) -> Floats:
    """Root mean square of the command over a stretch, (ticks,)."""
    width = max(1, round(stretch_s / e.period))
    return np.sqrt(np.convolve(e.command**2, np.full(width, 1.0 / width), mode="same"))


def _speed(e: Experiment) -> Floats:
    """Velocity of the first output, (ticks,), differenced over a few samples if need be."""
    y = e.measured[:, 0]
    if e.outputs[0].quantity != "position":
        return y
    width = max(2, round(0.01 / e.period))
    return np.gradient(np.convolve(y, np.ones(width) / width, mode="same"))


def held(new: Hypothesis, old: Hypothesis, pieces: int = 20) -> list[Held]:
    """How a hypothesis does in each regime beside one without some of its effects.

    Both priced (with slopes). Regimes that alone say something of a parameter are left out.
    pieces: blocks of a regime, over which gains scatter.
    """
    found: list[Held] = []
    for regime in regimes(new.experiments):
        with_it, without = (_left_out(h, regime.where) for h in (new, old))
        if with_it is None or without is None:
            continue
        gains = [part.sum() for part in np.array_split(without - with_it, pieces)]
        told = compared(np.array(gains))
        fails = -told.gain > 2.0 * told.phi * math.log(1.0 / EVIDENCE.alpha)
        found.append(Held(regime.name, regime.other, told.sigma, bool(fails)))
    return found


def _left_out(h: Hypothesis, where: Where) -> Floats | None:
    """-2 log likelihood (ticks of the regime,) under a fit to the rest; None where that is loose.

    The covariance of all innovations is that of the noise, as in `Observer.cost`.
    """
    if h.slopes is None:
        return None
    observer, samples = h.noise.observer, h.samples
    o = observer.deviation.size
    rows, slopes = h.residual[:samples].reshape(-1, o), h.slopes[:samples]
    if rows.shape[0] != where.size:
        return None
    covariance = rows.T @ rows / rows.shape[0]
    root = np.linalg.inv(np.linalg.cholesky(covariance / observer.counts))
    rows = rows @ root.T
    slopes = np.einsum("pq,kqx->kpx", root, slopes.reshape(-1, o, h.x.size))
    dx = step_without(rows, slopes, (h.residual[samples:], h.slopes[samples:]), where)
    if dx is None:
        return None
    inside = slopes[where].reshape(-1, h.x.size)
    left = rows[where] + (inside @ dx).reshape(-1, o)
    return np.sum(left**2, axis=1) + float(observer.cost_of(covariance[None], 1)[0])


def step_without(
    rows: Floats, slopes: Floats, prior: tuple[Floats, Floats], where: Where, told: float = 0.05
) -> Floats | None:
    """Return dx (p,) by which a fit moves without a regime; None where the rest is loose.

    rows (ticks, o): white residuals; slopes (ticks, o, p); prior: residuals (k,) and slopes (k, p)
    of the priors. told: share of what all samples say of any direction of x that must be left.
    """
    every, rest = (part.reshape(-1, slopes.shape[2]) for part in (slopes, slopes[~where]))
    about = prior[1].T @ prior[1]
    whole, left = every.T @ every + about, rest.T @ rest + about
    if eigh(left, whole, eigvals_only=True).min() < told:
        return None
    downhill = -(rest.T @ rows[~where].ravel() + prior[1].T @ prior[0])
    return np.asarray(np.linalg.solve(left, downhill), dtype=np.float64)

"""Is the model adequate? Compares errors on held-out data with what its noise model predicts.

The hypothesis of least cost may still be wrong: it is only the best of those that were tried. If it
is right, its free runs on held-out data err as much as its noise and the uncertainty of its
parameters predict, and no more. A parametric bootstrap predicts that error (Gelman, Meng & Stern,
Statistica Sinica 6, 1996): parameters are drawn from their covariance, and the device so drawn is
simulated under the same command with innovations e of the fitted noise process; with the observer's
gain L and the whitening filters W,

    x_(k+1) = f(x_k + L e_k, u_k),    y_k = h(x_k) + e_k,    sum_j W_j e_(k-j) = w_k,

where w has the covariance of the recordings' one-step errors, and follows the command where these
do (`noise.loudness`). The answer's free runs on y are then computed as on the recording. Let T be
the log rms error over runs of one length, and T_i the same for each of R draws. The answer is
adequate if for all lengths

    (T - m) / (s sqrt(1 + 1/R)) < t,    m, s: mean and deviation of T_i,

where t is the quantile of Student's t with R - 1 degrees of freedom that is exceeded with
probability ALPHA. An error below one step of the encoder never makes an answer inadequate: in slow
motion the rounding error stays constant for long, and the filters do not describe such noise.

The size of the error alone does not reveal missing physics. Errors of free runs are filtered
innovations, and the filters treat the trace of missing friction in the innovations as noise: with
innovations drawn from the recording itself in blocks, errors are predicted to within one percent,
whatever is missing. But noise does not depend on the motion. So the same test is made with a second
T: the log odds of the share of the squared error explained by forces that depend on the motion
(`answer.coherence`).

Held-out data must also support the effects of the answer: its free runs, or its likelihood one step
ahead, must beat the device file and the refit by more than the scatter of the blocks (`compared`).
This does not apply to an answer without effects.

Limits: the filters resolve 6.6 Hz at 1 kHz. Noise that is much slower makes free runs of seconds
err more than predicted. Noise that enters as a force depends on the motion where that force acts.
Missing physics that leaves only coloured noise (play that rattles, a stiff cubic spring) is not
detected.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.special import expit, logit
from scipy.stats import norm, wilcoxon
from scipy.stats import t as student

from zwidth.diagnosis.answer.coherence import Span, span
from zwidth.diagnosis.fitting.fit import Fitted
from zwidth.diagnosis.intake.gate import encoder_step_seen
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import followed_by
from zwidth.diagnosis.noise.loudness import loudness
from zwidth.diagnosis.noise.predictor import (
    FreeRuns,
    Observer,
    as_followed,
    driven,
    free_run_errors,
    free_runs,
    innovations,
    settling,
    window,
)
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.evidence import ALPHA, compared
from zwidth.diagnosis.settings import ADEQUACY
from zwidth.jobs.parallel import in_parallel, threads
from zwidth.shown import Valued
from zwidth.sim.device import Device
from zwidth.sim.predict import OVERFLOW

Floats = NDArray[np.float64]
RAN_AWAY = 1e100  # mean square error of a run that overflowed
SHORTEST = 5  # ticks of a free run
MOST_RUNS = 100  # free runs of a length in a recording
FORGOTTEN = 4000  # ticks after which innovations no longer depend on earlier ones
BOOTSTRAPS = 16
TOLD = 10.0  # least information in a direction of x; a device file itself has 1


@dataclass(frozen=True)
class Ahead(Valued):
    """Free runs over a horizon [s]: rms error of the first output, and the expected error.

    Errors are in the output's unit; most: the largest error of an adequate answer. led: share of
    the squared error explained by forces that depend on the motion; most_led: the largest such
    share of an adequate answer.
    """

    horizon: float
    error: float
    expected: float
    most: float
    led: float
    most_led: float

    @property
    def adequate(self) -> bool:
        """Whether the error is within what the answer itself predicts."""
        return self.error <= self.most and self.led <= self.most_led


@dataclass(frozen=True)
class Adequacy(Valued):
    """How well an answer predicts held-out data.

    explained: by which share the answer lowers the mean square error over half a second of the
    better of device file and refit. better: by how many sigma it predicts better than both, in free
    runs or one step ahead, whichever is more. names: whether the answer names any effects. runs:
    the largest number of free runs of one length.
    """

    ahead: tuple[Ahead, ...]
    explained: float
    better: float
    names: bool
    runs: int

    @property
    def sound(self) -> bool:
        """Whether free runs err no more than noise and uncertain parameters predict."""
        return all(a.adequate for a in self.ahead)

    @property
    def useful(self) -> bool:
        """Whether the named effects improve the prediction by more than the scatter of blocks."""
        return not self.names or self.better > ADEQUACY.scatter

    @property
    def adequate(self) -> bool:
        """Whether the answer is sound and useful."""
        return self.sound and self.useful

    def as_json(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "adequate": self.adequate,
            "better_sigma": self.better,
            "explained_share": self.explained,
            "horizons": [vars(a) for a in self.ahead],
        }


def adequacy(
    nominal: Model, refit: Fitted, final: Fitted, observer: Observer, judge_by: Sequence[Experiment]
) -> Adequacy | None:
    """Judge an answer by recordings that it was not fitted to.

    nominal: the device file's model, without free values. Returns None if no judgement is possible:
    the recordings are shorter than three free runs of `SHORTEST` ticks, or the noise cannot be
    simulated.
    """
    model, x = final.model, final.x
    others = [(nominal, np.zeros(len(nominal.parameters))), (refit.model, refit.x)]
    own, *without = ([_seen(m, v, e, observer) for e in judge_by] for m, v in [(model, x), *others])
    period = judge_by[0].period
    lengths = _lengths(judge_by)
    noise = _noise(final, observer, own)
    if noise is None or not lengths:
        return None
    runs = _runs(final, observer, own, lengths)
    spans = [span(final.model.acting(final.x), judge_by[0], r.motion) for r in runs]
    tasks = [
        partial(_bootstrapped, final, noise, judge_by, own, lengths, spans, i)
        for i in range(BOOTSTRAPS)
    ]
    errors, led = _judged(runs, spans)
    step = _step(judge_by)
    foretold = np.stack(in_parallel(tasks, threads()))
    ahead: list[Ahead] = []
    for i, n in enumerate(lengths):
        size = _band(foretold[:, 0, i])
        share = _band(foretold[:, 1, i])
        if size is None or share is None:
            continue
        expected, most = (math.exp(v) for v in size)
        most = max(most, step)
        most_led = max(ADEQUACY.led, float(expit(share[1])))
        # A free run that runs away has the worst error, and no force explains a share of it.
        away = not math.isfinite(errors[i])
        error = OVERFLOW if away else math.exp(errors[i])
        follows = 0.0 if away else float(expit(led[i]))
        ahead.append(Ahead(n * period, error, expected, most, follows, most_led))
    if not ahead:
        return None
    explained, better = _better(final, others, observer, own, without)
    most_runs = max(run.errors.shape[0] for run in runs)
    return Adequacy(tuple(ahead), explained, better, bool(final.model.effects), most_runs)


def _lengths(judge_by: Sequence[Experiment]) -> list[int]:
    """Lengths [ticks] with enough free runs in the recordings; shorter for short recordings."""
    period = judge_by[0].period
    ticks = [e.ticks - settling(e) for e in judge_by]
    asked = [max(SHORTEST, round(h / period)) for h in ADEQUACY.horizons]
    fitting = [n for n in dict.fromkeys(asked) if sum(t // n for t in ticks) >= ADEQUACY.runs]
    longest = max(ticks) // ADEQUACY.runs
    return fitting or ([longest] if longest >= SHORTEST else [])


def _seen(model: Model, x: Floats, e: Experiment, observer: Observer) -> Experiment:
    """A recording as a model reads it, followed by its observer."""
    return followed_by(model.acting(x), model.seen(e, x), observer)


def _band(logs: Floats) -> tuple[float, float] | None:
    """Return mean and the value that another sample exceeds with probability ALPHA, or None."""
    told = logs[np.isfinite(logs)]
    if told.size < ADEQUACY.runs:
        return None
    spread = float(told.std(ddof=1)) * math.sqrt(1.0 + 1.0 / told.size)
    mean = float(told.mean())
    return mean, mean + float(student.isf(ALPHA, told.size - 1)) * spread


def _runs(
    final: Fitted, observer: Observer, seen: Sequence[Experiment], lengths: Sequence[int]
) -> list[FreeRuns]:
    """Free runs of the answer on all recordings, joined, for each length."""
    device = final.model.acting(final.x)
    each = [free_runs(device, e, observer.gain, lengths, MOST_RUNS) for e in seen]
    return [
        FreeRuns(*(np.concatenate(same) for same in zip(*of_length, strict=True)))
        for of_length in zip(*each, strict=True)
    ]


def _judged(runs: Sequence[FreeRuns], spans: Sequence[Span]) -> tuple[Floats, Floats]:
    """Log rms error of the first output (lengths,), log odds of the share that motion explains."""
    with np.errstate(all="ignore"):  # infinite after an overflow
        errors = [np.log(np.sqrt(np.mean(r.errors[:, :, 0] ** 2))) for r in runs]
        shares = [s.share(r.errors[:, :, 0].ravel()) for r, s in zip(runs, spans, strict=True)]
        return np.array(errors), logit(np.array(shares))


@dataclass(frozen=True)
class Believed:
    """Innovations of an observer that its filters whiten, with covariance root root'.

    loud: their relative deviation (ticks,) in each recording.
    """

    observer: Observer
    root: Floats
    loud: Sequence[Floats]

    def drawn(self, recording: int, random: np.random.Generator) -> Floats:
        """Return innovations (ticks, o) for a recording; the process needs no time to settle.

        The autoregression is computed by dividing spectra, over a period that is longer than the
        result by the memory of the filters.
        """
        filters, loud = self.observer.filters(), self.loud[recording]
        ticks = loud.size
        size = next_fast_len(ticks + FORGOTTEN, real=True)
        white = random.standard_normal((size, self.root.shape[0])) @ self.root.T
        white[:ticks] *= loud[:, None]
        response = np.moveaxis(np.fft.rfft(filters, size, axis=2), 2, 0)
        spectrum = np.linalg.solve(response, np.fft.rfft(white, axis=0)[:, :, None])[:, :, 0]
        return np.fft.irfft(spectrum, size, axis=0)[:ticks]


def _noise(final: Fitted, observer: Observer, seen: Sequence[Experiment]) -> Believed | None:
    """Noise of the answer's spectrum, as strong as the one-step errors of recordings.

    The noise may be up to `louder` times as strong as in the fitted data, where its deviation is
    one; more than that counts as missing physics. If a machine has no disturbance, the innovations
    of a slow observer consist only of missing physics, and would be predicted as noise.
    """
    device = final.model.acting(final.x)
    each = [_whitened(device, e, observer) for e in seen]
    white = _known_rows(each, seen)
    with np.errstate(all="ignore"), suppress(np.linalg.LinAlgError):
        size = np.sqrt(np.mean(white**2, axis=0))
        white = white * np.minimum(1.0, ADEQUACY.louder / size)
        root = np.linalg.cholesky(white.T @ white / white.shape[0])
        if np.all(np.isfinite(root)):
            return Believed(observer, root, _loud(device, observer, each, seen))
    return None


def _loud(
    device: Device, observer: Observer, white: Sequence[Floats], seen: Sequence[Experiment]
) -> list[Floats]:
    """The loudness of the noise of recordings, with weighted innovations; also from before them."""
    before = [e.before for e in seen if e.before is not None]
    more = [_whitened(device, e, observer) for e in before]
    return loudness([*white, *more], [e.command for e in (*seen, *before)])[: len(seen)]


def drawn_x(final: Fitted, random: np.random.Generator) -> Floats:
    """Return parameters x (p,) drawn from the uncertainty of a fit."""
    root = _known(final)
    return final.model.within(final.x + root @ random.standard_normal(root.shape[1]))


def _known(final: Fitted) -> Floats:
    """Return a root (x, directions) of the covariance of x that the recordings determine.

    Directions that the recordings do not determine (a free gain together with all masses) change no
    motion. They are left out, since far along them the first order no longer holds.
    """
    slopes = final.jacobian[: final.samples]
    told, directions = np.linalg.eigh(slopes.T @ slopes)
    kept = told > TOLD
    return directions[:, kept] / np.sqrt(told[kept])


def _bootstrapped(
    final: Fitted,
    noise: Believed,
    judge_by: Sequence[Experiment],
    own: Sequence[Experiment],
    lengths: Sequence[int],
    spans: Sequence[Span],
    seed: int,
) -> Floats:
    """Return `_judged` (2, lengths) for a device drawn from the uncertainty of the fit.

    own: the recordings as the answer reads them. The drawn device's reading corrections (gain,
    origin) are removed, and the answer's applied.
    """
    random = np.random.default_rng(seed)
    model, observer = final.model, noise.observer
    answer = model.acting(final.x)
    x = drawn_x(final, random)
    played: list[Experiment] = []
    for i, (e, mine) in enumerate(zip(judge_by, own, strict=True)):
        theirs = model.seen(e, x)
        there = as_followed(theirs, mine)
        y = driven(model.acting(x), there, observer, noise.drawn(i, random))
        again = replace(mine, measured=y + (mine.measured - theirs.measured))
        played.append(followed_by(answer, again, observer))
    return np.stack(_judged(_runs(final, observer, played, lengths), spans))


def _better(
    final: Fitted,
    others: Sequence[tuple[Model, Floats]],
    observer: Observer,
    own: Sequence[Experiment],
    without: Sequence[Sequence[Experiment]],
) -> tuple[float, float]:
    """Share of squared error explained, and sigma gained, over the better of file and refit."""
    device = final.model.acting(final.x)
    ticks = max(window(e) for e in own)
    free = _squares(device, own, observer, ticks)
    step = _steps(device, own, observer)
    rest_free: list[Floats] = []
    rest_step: list[Floats] = []
    for (model, x), seen in zip(others, without, strict=True):
        rest_free.append(_squares(model.acting(x), seen, observer, ticks))
        rest_step.append(_steps(model.acting(x), seen, observer))
    best_free = min(rest_free, key=lambda s: float(s.sum()))
    best_step = min(rest_step, key=lambda s: float(s.sum()))
    total = float(best_free.sum())
    explained = 1.0 - float(free.sum()) / total if total > 0.0 else 0.0
    return explained, max(_sigma(best_free - free), compared(best_step - step).sigma)


class Fit(Protocol):
    """A model with its parameters, (p,)."""

    @property
    def model(self) -> Model:
        """The model."""
        ...

    @property
    def x(self) -> Floats:
        """Its parameters."""
        ...


def freer(
    new: tuple[Fit, Observer], old: tuple[Fit, Observer], experiments: Sequence[Experiment]
) -> bool:
    """Whether the free runs of one answer are better than another's.

    Each has its own observer. The horizon with the clearest difference decides, if this exceeds
    `apart` sigma. Stretches contain different amounts of information, so differences between a few
    of them mean little. If one errs at most half as much on average, the logarithms of the ratios
    decide too.
    """
    told: list[float] = []
    for _, a, b in each_length(new, old, experiments):
        told.append(clearly(b - a))
        if max(a.mean(), b.mean()) > 4.0 * min(a.mean(), b.mean()) > 0.0:
            told.append(clearly(log_ratios(b, a)))
    return max(told, key=abs, default=0.0) > ADEQUACY.apart


def oftener_freer(
    new: tuple[Fit, Observer], old: tuple[Fit, Observer], experiments: Sequence[Experiment]
) -> bool:
    """Whether free runs of one answer err less than another's more often than by chance.

    Wilcoxon's signed ranks of the ratios of their errors (Biometrics Bulletin 1, 1945) decide, at
    the clearest horizon, at level `often`. A law with a steep branch errs little in most runs and
    much in the few in which it takes the wrong side, so mean squares would show nothing.
    """
    each = list(each_length(new, old, experiments))
    ratios = [log_ratios(b, a) for _, a, b in each]
    odds = [wilcoxon(r, alternative="greater").pvalue for r in ratios if np.any(r)]
    return bool(min(odds, default=1.0) < ADEQUACY.often / max(1, len(each)))


def each_length(
    new: tuple[Fit, Observer], old: tuple[Fit, Observer], experiments: Sequence[Experiment]
) -> Iterator[tuple[int, Floats, Floats]]:
    """Yield each length [ticks], and the mean square errors (runs,) of both answers' free runs."""
    for ticks in _lengths(experiments):
        a, b = (
            _squares(
                f.model.acting(f.x), [_seen(f.model, f.x, e, o) for e in experiments], o, ticks
            )
            for f, o in (new, old)
        )
        yield ticks, a, b


def log_ratios(more: Floats, less: Floats) -> Floats:
    """Return log(more / less) of the mean square errors (runs,)."""
    return np.log(np.maximum(more, 1e-300)) - np.log(np.maximum(less, 1e-300))


def clearly(gains: Floats) -> float:
    """The mean's significance: the sigma of a normal that is as probable as its Student's t."""
    odds = float(student.logsf(abs(_sigma(gains)), max(1, gains.size - 1)))
    return math.copysign(float(norm.isf(max(math.exp(odds), 1e-300))), _sigma(gains))


def _step(judge_by: Sequence[Experiment]) -> float:
    """The encoder step of the first output; 0 if it is not a position or no step is visible."""
    if judge_by[0].outputs[0].quantity != "position":
        return 0.0
    return max(encoder_step_seen(e.measured[:, 0]) or 0.0 for e in judge_by)


def _squares(device: Any, seen: Sequence[Experiment], observer: Observer, ticks: int) -> Floats:
    """Mean square error of each free run."""
    errors = [free_run_errors(device, e, observer.gain, ticks)[0][:, 0] for e in seen]
    with np.errstate(all="ignore"):  # infinite after an overflow
        each = np.concatenate([(e**2).reshape(-1, ticks).mean(axis=1) for e in errors])
    return _bounded(each)


def _steps(device: Any, seen: Sequence[Experiment], observer: Observer) -> Floats:
    """-2 log likelihood by stretches, one step ahead, with the observer's noise."""
    with np.errstate(all="ignore"):
        each = np.sum(_weighed(device, seen, observer) ** 2, axis=1)
        parts = np.array_split(each, max(3, min(20, each.size // 50)))
        return _bounded(np.array([p.sum() for p in parts]))


def _bounded(squares: Floats) -> Floats:
    """Return squares limited to RAN_AWAY, also after an overflow, so that they can be squared."""
    return np.minimum(np.nan_to_num(squares, nan=RAN_AWAY, posinf=RAN_AWAY), RAN_AWAY)


def _weighed(device: Any, seen: Sequence[Experiment], observer: Observer) -> Floats:
    """Weighted innovations (samples, o) of the measurement, once settled."""
    return _known_rows([_whitened(device, e, observer) for e in seen], seen)


def _known_rows(white: Sequence[Floats], seen: Sequence[Experiment]) -> Floats:
    parts = [w[settling(e) :][e.known[settling(e) :]] for w, e in zip(white, seen, strict=True)]
    return np.concatenate(parts)


def _whitened(device: Any, e: Experiment, observer: Observer) -> Floats:
    """Weighted innovations (ticks, o), zero until the observer has settled."""
    white = observer.weigh(innovations(device, e, observer.gain), e.uncounted)
    white[: settling(e)] = 0.0
    return white


def _sigma(gains: Floats) -> float:
    """Mean over its standard error."""
    spread = float(gains.std(ddof=1)) if gains.size > 1 else 0.0
    if spread == 0.0:
        return 0.0
    return float(gains.mean()) / spread * math.sqrt(gains.size)

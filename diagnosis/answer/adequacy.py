"""Is the answer any good? What its own noise model foretells, beside what is seen on held-out data.

A hypothesis that costs least may still be wrong: it is the best of those that were tried. If it is
right, its free runs err on data that it was not fitted to as far as its noise and what is not known
of its parameters make them, and no farther. How far that is, is simulated (Gelman, Meng & Stern,
Statistica Sinica 6, 1996): parameters are drawn from what the fit knows of them, the device so
drawn is rehearsed under the same command with the noise that the observer stands for, and the
answer follows it in free runs as it follows the recording. With e the rms error over runs of one
length and e_i those of R rehearsals, the answer is adequate where for all lengths

    (ln e - m) / (s sqrt(1 + 1/R)) < t,    m, s: mean and deviation of ln e_i,

t the quantile of Student's t with R - 1 degrees of freedom that is exceeded with odds of ALPHA.

And it must be of use: its free runs, or its likelihood a step ahead, must be better than those of
the better one of device file and refit by more than the scatter of the blocks (`compared`). What is
not names nothing.

Limits: the noise is white force at m1 and white noise of what is measured, of the size that the
innovations have; noise of a strong slow colour makes free runs err more than that says.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from scipy.stats import t as student

from zwidth.diagnosis.experiment import Experiment
from zwidth.diagnosis.fit import Fitted
from zwidth.diagnosis.parameters import Model
from zwidth.diagnosis.predictor import (
    SETTLING,
    Observer,
    begun,
    deviation,
    free_run_errors,
    innovations,
)
from zwidth.diagnosis.rehearsal import Noise, RunsAway, noise_of, rehearse
from zwidth.diagnosis.selection.evidence import ALPHA, compared
from zwidth.diagnosis.steady import NoObserver

Floats = NDArray[np.float64]
HORIZONS = (0.05, 0.5, 2.0)  # s
SHORTEST = 5  # ticks of a free run
RUNS = 3  # free runs of a length at least, or nothing is said of it
REHEARSALS = 16
TOLD = 10.0  # information in a direction of x, of which a device file's own is one
SCATTER = 1.0  # sigma of blocks by which an answer must be better than doing without it


@dataclass(frozen=True)
class Ahead:
    """Free runs over a horizon [s]: rms error of the first output, and what is to be expected.

    All three in the output's unit; most: above it the answer is not adequate.
    """

    horizon: float
    error: float
    expected: float
    most: float

    @property
    def adequate(self) -> bool:
        """Whether the error is within what the answer itself foretells."""
        return self.error <= self.most


@dataclass(frozen=True)
class Adequacy:
    """What held-out data say of an answer.

    explained: share of the mean square error over half a second (of the better one of device file
    and refit) that the answer takes away. better: sigma by which it predicts better than these, in
    free runs or a step ahead, whichever is more. names: whether it has any effects.
    """

    ahead: tuple[Ahead, ...]
    explained: float
    better: float
    names: bool

    @property
    def sound(self) -> bool:
        """Whether free runs err no farther than noise and unknown parameters make them."""
        return all(a.adequate for a in self.ahead)

    @property
    def useful(self) -> bool:
        """Whether what it names is better than doing without, by more than blocks scatter."""
        return not self.names or self.better > SCATTER

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


def adequacy(
    nominal: Model, refit: Fitted, final: Fitted, observer: Observer, judge_by: Sequence[Experiment]
) -> Adequacy | None:
    """Judge an answer by recordings that it was not fitted to.

    nominal: the device file's model, without free values. Returns None where nothing can be said:
    recordings shorter than three free runs, or no noise follows from the observer.
    """
    model, x = final.model, final.x
    others = [(nominal, np.zeros(len(nominal.parameters))), (refit.model, refit.x)]
    own, *without = ([_seen(m, v, e, observer) for e in judge_by] for m, v in [(model, x), *others])
    noise = _noise(final, observer, own)
    if noise is None:
        return None
    ahead: list[Ahead] = []
    rehearsed = _rehearsed(final, noise, judge_by)
    device = model.acting(x)
    for horizon in HORIZONS:
        ticks = max(SHORTEST, round(horizon / judge_by[0].period))
        if not all(e.ticks > SETTLING + RUNS * ticks for e in judge_by) or len(rehearsed) < RUNS:
            continue
        error = _rms([free_run_errors(device, e, observer.gain, ticks)[0][:, 0] for e in own])
        foretold = np.array(
            [
                _rms([free_run_errors(device, e, observer.gain, ticks)[0][:, 0] for e in each])
                for each in rehearsed
            ]
        )
        foretold = foretold[np.isfinite(foretold)]
        if foretold.size < RUNS or not math.isfinite(error):
            continue
        logs = np.log(foretold)
        spread = float(logs.std(ddof=1)) * math.sqrt(1.0 + 1.0 / logs.size)
        most = math.exp(float(logs.mean()) + float(student.isf(ALPHA, logs.size - 1)) * spread)
        ahead.append(Ahead(horizon, error, math.exp(float(logs.mean())), most))
    if not ahead:
        return None
    explained, better = _better(final, others, observer, own, without)
    return Adequacy(tuple(ahead), explained, better, bool(final.model.effects))


def _seen(model: Model, x: Floats, e: Experiment, observer: Observer) -> Experiment:
    """A recording as a model sees it, begun where it fits best."""
    return begun(model.acting(x), model.seen(e, x), observer)


def _noise(final: Fitted, observer: Observer, seen: Sequence[Experiment]) -> Noise | None:
    device = final.model.acting(final.x)
    raw = Observer(observer.gain, deviation(device, seen, observer.gain), observer.ratio)
    try:
        return noise_of(device, seen[0], raw)
    except (NoObserver, ValueError):  # a noise of nothing, or of no bound
        return None


def _known(final: Fitted) -> Floats:
    """Return a root (x, directions) of the covariance of what the recordings tell of x.

    Directions that they do not tell (a free gain against all masses at once) change no motion, and
    are left out: far along them the first order no longer holds.
    """
    slopes = final.jacobian[: final.samples]
    told, directions = np.linalg.eigh(slopes.T @ slopes)
    kept = told > TOLD
    return directions[:, kept] / np.sqrt(told[kept])


def _rehearsed(
    final: Fitted, noise: Noise, judge_by: Sequence[Experiment]
) -> list[list[Experiment]]:
    """Recordings as devices would give them that the fit cannot tell from its own."""
    random = np.random.default_rng(1)
    root = _known(final)
    found: list[list[Experiment]] = []
    for i in range(REHEARSALS):
        x = final.model.within(final.x + root @ random.standard_normal(root.shape[1]))
        device = final.model.acting(x)
        try:
            found.append(
                [
                    rehearse(
                        device, final.model.seen(e, x).command, noise, outputs=e.outputs,
                        seed=REHEARSALS * j + i,
                    )
                    for j, e in enumerate(judge_by)
                ]
            )  # fmt: skip
        except (RunsAway, ArithmeticError):
            continue
    return found


def _better(
    final: Fitted,
    others: Sequence[tuple[Model, Floats]],
    observer: Observer,
    own: Sequence[Experiment],
    without: Sequence[Sequence[Experiment]],
) -> tuple[float, float]:
    """Share of the square error explained, and sigma over the better of device file and refit."""
    device = final.model.acting(final.x)
    ticks = max(SHORTEST, round(HORIZONS[1] / own[0].period))
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


def freer(
    new: tuple[Fitted, Observer], old: tuple[Fitted, Observer], experiments: Sequence[Experiment]
) -> bool:
    """Whether one answer runs free better than another.

    Each under its own observer; the horizon that tells most clearly decides, where its blocks would
    not scatter so far with odds of ALPHA.
    """
    told: list[float] = []
    for horizon in HORIZONS:
        ticks = max(SHORTEST, round(horizon / experiments[0].period))
        if not all(e.ticks > SETTLING + RUNS * ticks for e in experiments):
            continue
        a, b = (
            _squares(
                f.model.acting(f.x), [_seen(f.model, f.x, e, o) for e in experiments], o, ticks
            )
            for f, o in (new, old)
        )
        told.append(_sigma(b - a))
    return max(told, key=abs, default=0.0) > float(norm.isf(ALPHA))


def _squares(device: Any, seen: Sequence[Experiment], observer: Observer, ticks: int) -> Floats:
    """Mean square error of each free run."""
    errors = [free_run_errors(device, e, observer.gain, ticks)[0][:, 0] for e in seen]
    each = np.concatenate([(e**2).reshape(-1, ticks).mean(axis=1) for e in errors])
    return np.nan_to_num(each, nan=1e300, posinf=1e300)


def _steps(device: Any, seen: Sequence[Experiment], observer: Observer) -> Floats:
    """-2 log likelihood in stretches, a step ahead, under the observer's noise."""
    weighed = [observer.weigh(innovations(device, e, observer.gain))[SETTLING:] for e in seen]
    each = np.sum(np.concatenate(weighed) ** 2, axis=1)
    parts = np.array_split(each, max(3, min(20, each.size // 50)))
    return np.nan_to_num(np.array([p.sum() for p in parts]), nan=1e300, posinf=1e300)


def _sigma(gains: Floats) -> float:
    """Mean over its standard error."""
    spread = float(gains.std(ddof=1)) if gains.size > 1 else 0.0
    if spread == 0.0:
        return 0.0
    return float(gains.mean()) / spread * math.sqrt(gains.size)


def _rms(parts: Sequence[Floats]) -> float:
    joined = np.concatenate(parts)
    return float(np.sqrt(np.mean(joined**2))) if joined.size else float("nan")

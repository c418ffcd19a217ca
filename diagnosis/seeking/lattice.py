"""Quantisation steps and lost commands, sought without gradients: no gradient leads to them.

command_step: c = step round(u / step) is known for every step, so its signature is F (c - u), and
the periods of the missing force over u (`diagnosis.forces.spatial`) show which steps to try. The
best of N steps explains 2 ln N by chance, which is its penalty. If the command has fewer levels
than 2 ln N, some step explains any force. Rounding jumps where steps hardly differ, so the best one
beside some of the effects may be wrong beside all of them: it is then sought again.

encoder_step: y = x + s(x) + noise, s(x) = step round(x / step) - x. The observer predicts x only
within some spread, so the mean of s over that spread is subtracted,

    sum (-1)^n step / (pi n) exp(-2 (pi n spread / step)^2) sin(2 pi n x / step),

with the spread of least chi-square, which is fixed inside a fit.

dropped_samples: a command lost at tick k changes the force by d = u_(k-1) - u_k for one tick. Its
log likelihood ratio is L_k = -g_k d_k - d_k^2 n / 2 (g: `matched`, n: energy of the response to one
tick), and it counts as lost if L_k exceeds the odds against; the most likely comes first, and its
effect is then subtracted from g. For a lost command L_k is normal, with mean and half its variance
d_k^2 n / 2. A loss does not show if the command hardly changes, so the rate is the number of
detected losses over the sum of the probabilities to detect one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from zwidth.diagnosis.fitting.descend import fit
from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.forces.spatial import matched, peaks, pulls, response, step_peaks
from zwidth.diagnosis.mishaps import attempt
from zwidth.diagnosis.model.parameters import Model, delivered
from zwidth.diagnosis.noise.predictor import SETTLING, innovations
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.seeking.screen import Complement
from zwidth.sim.physics import make_physics

Floats = NDArray[np.float64]
PROMISING = 4.0  # chi-square by which a wave must exceed the highest of noise
AROUND = 41  # steps tried around a peak, up to two lines to either side
DELIVERED = 3.0  # log odds from which a command counts as lost
FINEST_SHARE = 1e-6  # of the span: the finest step that is sought
ROUNDS = 3
SPREAD = 0.15  # of a step: initial uncertainty of positions
FIRST_RATE = 1e-3  # initial rate of lost commands
MEMORY = 400  # ticks that a lost command is remembered
MOST_LOST = 0.1  # of the commands: if more seem lost, it is a delay
MOST_SEEN = 0.5  # the same as a share of the commands whose loss can be detected
SPREADS = (0.0, 0.03, 0.07, 0.12, 0.18, 0.25, 0.35)  # of a step


@dataclass(frozen=True)
class Stepped:
    """A trial of a step or of lost commands. gained: chi-square; price: penalty for its search."""

    label: str
    problem: Problem
    fitted: Fitted
    gained: float
    price: float


def stepped_trials(
    problem: Problem, fitted: Fitted, experiments: Sequence[Experiment]
) -> list[Stepped]:
    """Return the trials of steps and lost commands beside a fitted model."""
    tries = {
        "command_step@command": partial(command_step, problem, fitted),
        "encoder_step@sensor": partial(encoder_step, problem, fitted, experiments),
        "dropped_samples@clock": partial(dropped_samples, problem, fitted, experiments),
    }
    if fitted.model.nominal.interface.command_hold == "smooth":
        del tries[
            "dropped_samples@clock"
        ]  # a smooth command was measured as it acted, so none was lost
    tried = [attempt("candidates", label, one) for label, one in tries.items()]
    return [t for t in tried if t is not None]


def command_step(problem: Problem, fitted: Fitted) -> Stepped | None:
    """Try steps of the command, in place of one that was found before."""
    if fitted.model.nominal.interface.command_step > 0.0:
        return None
    fitted, before = _without(problem, fitted, "command_step")
    model, x = fitted.model, fitted.x
    over = [e.command for e in problem.experiments]
    span = max(float(np.ptp(u)) for u in over)
    levels = np.unique(np.concatenate(over)).size
    size = float(np.sqrt(np.mean(np.concatenate(over) ** 2)))
    found, lines = step_peaks(pulls(problem, fitted, "command"), over, 1e-3 * size, -1.0)
    moved = _Moved(fitted)

    def chi2(step: float) -> float:
        tried = model.with_effect(make_physics("command_step", "command", step=step), {})
        return moved.chi2(problem.weighted(tried, x))

    price = 2.0 * np.log(max(lines, 1))
    if price > levels:
        return None
    periods = [p.period for p in found if p.gained > price + PROMISING]
    best = _best([*periods, *before], span, chi2)
    if best is None or chi2(best) > moved.chi2(fitted.white):
        return None
    physics = make_physics("command_step", "command", step=best)
    again = fit(problem, model.with_effect(physics, {}), x)
    return Stepped("command_step@command", problem, again, fitted.chi2 - again.chi2, price)


def encoder_step(
    problem: Problem, fitted: Fitted, experiments: Sequence[Experiment]
) -> Stepped | None:
    """Try steps of the sensor, in place of one that was found before."""
    known = fitted.model.nominal.interface.encoder_step > 0.0
    if known or experiments[0].outputs[0].quantity != "position":
        return None
    fitted, before = _without(problem, fitted, "encoder_step")
    model, x = fitted.model, fitted.x
    positions = predicted(problem, fitted)
    span = max(float(np.ptp(q)) for q in positions)
    finest = max(float(problem.observer.deviation[0]), FINEST_SHARE * span)
    pull = pulls(problem, fitted, "sensor")
    # A slow observer tracks part of the steps, so their size in the residual is unknown.
    found, lines = peaks(pull, positions, finest)
    found += step_peaks(pull, positions, finest, 1.0, SPREAD)[0]
    physics = make_physics("encoder_step", "sensor", step=1.0)
    tried = replace(model.with_effect(physics, {}), sensor_error_known=True)
    loss = _StepLoss(problem, fitted, tried, experiments, positions)
    price = 2.0 * np.log(max(lines, 1))
    periods = [p.period for p in found if p.gained > price + PROMISING]
    best = _best([*periods, *before], span, lambda step: loss.chi2(step, SPREAD))
    if best is None or loss.chi2(best, SPREAD) > loss.moved.chi2(fitted.white):
        return None
    there = Problem(loss.in_steps(best, loss.spread(best)), problem.observer)
    again = fit(there, with_step(tried, "encoder_step", best), x)
    return Stepped("encoder_step@sensor", there, again, fitted.chi2 - again.chi2, price)


def _without(problem: Problem, fitted: Fitted, name: str) -> tuple[Fitted, list[float]]:
    """Return the fit without a step, and this step if there is one."""
    for i, p in enumerate(fitted.model.effects):
        if p.effect.name == name:
            return fit(problem, *fitted.model.less(fitted.x, i)), [p.values["step"]]
    return fitted, []


class _Moved:
    """Chi-square after a refit to first order, for changed innovations."""

    def __init__(self, fitted: Fitted) -> None:
        self.off, self.fitted = Complement(fitted.jacobian), fitted
        self.base = self.off(fitted.residual)
        self.prior = np.zeros(fitted.residual.size - fitted.samples)

    def chi2(self, white: Floats) -> float:
        """Return chi-square for weighted innovations (samples,)."""
        moved = np.concatenate([white - self.fitted.white, self.prior])
        return float(np.sum((self.base + self.off(moved)) ** 2))


def with_step(model: Model, name: str, step: float) -> Model:
    """Return the model with another step of an effect."""
    effects = tuple(
        replace(p, values={"step": step}) if p.effect.name == name else p for p in model.effects
    )
    return replace(model, effects=effects)


class _StepLoss:
    """Chi-square of an encoder's step at positions that an observer predicts."""

    def __init__(
        self,
        problem: Problem,
        fitted: Fitted,
        model: Model,
        experiments: Sequence[Experiment],
        positions: Sequence[Floats],
    ) -> None:
        self.moved, self.observer, self.x = _Moved(fitted), problem.observer, fitted.x
        self.model, self.experiments, self.positions = model, experiments, positions

    def in_steps(self, step: float, share: float) -> list[Experiment]:
        """Return recordings that contain the error of steps; share: the spread over the step."""
        return [
            replace(e, sensor_error=mean_error(q, step, share))
            for e, q in zip(self.experiments, self.positions, strict=True)
        ]

    def chi2(self, step: float, share: float) -> float:
        """Return chi-square after a refit to first order."""
        there = Problem(self.in_steps(step, share), self.observer)
        return self.moved.chi2(there.weighted(self.model, self.x))

    def spread(self, step: float) -> float:
        """Return the spread over the step with the least chi-square."""
        return min(SPREADS, key=lambda share: self.chi2(step, share))


def mean_error(position: Floats, step: float, share: float) -> Floats:
    """Return the mean effect of steps at positions known within a spread of share x step."""
    if share == 0.0:
        return step * np.round(position / step) - position
    total = np.zeros_like(position)
    for n in range(1, 40):
        weight = np.exp(-2.0 * (np.pi * n * share) ** 2) * (-1.0) ** n / (np.pi * n)
        if abs(weight) < 1e-4:
            break
        total += weight * np.sin(2.0 * np.pi * n * position / step)
    return step * total


def step_interval(problem: Problem, fitted: Fitted, name: str, wide: float) -> float:
    """Return half the 95 % interval of a step, within which chi-square rises by at most 3.84."""
    step = next(p.values["step"] for p in fitted.model.effects if p.effect.name == name)
    moved = _Moved(fitted)
    positions = predicted(problem, fitted) if name == "encoder_step" else []
    loss = _StepLoss(problem, fitted, fitted.model, problem.experiments, positions)
    share = loss.spread(step) if name == "encoder_step" else 0.0

    def chi2(value: float) -> float:
        if name == "encoder_step":
            return loss.chi2(value, share)
        return moved.chi2(problem.weighted(with_step(fitted.model, name, value), fitted.x))

    own = chi2(step)
    for part in np.geomspace(1e-8, 0.3, 80):
        if min(chi2(step * (1.0 - part)), chi2(step * (1.0 + part))) > own + 3.84 * wide:
            return float(part) * step
    return 0.3 * step


def predicted(problem: Problem, fitted: Fitted) -> list[Floats]:
    """Return the first output (ticks,) that the observer predicts in every recording."""
    device = fitted.model.acting(fitted.x)
    found: list[Floats] = []
    for e in problem.experiments:
        seen = fitted.model.seen(e, fitted.x)
        error = innovations(device, seen, problem.observer.gain)
        found.append(seen.measured[:, 0] - error[:, 0])
    return found


def _best(periods: list[float], span: float, chi2: Callable[[float], float]) -> float | None:
    """The step of least chi-square near periods, each tried over the width of its line, or None."""
    best: tuple[float, float] | None = None
    for period in periods:
        lines = 1.0 / period + np.linspace(-1.0, 1.0, AROUND) / span
        tried = [(chi2(1.0 / line), 1.0 / line) for line in lines if line > 0.5 / span]
        found = min(tried)
        width = 2.0 / (AROUND - 1) / span
        fine = 1.0 / found[1] + np.linspace(-1.0, 1.0, AROUND // 2) * width
        found = min([found, *((chi2(1.0 / line), 1.0 / line) for line in fine)])
        if best is None or found < best:
            best = found
    return None if best is None else best[1]


def dropped_samples(
    problem: Problem, fitted: Fitted, experiments: Sequence[Experiment]
) -> Stepped | None:
    """Try lost commands, event by event."""
    model = fitted.model
    if model.has("dropped_samples"):
        return None
    echo = _echo(problem, fitted)
    dropped = [np.zeros(e.ticks, dtype=np.bool_) for e in experiments]
    current, there, rate, lost = fitted, problem, FIRST_RATE, 0
    ticks = sum(e.ticks for e in experiments)
    for _ in range(ROUNDS):
        pull = matched(there, current, "command")
        for e, g, d in zip(experiments, pull, dropped, strict=True):
            _pursue(e.command, g, d, echo, float(np.log(rate / (1.0 - rate))))
        found = sum(int(d.sum()) for d in dropped)
        if found == lost or found > MOST_LOST * ticks:
            break
        seen = max(_visible(experiments, float(echo[0]), rate), found / MOST_SEEN)
        lost, rate = found, found / seen
        seen = [replace(e, dropped=d.copy()) for e, d in zip(experiments, dropped, strict=True)]
        there = Problem(seen, problem.observer)
        physics = make_physics("dropped_samples", "clock", rate=rate)
        current = fit(there, model.with_effect(physics, {}), fitted.x)
    if lost == 0 or lost > MOST_LOST * ticks or rate >= MOST_SEEN:
        return None
    # The lost ones were chosen among all commands: each costs its odds.
    price = 2.0 * lost * float(np.log((1.0 - rate) / rate))
    return Stepped("dropped_samples@clock", there, current, fitted.chi2 - current.chi2, price)


def with_rate(problem: Problem, fitted: Fitted) -> Fitted:
    """Return a fit with the rate of lost commands for its own noise, not that of a poorer model."""
    names = [p.effect.name for p in fitted.model.effects]
    lost = sum(int(e.dropped.sum()) for e in problem.experiments if e.dropped is not None)
    if lost == 0 or "dropped_samples" not in names:
        return fitted
    place = names.index("dropped_samples")
    effects = list(fitted.model.effects)
    rate = effects[place].values["rate"]
    for _ in range(ROUNDS):
        rate = lost / max(chances_seen(problem, fitted, rate), lost / MOST_SEEN)
    effects[place] = replace(effects[place], values={"rate": rate})
    return replace(fitted, model=replace(fitted.model, effects=tuple(effects)))


def losses(problem: Problem, fitted: Fitted) -> list[NDArray[np.bool_]]:
    """Return which commands (ticks,) of each recording were lost, at the rate of a model."""
    echo = _echo(problem, fitted)
    lost = [np.zeros(e.ticks, dtype=np.bool_) for e in problem.experiments]
    rates = [p.values["rate"] for p in fitted.model.effects if p.effect.name == "dropped_samples"]
    if not rates:
        return lost
    odds = float(np.log(rates[0] / (1.0 - rates[0])))
    for e, g, d in zip(problem.experiments, matched(problem, fitted, "command"), lost, strict=True):
        _pursue(e.command, g, d, echo, odds)
    return lost


def chances_seen(problem: Problem, fitted: Fitted, rate: float) -> float:
    """Return the sum of the probabilities that the loss of each command would show."""
    return _visible(problem.experiments, float(_echo(problem, fitted)[0]), rate)


def _echo(problem: Problem, fitted: Fitted) -> Floats:
    """Correlation of the response to one tick of force with itself, at lags from 0."""
    answer = response(problem, fitted, "command")[:MEMORY]
    columns = [np.correlate(a, a, "full") for a in answer.T]
    return np.asarray(np.sum(columns, axis=0)[answer.shape[0] - 1 :], dtype=np.float64)


def _visible(experiments: Sequence[Experiment], energy: float, rate: float) -> float:
    """Sum of the probabilities that a lost command exceeds the threshold of `_pursue`."""
    least = DELIVERED - float(np.log(rate / (1.0 - rate)))
    seen = 0.0
    for e in experiments:
        size = np.abs(np.diff(e.command))[SETTLING - 1 :] * np.sqrt(energy)
        size = size[size > 0.0]
        seen += float(np.sum(norm.cdf((0.5 * size**2 - least) / size)))
    return seen


def _pursue(command: Floats, g: Floats, lost: NDArray[np.bool_], echo: Floats, odds: float) -> None:
    """Mark lost commands in `lost`, the most likely first, and subtract their effects from g.

    Neighbours of a lost command look lost too, until its effect is subtracted.
    """
    g = g.copy()
    while int(lost.sum()) <= MOST_LOST * command.size:
        change = np.concatenate([[0.0], delivered(command, lost)[:-1] - command[1:]])
        ratio = np.where(lost, -np.inf, -g * change - 0.5 * change**2 * echo[0])
        ratio[:SETTLING] = -np.inf
        k = int(np.argmax(ratio))
        if ratio[k] + odds < DELIVERED:
            return
        lost[k] = True
        low, high = max(0, k - echo.size + 1), min(g.size, k + echo.size)
        g[low:high] += change[k] * echo[np.abs(np.arange(low, high) - k)]

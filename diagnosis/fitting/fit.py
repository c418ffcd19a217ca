"""Fit a model to experiments by simulation: weighted innovations and priors by trust region.

chi2(x) = sum ((e_k(x) / s)^2) + sum of prior x^2, gain of the observer and deviations s fixed.
Differences use absolute steps in x, which is of order one, so a parameter that starts at
zero moves. All perturbed runs of a Jacobian are independent and go over all cores.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from zwidth.diagnosis.fitting.many import Many
from zwidth.diagnosis.model.parameters import Model, is_read
from zwidth.diagnosis.noise.predictor import (
    SEARCHING,
    SETTLING,
    Fineness,
    Observer,
    enough,
    innovations,
    prepared_each,
)
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.sim.device import place_label

Floats = NDArray[np.float64]
STEP = 1e-4
WORST = 1e6  # weighted innovation that stands for an overflow
NOTHING = 0.05  # chi-square that is not worth another round
FORETOLD = 0.3  # of a step's gain: as near must the slopes foretell it to serve once more
LITTLE = 0.5  # chi-square, about which no slopes are asked anew
CLOSE = 0.03  # in x, by which slopes hardly change


@dataclass(frozen=True)
class Fitted:
    """A model at its best x. residual: weighted innovations and priors; jacobian of it by x."""

    model: Model
    x: Floats
    chi2: float
    residual: Floats
    jacobian: Floats
    samples: int

    @property
    def white(self) -> Floats:
        """The weighted innovations alone."""
        return self.residual[: self.samples]


class Slopes:
    """Values of a fit, and slopes computed anew only where they foretold the last step badly.

    Where they foretold it, they are corrected by what was seen along the step d alone (Broyden,
    Math. Comp. 19, 1965): J + (r - r_0 - J d) d' / d'd.
    """

    def __init__(
        self, residual: Callable[[Floats], Floats], slopes: Callable[[Floats, Floats], Floats]
    ) -> None:
        self.residual, self.slopes = residual, slopes
        self.tried: tuple[Floats, Floats] | None = None  # x, and the residual there
        self.at: tuple[Floats, Floats, Floats] | None = None  # the same where the slopes hold
        self.computed = np.zeros(0)  # x where they were computed

    def value(self, x: Floats) -> Floats:
        """Return the residual at x."""
        if self.tried is None or not np.array_equal(x, self.tried[0]):
            self.tried = x.copy(), self.residual(x)
        return self.tried[1]

    def slope(self, x: Floats) -> Floats:
        """Return the slopes at x, where the residual was asked for last."""
        found = self.value(x)
        kept = None if self.at is None else self.corrected(x, found)
        if kept is None:
            kept, self.computed = self.slopes(x, found), x.copy()
        self.at = x.copy(), found, kept
        return kept

    def corrected(self, x: Floats, found: Floats) -> Floats | None:
        """Return the slopes at x corrected by the step there, None where they foretold it badly."""
        assert self.at is not None
        before, earlier, slopes = self.at
        d = x - before
        way = float(d @ d)
        if way == 0.0:
            return slopes
        foretold = earlier + slopes @ d
        was = float(earlier @ earlier)
        gain, promised = was - float(found @ found), was - float(foretold @ foretold)
        if abs(gain - promised) > FORETOLD * abs(promised) + LITTLE:
            return None
        return slopes + np.outer(found - foretold, d / way)

    def holds(self, x: Floats) -> bool:
        """Whether the slopes were computed close to x."""
        return float(np.abs(x - self.computed).max(initial=0.0)) < CLOSE

    def forget(self) -> None:
        """Have the slopes computed anew."""
        self.at = None


def _bounded(values: Floats) -> Floats:
    """What overflowed, at the worst there is."""
    return np.clip(np.nan_to_num(values, nan=WORST, posinf=WORST, neginf=-WORST), -WORST, WORST)


def _enough(model: Model, x: Floats, experiments: Sequence[Experiment]) -> int:
    with suppress(NoObserver):  # all is `WORST` there
        device = model.acting(x)
        seen = [model.seen(e, x) if e.shares else e for e in experiments]
        changed = {id(e.changes): e.on(device) for e in seen}
        return max(enough(own) for own in changed.values())
    return 1


class Problem:
    """Experiments under one observer, predicted with so many substeps."""

    def __init__(
        self,
        experiments: Sequence[Experiment],
        observer: Observer,
        fineness: Fineness = SEARCHING,
    ) -> None:
        self.experiments, self.observer, self.fineness = list(experiments), observer, fineness
        self._without: dict[tuple[str, str, bytes], Fitted] = {}

    def weighted(self, model: Model, x: Floats, least: int = 1) -> Floats:
        """Return the weighted innovations of all experiments, one after the other.

        All `WORST` where the model runs away, or moves too fast to be followed. least: as
        `prepared` takes it.
        """
        device, seen = model.acting(x), [model.seen(e, x) for e in self.experiments]
        try:
            ready = prepared_each(device, seen, self.fineness, least)
        except NoObserver:
            return np.full(self.samples, WORST)
        parts: list[Floats] = []
        for e, own in zip(seen, ready, strict=True):
            out = innovations(device, e, self.observer.gain, ready=own)
            parts.append(self.observer.weigh(out, e.uncounted)[SETTLING:].ravel())
        return _bounded(np.concatenate(parts))

    def weighted_each(self, model: Model, xs: Sequence[Floats], least: int = 1) -> list[Floats]:
        """Return `weighted` at several x, run side by side."""
        many = Many(model, xs, self.fineness, least)
        parts: list[Floats] = []
        for e in self.experiments:
            found = self.observer.weigh(many.innovations(e, self.observer.gain), e.uncounted)
            parts.append(_bounded(found[:, SETTLING:].reshape(len(xs), -1)))
        return list(np.concatenate(parts, axis=1))

    @property
    def samples(self) -> int:
        """Number of weighted innovations, with those of bridged samples, which are zero."""
        return sum((e.ticks - SETTLING) * len(e.outputs) for e in self.experiments)

    def residual(self, model: Model, x: Floats, least: int = 1) -> Floats:
        """Return weighted innovations, then the priors. least: as `prepared` takes it."""
        prior = np.array([xi for p, xi in zip(model.parameters, x, strict=True) if p.prior])
        return np.concatenate([self.weighted(model, x, least), prior])

    def cost(self, fitted: Fitted) -> float:
        """Return -2 log likelihood of the innovations, deviations concentrated out, and priors."""
        prior = fitted.residual[fitted.samples :]
        return self.observer.cost(fitted.white) + float(prior @ prior)

    def at(self, model: Model, x: Floats) -> Fitted:
        """Return a model as it stands at x, not fitted."""
        residual = self.residual(model, x)
        samples = residual.size - sum(p.prior for p in model.parameters)
        slopes = self.jacobian(model, x, residual)
        return Fitted(model, x, float(residual @ residual), residual, slopes, samples)

    def jacobian(self, model: Model, x: Floats, at: Floats | None = None) -> Floats:
        """Return differences of the residual by x, inwards at a bound.

        All runs take the substeps that the model needs at x: friction errs by its substeps, and two
        runs that differ in them would show a slope of that error over so small a step.
        """
        base = self.residual(model, x) if at is None else at
        steps = [
            STEP if xi + STEP <= p.upper else -STEP
            for p, xi in zip(model.parameters, x, strict=True)
        ]
        parameters = model.parameters
        priors = [i for i, p in enumerate(parameters) if p.prior]
        samples = base.size - len(priors)
        least = _enough(model, x, self.experiments)

        asked = [i for i, p in enumerate(parameters) if is_read(p, self.experiments)]
        moved = [x + steps[i] * np.eye(1, x.size, i)[0] for i in asked]
        slopes = np.zeros((base.size, x.size))
        for i, found in zip(asked, self.weighted_each(model, moved, least), strict=True):
            slopes[:samples, i] = (found - base[:samples]) / steps[i]
        for row, i in enumerate(priors):
            slopes[samples + row, i] = 1.0
        return slopes

    def fit(
        self,
        model: Model,
        x: Floats | None = None,
        rounds: int = 12,
        final: bool = True,
    ) -> Fitted:
        """Return the best fit from a start (None: where all x are zero).

        final: False leaves the last slopes as the steps corrected them, where nobody asks for them.
        """
        parameters = model.parameters
        lower = np.array([p.lower for p in parameters])
        upper = np.array([p.upper for p in parameters])
        least = max(1e-8, NOTHING / (1 + sum(e.measured.size for e in self.experiments)))
        best = Slopes(lambda x: self.residual(model, x), lambda x, at: self.jacobian(model, x, at))
        start = np.zeros(len(parameters)) if x is None else x
        while True:
            start = model.within(start)
            found = least_squares(
                best.value,
                start,
                best.slope,  # pyright: ignore[reportArgumentType]
                bounds=(lower, upper), method="trf", x_scale=1.0,
                ftol=least, xtol=1e-5, gtol=1e-10, max_nfev=rounds,
            )  # fmt: skip
            rounds -= found.nfev
            if not final or best.holds(found.x) or rounds < 1:
                break
            start = found.x
            best.forget()
        if final and not best.holds(found.x):
            best.forget()
        slopes = best.slope(found.x)
        samples = found.fun.size - sum(p.prior for p in parameters)
        return Fitted(model, found.x, float(found.fun @ found.fun), found.fun, slopes, samples)

    def fit_without(self, fitted: Fitted, index: int) -> Fitted:
        """Fit a model again without one of its effects; asked twice, the answer is from memory."""
        gone = place_label(fitted.model.effects[index])
        key = (gone, fitted.model.label, fitted.x.tobytes())
        if key not in self._without:
            self._without[key] = self.fit(*fitted.model.less(fitted.x, index))
        return self._without[key]

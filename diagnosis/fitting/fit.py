"""Fits a model to recordings under one fixed observer.

chi2(x) = sum ((e_k(x) / s)^2) + sum of prior x^2, with fixed gain of the observer and fixed
deviations s. `fitting.descend` minimises it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.many import Many
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.predictor import SEARCHING, SETTLING, Fineness, Observer
from zwidth.diagnosis.recording.experiment import Experiment

Floats = NDArray[np.float64]
WORST = 1e6  # weighted innovation in place of an overflow


@dataclass(frozen=True)
class Fitted:
    """A model at its best x. residual: weighted innovations, then priors; jacobian: of it by x."""

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


def _bounded(values: Floats) -> Floats:
    """Replace overflows by the worst value."""
    return np.clip(np.nan_to_num(values, nan=WORST, posinf=WORST, neginf=-WORST), -WORST, WORST)


class Problem:
    """Experiments with one observer, predicted with a given number of substeps."""

    def __init__(
        self,
        experiments: Sequence[Experiment],
        observer: Observer,
        fineness: Fineness = SEARCHING,
    ) -> None:
        self.experiments, self.observer, self.fineness = list(experiments), observer, fineness

    def weighted(self, model: Model, x: Floats) -> Floats:
        """Return the weighted innovations of all experiments, `WORST` if the model cannot run."""
        return self.weighted_each(model, [x])[0]

    def weighted_each(self, model: Model, xs: Sequence[Floats]) -> list[Floats]:
        """Return `weighted` at several x, computed side by side."""
        many = Many(model, xs, self.fineness)
        parts: list[Floats] = []
        for e in self.experiments:
            found = self.observer.weigh(many.innovations(e, self.observer.gain), e.uncounted)
            parts.append(_bounded(found[:, SETTLING:].reshape(len(xs), -1)))
        return list(np.concatenate(parts, axis=1))

    @property
    def samples(self) -> int:
        """Number of weighted innovations, including those of bridged samples, which are zero."""
        return sum((e.ticks - SETTLING) * len(e.outputs) for e in self.experiments)

    def residual(self, model: Model, x: Floats) -> Floats:
        """Return weighted innovations, then the priors."""
        prior = np.array([xi for p, xi in zip(model.parameters, x, strict=True) if p.prior])
        return np.concatenate([self.weighted(model, x), prior])

    def cost(self, fitted: Fitted) -> float:
        """Return -2 log likelihood of the innovations, at their own deviations, plus the priors."""
        prior = fitted.residual[fitted.samples :]
        return self.observer.cost(fitted.white) + float(prior @ prior)

"""The cost of a model at many parameter vectors x, under one observer, in one call.

    cost(x) = n ln det S_0 + n ln det S(x) + sum of prior x^2,    S(x) = sum w w' / n,

where w are the weighted innovations of all recordings, and the weighting divides by S_0. This is -2
log likelihood, minimised over the covariance of the innovations (`Observer.cost`). The kernel sums
w w' while it runs, so that no array of the length of a recording is kept.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.fit import Problem
from zwidth.diagnosis.fitting.many import Many
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.predictor import SCREENING, SETTLING, Fineness, Observer
from zwidth.diagnosis.recording.experiment import Experiment

Floats = NDArray[np.float64]


class Landscape:
    """A model's cost over x; asked: number of predictions of all recordings."""

    def __init__(
        self,
        experiments: Sequence[Experiment],
        observer: Observer,
        model: Model,
        fineness: Fineness = SCREENING,
    ) -> None:
        self.problem = Problem(experiments, observer, fineness)
        self.model, self.asked = model, 0
        self.priors = np.array([p.prior for p in model.parameters])

    def costs(self, xs: Sequence[Floats]) -> Floats:
        """Return the cost at each x, infinite if the model runs away."""
        self.asked += len(xs)
        observer = self.problem.observer
        many = Many(self.model, xs, self.problem.fineness)
        o = observer.deviation.size
        moments, counted = np.zeros((len(xs), o, o)), 0
        for e in self.problem.experiments:
            moments += many.moments(e, observer.gain, observer.filters(), SETTLING)
            counted += e.ticks - SETTLING
        found = np.full(len(xs), np.inf)
        finite = np.isfinite(moments).all(axis=(1, 2))
        found[finite] = observer.cost_of(moments[finite], counted)
        return found + np.sum(np.stack(xs)[:, self.priors] ** 2, axis=1)

    def residuals(self, xs: Sequence[Floats]) -> list[Floats]:
        """Return weighted innovations, then priors, at each x."""
        self.asked += len(xs)
        weighed = self.problem.weighted_each(self.model, xs)
        return [np.concatenate([w, x[self.priors]]) for w, x in zip(weighed, xs, strict=True)]

    def cost(self, residual: Floats) -> float:
        """Return the cost of one of `residuals`."""
        samples = residual.size - int(np.count_nonzero(self.priors))
        prior = residual[samples:]
        return self.problem.observer.cost(residual[:samples]) + float(prior @ prior)

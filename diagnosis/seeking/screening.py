"""Screens the candidates of a model: views of its residual, and scores of all starts (`screen`).

Scores depend on the horizon. One sample ahead, after whitening, an effect near the limit of
detection shows by its exact shape. A strong effect has distorted the parameters and the noise model
and does not show there, but it does over a long horizon (an observer that trusts the model). So a
hypothesis has several views: with its own noise, and with slow observers at its own parameters and
at those of the device file, in case the refit is wrong.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.account import reason
from zwidth.diagnosis.fitting.descend import CREASED, SMOOTH, creased, slopes_at
from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.fitting.landscape import Landscape
from zwidth.diagnosis.mishaps import isolated
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.predictor import SCREENING
from zwidth.diagnosis.seeking.candidates import Start
from zwidth.diagnosis.seeking.modes import mode_starts
from zwidth.diagnosis.seeking.screen import Complement, Screened, second_looks
from zwidth.diagnosis.seeking.waves import wave_starts
from zwidth.jobs.parallel import in_parallel, threads

Floats = NDArray[np.float64]
OVERFLOWED = 1e5  # weighted innovation of a start that runs away
WORTH_A_LOOK = 10.0  # first-order gain that justifies trying another strength or phase


@dataclass(frozen=True)
class View:
    """A model at x with one observer, residual and slopes. own: with noise near the model's own."""

    problem: Problem
    model: Model
    x: Floats
    residual: Floats
    slopes: Floats
    own: bool

    @property
    def samples(self) -> int:
        """Number of weighted innovations in the residual."""
        return self.residual.size - sum(p.prior for p in self.model.parameters)

    @property
    def fitted(self) -> Fitted:
        """The view as a fit."""
        chi2 = float(self.residual @ self.residual)
        return Fitted(self.model, self.x, chi2, self.residual, self.slopes, self.samples)


def view(problem: Problem, model: Model, x: Floats, own: bool) -> View:
    """Return a view of a model at x."""
    ground = Landscape(problem.experiments, problem.observer, model, SCREENING)
    bent = creased(model)
    at = slopes_at(ground, x, np.full(x.size, CREASED if bent else SMOOTH), bent)
    return View(problem, model, x, at.residual, at.slopes, own)


def screened(seen: View, starts: Mapping[str, Sequence[Start]]) -> list[Screened]:
    """Return the best start of each label, the highest score first.

    Scores are in units of the residual's own variance per sample.
    """
    if not np.all(np.isfinite(seen.slopes)):
        return []
    off = Complement(seen.slopes)
    base = off(seen.residual)
    unit = max(float(seen.residual @ seen.residual) / seen.residual.size, 1e-300)

    def best(label: str, group: Sequence[Start]) -> Screened | None:
        with isolated("candidates", label):
            scored = _scored(seen, off, base, group)
            # An effect near the limit is far below the least start, which shows its strength.
            more = second_looks(scored, base, WORTH_A_LOOK)
            scored += _scored(seen, off, base, more) if more else []
            return max(scored, key=lambda one: one.score, default=None)
        return None

    tasks = [partial(best, label, group) for label, group in starts.items()]
    found = [one for one in in_parallel(tasks, threads()) if one is not None]
    found = [replace(one, score=one.score / unit) for one in found]
    return sorted(found, key=lambda one: one.score, reverse=True)


def _scored(seen: View, off: Complement, base: Floats, starts: Sequence[Start]) -> list[Screened]:
    """Score starts of one effect at one place, all in one call."""
    first = starts[0].physics
    names = [p.name for p in first.effect.parameters]
    model = seen.model.with_effect(first, dict.fromkeys(names, 1.0))
    own = [p.name for p in model.parameters[seen.model.lasting + len(names) : model.lasting]]
    beyond = [
        [*(s.physics.values[k] - first.values[k] for k in names),
         *s.beyond(own, dict.fromkeys(names, 1.0))]
        for s in starts
    ]  # fmt: skip
    asked = [seen.model.beside(seen.x, extra) for extra in beyond]
    ground = Problem(seen.problem.experiments, seen.problem.observer, SCREENING)
    energy, samples = float(base @ base), seen.samples
    none = np.zeros(seen.residual.size - samples)
    found: list[Screened] = []
    with reason("screening"):
        each = ground.weighted_each(model, asked)
    for start, weighed in zip(starts, each, strict=True):
        if not np.all(np.abs(weighed) < OVERFLOWED):
            continue
        whole = np.concatenate([weighed - seen.residual[:samples], none])
        signature = off(whole)
        after = base + signature
        gain = energy - float(after @ after)
        found.append(Screened(start, gain, signature, off.absorbing(whole)))
    return found


def shown_starts(seen: View) -> list[Start]:
    """Return starts at periods over position and at resonances that the residual shows."""
    found: list[Start] = []
    with isolated("candidates", "what repeats with position"):
        found += wave_starts(seen.problem, seen.fitted)
    with isolated("candidates", "a further mass"):
        found += mode_starts(seen.problem, seen.fitted)
    return found

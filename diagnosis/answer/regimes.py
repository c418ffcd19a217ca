"""Checks whether the model holds in every regime of the motion.

The last third of a recording mostly repeats the rest, and tests little: at one level friction is a
smaller command, in one direction it is a constant force. So each finding is also tested on motion
of another kind: a regime is left out (a recording, a level of the command, a direction, half of the
travel), and a fit to the rest must predict it.

Let r be the weighted innovations and priors at the best x, and J their slopes. A fit to the rest q,
without the samples of a regime s, differs by one Gauss-Newton step

    dx = -(J_q' J_q)^-1 J_q' r_q,    so that    u = r_s + J_s dx

is the error in the regime if it had no part in the fit. dx scatters: of a true model u has the
covariance C = 1 + J_s (J_q' J_q)^-1 J_s', which is large where the rest tells little. Its cost, -2
log of the density that the rest predicts, is

    u' C^-1 u + log det C,    C^-1 u = u - J_s (J' J)^-1 J_s' u,    det C = det J'J / det J_q'J_q.

An effect holds in a regime unless a model without it, treated the same way, is believed over it
there (`selection.evidence`).

Limits: only one step is made. So a regime that alone determines a parameter (such as the level of
friction in one direction) is skipped; J_q'J_q is then nearly singular relative to J'J.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from zwidth.diagnosis.answer.result import Held
from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.evidence import ALPHA, compared
from zwidth.diagnosis.selection.hypothesis import Hypothesis
from zwidth.diagnosis.settings import EVIDENCE

Floats = NDArray[np.float64]
Where = NDArray[np.bool_]
LEVELS = 1.5  # command of the loud half over the quiet half, above which levels differ
LEAST = 0.15  # least share of the samples in a regime
TOLD = 0.05  # least share of the information in a direction of x that remains without the regime


@dataclass(frozen=True)
class Regime:
    """A part of the recordings. where: (settled ticks,); other: words for the remainder."""

    name: str
    other: str
    where: Where


def regimes(experiments: Sequence[Experiment]) -> list[Regime]:
    """Return the regimes of recordings: those with enough samples inside and outside."""
    found = list(_all_regimes(experiments))
    return [r for r in found if LEAST < float(r.where.mean()) < 1.0 - LEAST]


def _all_regimes(experiments: Sequence[Experiment]) -> Iterator[Regime]:
    parts = [e.ticks - SETTLING for e in experiments]
    if len(experiments) > 1:
        for i, e in enumerate(experiments):
            where = np.concatenate([np.full(n, k == i) for k, n in enumerate(parts)])
            name = e.name or f"recording {i + 1}"
            yield Regime(f"in {name}", "in the other recordings", where)
    size = np.concatenate([_size(e)[SETTLING:] for e in experiments])
    middle = float(np.median(size))
    loud, quiet = size[size > middle], size[size <= middle]
    if loud.size and quiet.size and loud.mean() > LEVELS * quiet.mean():
        yield Regime("at high commands", "at low commands", size > middle)
        yield Regime("at low commands", "at high commands", size <= middle)
    speed = np.concatenate([_speed(e)[SETTLING:] for e in experiments])
    yield Regime("forwards", "backwards", speed > 0.0)
    yield Regime("backwards", "forwards", speed < 0.0)
    if all(e.outputs[0].quantity == "position" for e in experiments):
        place = np.concatenate([e.measured[SETTLING:, 0] for e in experiments])
        middle = float(np.median(place))
        yield Regime("in the upper half of the travel", "in the lower half", place > middle)
        yield Regime("in the lower half of the travel", "in the upper half", place <= middle)


def _size(e: Experiment) -> Floats:
    """Root mean square of the command over a stretch, (ticks,)."""
    width = max(1, round(0.25 / e.period))  # levels are means over 0.25 s
    return np.sqrt(np.convolve(e.command**2, np.full(width, 1.0 / width), mode="same"))


def _speed(e: Experiment) -> Floats:
    """Velocity of the first output, (ticks,), differenced over a few samples if need be."""
    y = e.measured[:, 0]
    if e.outputs[0].quantity != "position":
        return y
    width = max(2, round(0.01 / e.period))
    kernel = np.ones(width) / width
    return np.gradient(np.convolve(y, kernel, mode="same"))


def held(new: Hypothesis, old: Hypothesis) -> list[Held]:
    """Compare fitted hypotheses in each regime that does not alone determine a parameter."""
    found: list[Held] = []
    for regime in regimes(new.experiments):
        own, less = (_left_out(h, regime.where) for h in (new, old))
        if own is None or less is None:
            continue
        blocks = EVIDENCE.blocks // 2  # a regime is about half of a recording
        apart = np.sum((own.errors - less.errors) * (own.weighed - less.weighed), axis=1)
        gains, foretold = (
            np.array([part.sum() for part in np.array_split(each, blocks)])
            for each in (less.costs - own.costs, apart)
        )
        told = compared(gains, foretold)
        fails = -told.gain > 2.0 * told.phi * np.log(1.0 / ALPHA)
        found.append(Held(regime.name, regime.other, told.sigma, bool(fails)))
    return found


class Foretold(NamedTuple):
    """A regime as a fit to the rest predicts it: costs (ticks,), u and C^-1 u (ticks, o)."""

    costs: Floats
    errors: Floats
    weighed: Floats


def _left_out(h: Hypothesis, where: Where) -> Foretold | None:
    """The regime as a fit to the rest predicts it, None if that is undetermined."""
    if h.slopes is None:
        return None
    o = h.noise.observer.deviation.size
    samples = h.samples
    rows, slopes = h.residual[:samples].reshape(-1, o), h.slopes[:samples]
    if rows.shape[0] != where.size:
        return None
    covariance = rows.T @ rows / rows.shape[0]
    counts = h.noise.observer.counts
    root = np.linalg.inv(np.linalg.cholesky(covariance / counts))
    rows = rows @ root.T
    slopes = np.einsum("pq,kqx->kpx", root, slopes.reshape(-1, o, h.x.size))
    prior = h.residual[samples:], h.slopes[samples:]
    found = foretold_by_rest(rows, slopes, prior, where)
    divided = float(h.noise.observer.cost_of(covariance[None], 1)[0])
    return None if found is None else found._replace(costs=found.costs + divided)


def foretold_by_rest(
    rows: Floats, slopes: Floats, prior: tuple[Floats, Floats], where: Where
) -> Foretold | None:
    """Return a regime as a fit to the rest predicts it, None if the rest does not determine it.

    rows (ticks, o): white residuals; slopes (ticks, o, p); prior: residuals (k,) and slopes (k, p)
    of the priors. log det C is divided among the ticks.
    """
    found = step_without(rows, slopes, prior, where)
    if found is None:
        return None
    dx, whole, left = found
    inside = slopes[where].reshape(-1, dx.size)
    errors = rows[where].ravel() + inside @ dx
    weighed = errors - inside @ np.linalg.solve(whole, inside.T @ errors)
    errors, weighed = (each.reshape(-1, rows.shape[1]) for each in (errors, weighed))
    spread = float(np.linalg.slogdet(whole)[1] - np.linalg.slogdet(left)[1])
    return Foretold(np.sum(errors * weighed, axis=1) + spread / len(errors), errors, weighed)


def step_without(
    rows: Floats, slopes: Floats, prior: tuple[Floats, Floats], where: Where
) -> tuple[Floats, Floats, Floats] | None:
    """Return dx (p,) of a fit without a regime, and J'J and J_q'J_q with the priors."""
    every, rest = (part.reshape(-1, slopes.shape[2]) for part in (slopes, slopes[~where]))
    about = prior[1].T @ prior[1]
    whole, left = every.T @ every + about, rest.T @ rest + about
    # For each direction of x, the rest's share of the information of all samples.
    try:
        told = eigh(left, whole, eigvals_only=True)
    except np.linalg.LinAlgError:  # all samples together do not determine x
        return None
    if told.min() < TOLD:
        return None
    downhill = -(rest.T @ rows[~where].ravel() + prior[1].T @ prior[0])
    return np.asarray(np.linalg.solve(left, downhill), dtype=np.float64), whole, left

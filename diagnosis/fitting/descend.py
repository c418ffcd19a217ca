"""Downhill in lanes: every call of the kernel has slopes and steps of several lengths.

Gauss and Newton's step, damped as by Levenberg and Marquardt: with r the weighed innovations and J
their slopes,

    (J'J + m diag(J'J)) d = -J'r,

for several m at once. Where the step that is hardly damped leads, the slopes are asked for in the
same call, since near the end it is nearly always the best: so a round is one call of the lanes. A
fit ends where the next step foretells no gain, r'r - |r + J d|^2 = -d'J'r, that is worth a call.

Slopes are differences over a width of each parameter: what creases (friction that lets go, play
that is crossed, a limit that is met) shows no slope over less than some hundredth of what the
recording tells apart, and is smooth over more. Such a parameter's are taken to both sides.

Limits: as every descent it ends in the valley in which it began. The cost is that of `Landscape`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.account import reason
from zwidth.diagnosis.fitting.landscape import Landscape
from zwidth.diagnosis.model.parameters import is_read

Floats = NDArray[np.float64]
DAMPING = (1e-4, 1e-2, 0.1, 1.0, 10.0, 100.0, 1e3)  # of the diagonal: from Newton's step to a nudge
SMOOTH, CREASED = 1e-4, 0.02  # widths of differences in x, of which one is a file's uncertainty
SHARE = 0.5  # of a parameter's own standard error: narrower where it is known better
NARROWEST = 1e-3  # width below which creases show no slope
ENOUGH = 0.1  # of the cost, that is worth another round
FARTHEST = 5.0  # in x, that one step goes at most


@dataclass(frozen=True)
class Descended:
    """Where a descent ended: x, its cost, and how many rounds it made."""

    x: Floats
    cost: float
    rounds: int


@dataclass(frozen=True)
class Slopes:
    """Slopes (samples + priors, x) of the residual at x, and what else was asked to have them.

    beside: the x of the differences, then those that were asked for besides; costs: of these.
    """

    residual: Floats
    slopes: Floats
    beside: list[Floats]
    costs: Floats


def slopes_at(
    ground: Landscape, x: Floats, widths: Floats, both: bool, others: Sequence[Floats] = ()
) -> Slopes:
    """Return residual and slopes at x, in one call for all.

    both: whether the model has creases: differences to both sides, of the effects' parameters, and
    of all where a fit ends in the valley where it began. others: x whose costs are asked for too.
    """
    model, parameters = ground.model, ground.model.parameters
    upper = np.array([p.upper for p in parameters])
    lower = np.array([p.lower for p in parameters])
    forward = np.where(x + widths <= upper, widths, -widths)
    backward = np.clip(x - forward, lower, upper)
    valleys = any(q.valleys for p in model.effects for q in p.effect.parameters)
    experiments = ground.problem.experiments
    read = [i for i, p in enumerate(parameters) if is_read(p, experiments)]
    twice = [
        i
        for i in read
        if both and (valleys or not model.is_linear(parameters[i])) and backward[i] != x[i]
    ]

    def at(i: int, value: float) -> Floats:
        moved = x.copy()
        moved[i] = value
        return moved

    asked = [at(i, x[i] + forward[i]) for i in read] + [at(i, backward[i]) for i in twice]
    with reason("slopes"):
        residual, *found = ground.residuals([x, *asked, *others])
    slopes = np.zeros((residual.size, x.size))
    ahead = dict(zip(read, found, strict=False))
    behind = dict(zip(twice, found[len(read) :], strict=False))
    for i in read:
        if i in behind:
            slopes[:, i] = (ahead[i] - behind[i]) / (x[i] + forward[i] - backward[i])
        else:
            slopes[:, i] = (ahead[i] - residual) / forward[i]
    size = residual.size - int(np.count_nonzero(ground.priors))
    for row, i in enumerate(np.flatnonzero(ground.priors).tolist()):
        slopes[size + row] = 0.0
        slopes[size + row, i] = 1.0
    costs = np.array([ground.cost(r) for r in found])
    return Slopes(residual, slopes, [*asked, *others], costs)


def descend(
    ground: Landscape, x: Floats, rounds: int = 12, creased: bool = False, worth: float = ENOUGH
) -> Descended:
    """Go downhill from x; creased: whether the model has effects that are (`Effect.creased`)."""
    x = ground.model.within(x)
    widths = np.full(x.size, CREASED if creased else SMOOTH)
    at = slopes_at(ground, x, widths, creased)
    cost, made = ground.cost(at.residual), 1
    while made <= rounds:
        made += 1
        slopes = np.nan_to_num(at.slopes, nan=0.0, posinf=0.0, neginf=0.0)
        steps, foretold = _steps(ground, x, at.residual, slopes)
        if not steps or (not creased and foretold < worth):
            break
        if creased:
            widths = np.minimum(widths, _widths(slopes, at.residual))
        first, *others = steps
        ahead = slopes_at(ground, first, widths, creased, others)
        costs = np.concatenate([[ground.cost(ahead.residual)], ahead.costs])
        best = int(np.argmin(np.nan_to_num(costs, nan=np.inf)))
        gained = cost - float(costs[best])
        if not gained > 0.0:
            if not creased or widths.max() <= NARROWEST:
                break
            widths = np.maximum(0.25 * widths, NARROWEST)
            at = slopes_at(ground, x, widths, creased)
            continue
        if cost - float(costs[0]) > gained - worth:  # where the slopes are at hand
            x, cost, at = first, float(costs[0]), ahead
        else:
            x, cost = ahead.beside[best - 1], float(costs[best])
            if made < rounds and gained >= worth:
                at = slopes_at(ground, x, widths, creased)
        if gained < worth:
            break
    return Descended(x, cost, made)


def _widths(slopes: Floats, residual: Floats) -> Floats:
    """Widths by what the recording tells of each parameter alone."""
    size = float(residual @ residual) / residual.size
    own = np.sqrt(size / np.maximum(np.sum(slopes**2, axis=0), 1e-200))
    return np.clip(SHARE * own, NARROWEST, CREASED)


def _steps(
    ground: Landscape, x: Floats, residual: Floats, slopes: Floats
) -> tuple[list[Floats], float]:
    """Where steps of several lengths lead, and what the first of them foretells to gain."""
    square = slopes.T @ slopes
    downhill = slopes.T @ residual
    diagonal = np.diag(square) + 1e-12 * np.trace(square) / x.size
    found: list[Floats] = []
    foretold = 0.0
    for damping in DAMPING:
        try:
            step = -np.linalg.solve(square + damping * np.diag(diagonal), downhill)
        except np.linalg.LinAlgError:
            continue
        longest = float(np.abs(step).max(initial=0.0))
        if not np.isfinite(longest):
            continue
        to = ground.model.within(x + step * min(1.0, FARTHEST / max(longest, 1e-300)))
        if not found:
            d = to - x
            foretold = -float(2.0 * d @ downhill + d @ square @ d)
        found.append(to)
    return found, foretold

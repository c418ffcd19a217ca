"""Local descent; gradients and step lengths are evaluated side by side as populations.

The step of Gauss and Newton with the damping of Levenberg and Marquardt: with the weighted
innovations r and their slopes J,

    (J'J + m diag(J'J)) d = -J'r,

for several m at once, since one more lane costs little; the fit continues from the x of least cost.
Where many parameters act alike (a chain of five masses of which one is seen), J'J is almost
singular, and the valley is curved: a whole step of Gauss and Newton overshoots, and more damping
turns it away from the valley. So with the least m, parts of the step are tried too. (On such a
chain, whose file was up to 42 % wrong, fits without them ended at a -2 ln L of 266 more than the
truth has, and 12 of 19 intervals missed it; with them they end below, in 3/4 of the time.)
If a whole step is not the best, the valley is followed by the geodesic acceleration a (Transtrum,
Machta & Sethna, Phys. Rev. E 83, 036701, 2011). Along a step v,

    r'' = 2 / h [(r(x + h v) - r(x)) / h - J v],    (J'J + m diag(J'J)) a = -J'r'',

and x + s v + s^2 / 2 a is tried for a few s. (Of 40 refits of an exam, which ended without it up to
660 above those with it, in -2 ln, none ended more than 0.2 higher, for 14 % more simulations.)
Slopes are differences over a width of each parameter. At a crease (friction that lets go, play that
is crossed, a limit that is reached) the cost has no useful slope over widths below about a
hundredth of the resolution of the recording, and is smooth over more.

Limits: like every descent it ends in the valley in which it began. `Landscape` defines the cost.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.account import reason
from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.fitting.landscape import Landscape
from zwidth.diagnosis.fitting.straight import along
from zwidth.diagnosis.model.parameters import Model, is_read

Floats = NDArray[np.float64]
# Shares of the diagonal, from Newton's step to a tiny one, a decade apart: on a ridge with a
# curvature of 2e-4 of the diagonal, Newton's step went too far and 1e-2 gave a fiftieth of it; a
# fit of presliding friction and three masses ended 11 in -2 ln too high, dampers off by 3 sigma.
DAMPING = (1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1e3)
# Parts of nearly undamped steps. With DAMPING they fill the lanes of one call of the kernel.
ALONG = ((1e-7, (1.0, 0.3, 0.1, 0.03)), (1e-5, (1.0, 0.3, 0.1, 0.03)))
STEPS = (*((m, (1.0,)) for m in DAMPING), *ALONG)
# Indices in STEPS of whole steps that are hardly damped.
WHOLES = {0, len(DAMPING), len(DAMPING) + len(ALONG[0][1])}
BENT = (1e-7, 1e-5, 1e-3)  # damping of steps that are followed along the valley
ALONG_BEND, AHEAD = (1.0, 0.5, 0.25), 0.1  # s and h of the equations above
SMOOTH, CREASED = 1e-4, 0.02  # widths of differences in x; 1 is a device file's uncertainty
SHARE = 0.5  # of a parameter's standard error, if this gives a narrower width
NARROWEST = 1e-5
ENOUGH = 0.1  # least gain in cost that justifies another round
FARTHEST = 5.0  # in x: the longest step


@dataclass(frozen=True)
class Descended:
    """The end of a descent: x and its cost.

    slopes: of the last round, if its step gained little, so that they hold at x.
    """

    x: Floats
    cost: float
    slopes: Floats | None = None


@dataclass(frozen=True)
class Slopes:
    """Residual and slopes (samples + priors, x) at x; the x of the differences, and costs there."""

    residual: Floats
    slopes: Floats
    beside: list[Floats]
    costs: Floats


def slopes_at(ground: Landscape, x: Floats, widths: Floats, both: bool) -> Slopes:
    """Return residual and slopes at x, from one call of the kernel.

    both: two-sided differences, for models with creases. Parameters without influence on outputs
    are not simulated.
    """
    parameters = ground.model.parameters
    read = [i for i, p in enumerate(parameters) if is_read(p, ground.problem.experiments)]
    upper, lower = (np.array([getattr(p, end) for p in parameters]) for end in ("upper", "lower"))
    forward = np.where(x + widths <= upper, widths, -widths)
    backward = np.clip(x - forward, lower, upper)
    ends = (x + forward, backward) if both else (x + forward,)
    asked = [np.where(np.arange(x.size) == i, end, x) for end in ends for i in read]
    with reason("slopes"):
        residual, *found = ground.residuals([x, *asked])
    slopes = np.zeros((residual.size, x.size))
    for row, i in enumerate(np.flatnonzero(ground.priors)):
        slopes[residual.size - np.count_nonzero(ground.priors) + row, i] = 1.0
    for k, i in enumerate(read):
        if both and backward[i] != x[i]:
            slopes[:, i] = (found[k] - found[len(read) + k]) / (asked[k][i] - backward[i])
        else:
            slopes[:, i] = (found[k] - residual) / forward[i]
    costs = np.array([ground.cost(r) for r in found])
    return Slopes(residual, slopes, asked, costs)


def descend(
    ground: Landscape, x: Floats, rounds: int = 12, creased: bool = False, first: bool = False
) -> Descended:
    """Minimise from x; creased: whether the model has nonsmooth effects (`Effect.creased`).

    first: whether one-sided slopes suffice, as before another descent. On four recordings this lost
    no effect, and saved 10 to 13 % of the simulations. Nor does a first descent follow bends: where
    physics is missing, a fit that does imitates it. (With bends in each descent the friction of a
    servo motor was called a filter, after 490 instead of 183 CPU s; with none at all, the force law
    of a positioning system errs by 0.61 instead of 0.41 mm.)
    """
    x = ground.model.within(x)
    widths = np.full(x.size, CREASED if creased else SMOOTH)
    cost, last = np.inf, None
    for number in range(rounds):
        at = slopes_at(ground, x, widths, creased and not first)
        if number == 0:
            cost = ground.cost(at.residual)
        slopes = np.nan_to_num(at.slopes, nan=0.0, posinf=0.0, neginf=0.0)
        steps = _steps(ground, x, at.residual, slopes)
        tried = [*steps, *at.beside]
        with reason("steps"):
            own = ground.costs(steps) if steps else np.zeros(0)
        costs = np.concatenate([own, at.costs])
        best = int(np.argmin(np.nan_to_num(costs, nan=np.inf)))
        if not first and best not in WHOLES and cost - float(costs[best]) > ENOUGH:
            tried += (bent := _bent(ground, x, at.residual, slopes))
            with reason("steps"):
                costs = np.concatenate([costs, ground.costs(bent) if bent else []])
            best = int(np.argmin(np.nan_to_num(costs, nan=np.inf)))
        gained = cost - float(costs[best])
        if not gained > 0.0:
            last = slopes
            if not creased or widths.max() <= 4.0 * NARROWEST:
                break
            widths = np.maximum(0.25 * widths, NARROWEST)
            if widths.max() < 1e-3:
                break
            continue
        x, cost = tried[best], float(costs[best])
        if gained < ENOUGH:
            last = slopes
            break
        if creased:
            widths = _widths(slopes, at.residual)
    return Descended(x, cost, last)


def fit(problem: Problem, model: Model, x: Floats | None = None, rounds: int = 12) -> Fitted:
    """Return the best fit of a model from a start (None: all x are zero), with its slopes."""
    ended = descended(problem, model, np.zeros(len(model.parameters)) if x is None else x, rounds)
    if creased(model) or ended.slopes is None:
        return fitted_at(problem, model, ended.x)
    ground = ground_of(problem, model)
    (residual,) = ground.residuals([ended.x])
    return _fitted(ground, ended.x, residual, ended.slopes)


def ground_of(problem: Problem, model: Model) -> Landscape:
    """Return the cost of a model over x with the observer and the substeps of a problem."""
    return Landscape(problem.experiments, problem.observer, model, problem.fineness)


def descended(problem: Problem, model: Model, x: Floats, rounds: int) -> Descended:
    """Return the end of a fit of a model, with one-sided slopes."""
    return descend(ground_of(problem, model), x, rounds, creased(model), first=True)


def fitted_at(problem: Problem, model: Model, x: Floats) -> Fitted:
    """Return a model at x as a fit, with its slopes there."""
    ground = ground_of(problem, model)
    at = slopes_where_it_stands(ground, x)
    return _fitted(ground, x, at.residual, at.slopes)


def _fitted(ground: Landscape, x: Floats, residual: Floats, slopes: Floats) -> Fitted:
    samples = residual.size - int(np.count_nonzero(ground.priors))
    return Fitted(ground.model, x, float(residual @ residual), residual, slopes, samples)


def creased(model: Model) -> bool:
    """Whether a model's prediction is a nonsmooth function of its parameters."""
    return any(p.effect.creased for p in model.effects)


def slopes_where_it_stands(ground: Landscape, x: Floats) -> Slopes:
    """Return residual and slopes of a finished fit, two-sided over half a deviation at creases."""
    widths = np.full(x.size, CREASED if (bent := creased(ground.model)) else SMOOTH)
    found = slopes_at(ground, x, widths, bent)
    if not bent:
        return found
    own = 1.0 / np.sqrt(np.maximum(np.sum(found.slopes**2, axis=0), 1e-300))
    return slopes_at(ground, x, np.clip(SHARE * own, SMOOTH, CREASED), both=True)


def _widths(slopes: Floats, residual: Floats) -> Floats:
    """Widths of differences, from the uncertainty of each parameter alone."""
    size = float(residual @ residual) / residual.size
    own = np.sqrt(size / np.maximum(np.sum(slopes**2, axis=0), 1e-200))
    return np.clip(SHARE * own, 1e-3, CREASED)


def _steps(ground: Landscape, x: Floats, residual: Floats, slopes: Floats) -> list[Floats]:
    """The x of all steps and parts of them; x itself for one that cannot be computed."""
    square, downhill = slopes.T @ slopes, slopes.T @ residual
    whole = [_step(square, downhill, damping) for damping, _ in STEPS]
    parts = ALONG[0][1]
    gone = along(ground.model, x, whole, parts[::-1])[:, ::-1]
    asked = [gone[i, parts.index(part)] for i, (_, own) in enumerate(STEPS) for part in own]
    return [ground.model.within(x) for x in asked]


def _step(square: Floats, downhill: Floats, damping: float) -> Floats:
    """The step -(J'J + m diag(J'J))^-1 J'r, no longer than allowed; zero if it has no solution."""
    diagonal = np.diag(square) + 1e-12 * np.trace(square) / square.shape[0]
    try:
        step = -np.linalg.solve(square + damping * np.diag(diagonal), downhill)
    except np.linalg.LinAlgError:
        return np.zeros(square.shape[0])
    longest = float(np.abs(step).max(initial=0.0))
    if not np.isfinite(longest):
        return np.zeros(step.size)
    return np.multiply(step, min(1.0, FARTHEST / max(longest, 1e-300)), dtype=np.float64)


def _bent(ground: Landscape, x: Floats, residual: Floats, slopes: Floats) -> list[Floats]:
    """The x along a curved valley: of a step with its acceleration, for all dampings."""
    square, downhill = slopes.T @ slopes, slopes.T @ residual
    steps = [_step(square, downhill, damping) for damping in BENT]
    with reason("steps"):
        ahead = ground.residuals([ground.model.within(x + AHEAD * step) for step in steps])
    found: list[Floats] = []
    for damping, step, there in zip(BENT, steps, ahead, strict=True):
        second = 2.0 / AHEAD * ((there - residual) / AHEAD - slopes @ step)
        if np.isfinite(second).all():
            curve = 0.5 * _step(square, slopes.T @ second, damping)
            found += [ground.model.within(x + s * step + s * s * curve) for s in ALONG_BEND]
    return found

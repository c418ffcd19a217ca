"""Bring a fit on where friction and play make creases, and take its slopes across them."""

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fit import Fitted, Problem
from zwidth.diagnosis.parameters import Model
from zwidth.diagnosis.uncertainty import DEAD
from zwidth.jobs.parallel import in_parallel, threads

Floats = NDArray[np.float64]
CREASES = 8  # times that slopes and errors are computed in turn, at most
SHARES = (2.0, 1.0, 0.5, 0.25, 0.1)  # of a step that are tried
NOTHING = 0.1  # chi-square that is not worth another turn
WIDEST = 0.5  # in x
TURNS = 8  # about the middle of the creases
WIDE = 3.0  # errors, over which creases weigh little in a slope
BURNT = 2  # of them, on the way there
SMOOTH = 0.05  # variance that roughness adds to each parameter's own, below which it is none
ROUGHEST = 5.0  # above it the model is bent and not rough
FARTHEST = 1.0  # errors a parameter, that a turn may go
WALKED = (0.3, 0.1, 0.03, 0.01)  # of a gap, by which it is made larger and smaller
STEPS = 4  # by each of them, at most
ROUNDS = 8  # of a fit from there
BETTER = 2.0  # chi-square by which another gap must be better


def over_creases(problem: Problem, fitted: Fitted) -> Fitted:
    """Return the fit brought on, and with slopes along its principal directions, over its errors.

    Friction and play make creases: a stop that a parameter moves from one substep to the next. Over
    a tiny difference each is a cliff, at which a fit stops short (a gap by 11 to 22 sigma); and
    where parameters can hardly be told apart (all masses, dampers, springs and the gain together),
    the cliffs of each column alone pass for what tells them apart. So with J = U S V',
    D_k = (r(x + h v_k) - r(x - h v_k)) / 2 h over h = 1 / S_k, the error along v_k, J = D V', and
    a step of Gauss and Newton by these slopes, until none gains.
    """
    if not fitted.model.acting(fitted.x).physics:
        return fitted
    for turn in range(CREASES):
        fitted = _with_slopes(problem, fitted)[0]
        if turn + 1 < CREASES:
            further = _step_on(problem, fitted)
            if further is None and turn > 0:
                break
            fitted = fitted if further is None else further
    return fitted


def across_creases(problem: Problem, fitted: Fitted) -> Fitted:
    """Return a fit of play in the middle of its creases, and how much further it errs for them.

    The lowest point between a thousand creases says little: the likelihood of play scatters by 10
    from one place to the next, the law of contact and not the recording decides which is lowest,
    and slopes about it promise too much (a friction beside play off by 3 errors). So the residual
    is taken as the mean over all ends of the errors, r', and the fit goes on by d = -J^+ r' and
    again; where it is smooth d vanishes, where it is not it scatters about the middle. That is the
    mean over the turns, and |J d|^2 a parameter is the variance that roughness adds, in units of
    what slopes alone promise. Limits: r' bends with the model too, so friction, which is smooth
    over its errors, is left out, and so is a fit that goes farther than creases do.
    """
    if not _gaps(fitted.model):
        return fitted
    at, centres, added = fitted, list[Floats](), list[float]()
    for turn in range(TURNS):
        at, mean = _with_slopes(problem, at, WIDE)
        way = -np.linalg.lstsq(at.jacobian, mean, rcond=DEAD)[0]
        foretold = at.jacobian @ way
        added.append(float(foretold @ foretold) / fitted.x.size)
        if turn == 0 and added[0] < SMOOTH:
            return fitted
        x = fitted.model.within(at.x + way / max(1.0, np.sqrt(added[-1]) / FARTHEST))
        centres.append(x)
        at = replace(at, x=x, residual=problem.residual(fitted.model, x))
    x = np.mean(centres[BURNT:], axis=0)
    rough = float(np.mean(added[BURNT:]))
    if rough > ROUGHEST:
        return fitted
    residual = problem.residual(fitted.model, x)
    middle = replace(at, x=x, residual=residual, chi2=float(residual @ residual))
    return replace(_with_slopes(problem, middle, WIDE)[0], rough=rough)


def along_gaps(problem: Problem, fitted: Fitted) -> Fitted:
    """Return the fit after its gaps of play, if any, were walked to where they fit best.

    Contact comes and goes with a gap, so the errors over a gap have a valley every few percent, and
    a fit ends in the one where it began (gaps off by 7 % and 80 sigma, and two more effects named
    for what was left). So gaps are made larger and smaller by a share, everything is fitted anew
    from there, and the better one kept, by ever smaller shares.
    """
    if not _gaps(fitted.model):
        return fitted
    fitted = over_creases(problem, fitted)
    for share in WALKED:
        for _ in range(STEPS):
            ends = (1.0 - share, 1.0 / (1.0 - share))
            starts = [with_gaps(fitted.model, fitted.x, factor) for factor in ends]
            both = [problem.fit(fitted.model, x, ROUNDS) for x in starts]
            best = min(both, key=lambda f: f.chi2)
            if best.chi2 > fitted.chi2 - BETTER:
                break
            fitted = over_creases(problem, best)
    return fitted


def with_gaps(model: Model, x: Floats, factor: float) -> Floats:
    """Return x with gaps of play a factor as wide."""
    x = x.copy()
    for j in _gaps(model):
        p = model.parameters[j]
        start = model.effects[p.index].values[p.key]
        x[j] = (factor * (start + p.scale * x[j]) - start) / p.scale
    return model.within(x)


def _gaps(model: Model) -> list[int]:
    return [
        j
        for j, p in enumerate(model.parameters)
        if p.kind == "effect" and model.effects[p.index].effect.parameter(p.key).valleys
    ]


def _with_slopes(problem: Problem, fitted: Fitted, errors: float = 1.0) -> tuple[Fitted, Floats]:
    """The fit with slopes over so many errors, and the mean of all residuals asked for them."""
    _, size, directions = np.linalg.svd(fitted.jacobian, full_matrices=False)
    asked = in_parallel(
        [
            partial(_along, problem, fitted, v, float(s) / errors, s > DEAD * size[0])
            for s, v in zip(size, directions, strict=True)
        ],
        threads(),
    )
    slopes = np.column_stack([slope for slope, _ in asked]) @ directions
    middles = [middle for _, middle in asked if middle is not None]
    return replace(fitted, jacobian=slopes), np.mean([fitted.residual, *middles], axis=0)


def _step_on(problem: Problem, fitted: Fitted) -> Fitted | None:
    """The fit after the best part of a step of Gauss and Newton; None where none gains."""
    way = -np.linalg.lstsq(fitted.jacobian, fitted.residual, rcond=DEAD)[0]
    tried = [fitted.model.within(fitted.x + share * way) for share in SHARES]
    found = in_parallel([partial(problem.residual, fitted.model, x) for x in tried], threads())
    costs = [float(r @ r) for r in found]
    best = int(np.argmin(costs))
    if costs[best] > fitted.chi2 - NOTHING:
        return None
    return replace(fitted, x=tried[best], residual=found[best], chi2=costs[best])


def _along(
    problem: Problem, fitted: Fitted, v: Floats, size: float, alive: bool
) -> tuple[Floats, Floats | None]:
    """Slope of the residual along a direction, over 1 / size, and the mean of both ends.

    J v and None near a bound.
    """
    parameters = fitted.model.parameters
    reach = min(1.0 / size, WIDEST / float(np.abs(v).max())) if alive else 0.0
    ends = [fitted.x - reach * v, fitted.x + reach * v]
    lower = np.array([p.lower for p in parameters])
    upper = np.array([p.upper for p in parameters])
    if reach == 0.0 or any(np.any(x < lower) or np.any(x > upper) for x in ends):
        return fitted.jacobian @ v, None
    low, high = (problem.residual(fitted.model, x) for x in ends)
    return (high - low) / (2.0 * reach), 0.5 * (low + high)

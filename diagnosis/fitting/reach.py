"""How far the 95 % interval of a parameter reaches on either side of its best value.

1.96 standard errors are right if -2 log likelihood is a parabola. It is not for the stiffness of a
bristle, for example: twice the stiffness changes the motion little, half of it much. So the profile
of the likelihood is used, minimised over all other parameters: the interval ends where it has risen
by 1.96^2. For a parabola with P = (J'J)^-1 the profile lies along the line

    x + d P e_j / P_jj,    where the cost has risen by d^2 / P_jj.

The true cost is computed along this line, and at each point the other parameters make one more step
of Gauss and Newton, with the slopes J of the best fit. With g = J' r of the residual r there, and
x_j held, this step is

    -(P g - P e_j (P g)_j / P_jj).

If the residual is not white, the variance v of x_j is not P_jj, and the interval ends where the
cost has risen by v / P_jj times 1.96^2. Limits: in a strongly curved valley one such step does not
reach the bottom, so the cost is above the profile and the interval too short. Therefore no side is
shorter than that of the parabola (`uncertainty.spans`). If the cost falls along the line, x is not
the best of its model, and the line says nothing.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.account import reason
from zwidth.diagnosis.fitting.descend import ground_of
from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.fitting.uncertainty import Z95, standard_errors

Floats = NDArray[np.float64]
ROUNDS = 5
NEARLY = 0.97  # of 1.96: close enough
FARTHER = 3.0  # largest factor of the distance in one round
SHARES = (1.0, 0.5)  # of the step of the other parameters


def reaches(problem: Problem, fitted: Fitted, spans: Floats, which: Sequence[int]) -> Floats:
    """Return how far the interval of x[which] reaches below and above, (w, 2), in x, both positive.

    spans (p, 2): of the parabola; where they are not finite, neither are the reaches.
    """
    ground = ground_of(Problem(problem.experiments, problem.observer), fitted.model)
    slopes = fitted.jacobian.copy()
    slopes[:, [p.kind == "gain" for p in fitted.model.parameters]] = 0.0  # see `standard_errors`
    rows = np.linalg.pinv(slopes)
    inner = rows @ rows.T
    own = np.array(which, dtype=np.int64)
    found, errors = spans[own], standard_errors(fitted)
    seen = np.isfinite(found[:, 0]) & (errors[own] > 0.0) & (np.diag(inner)[own] > 0.0)
    left = [(i, side) for i in np.flatnonzero(seen) for side in (0, 1)]
    with reason("intervals"):
        least = float(ground.costs([fitted.x])[0]) if left else 0.0
        for _ in range(ROUNDS):
            if not left:
                break
            ends = [own[i] for i, _ in left]
            lines = inner[:, ends] / inner[ends, ends]
            far = np.array([found[i, side] * (1.0 if side else -1.0) for i, side in left])
            xs = [ground.model.within(x) for x in fitted.x + (lines * far).T]
            residuals = ground.residuals(xs)
            steps = inner @ (slopes.T @ np.array(residuals).T)
            steps -= lines * steps[ends, np.arange(len(left))]
            moved = [x - a * step for a in SHARES for x, step in zip(xs, steps.T, strict=True)]
            costs = [ground.cost(r) for r in residuals]
            costs += list(ground.costs([ground.model.within(x) for x in moved]))
            rise = np.reshape(costs, (-1, len(left))).min(axis=0) - least
            risen = np.sqrt(np.maximum(rise, 0.0) * inner[ends, ends]) / (Z95 * errors[ends])
            on = (rise >= 0.0) & (risen < NEARLY)  # a cost that falls: x is not the best
            for (i, side), share in zip(left, np.where(on, risen, 1.0), strict=True):
                found[i, side] *= min(FARTHER, 1.0 / max(share, 1.0 / FARTHER))
            left = [one for one, further in zip(left, on, strict=True) if further]
    return found

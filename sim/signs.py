"""Signs under which absolute values move as one linear system: Viterbi's recursion.

Of readings y and signs s let z_k = s_k y_k be predicted from its own past and a command u,

    z_k = sum_i a_i z_(k-i) + sum_j b_j u_(k-j) + e_k,    i = 1..n, j = 0..n.

The signs that make the sum of e^2 least are sought over the sign of the last sample alone: of all
pasts that lead to it, each of both keeps the best. That is exact where the past shows in e_k by its
last sample only, and near it where signs change at most once in n samples.
"""

# pyright: reportMissingParameterType=false, reportUnknownParameterType=false

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.jit import jit

Floats = NDArray[np.float64]


def likeliest_signs(
    y: Floats, command: Floats, slopes: Floats, pushes: Floats, first: Floats
) -> tuple[Floats, float]:
    """Return signs (samples,) of y and the sum of squares of their errors.

    slopes (n,): a; pushes (n + 1,): b; first (n,): signs of the first samples, or all turned round.
    """
    order = slopes.size
    signs = np.concatenate([first, np.zeros(y.size - order)])
    came = np.zeros((y.size, 2), dtype=np.int8)
    pasts = np.zeros((2, 2, order))
    pasts[0, 0], pasts[0, 1] = first[::-1], -first[::-1]
    total = _recursion(
        np.ascontiguousarray(y), np.ascontiguousarray(command), np.ascontiguousarray(slopes),
        np.ascontiguousarray(pushes), pasts, came, np.zeros((2, 2)), signs,
    )  # fmt: skip
    return signs, float(total)


@jit
def _recursion(y, command, slopes, pushes, pasts, came, costs, signs):
    """Fill signs from their first, and return their square error.

    pasts (2, 2, n): signs of the last samples that lead to either state, the latest first, now and
    next; came (samples, 2): from which state; costs (2, 2), now and next.
    """
    order, size = slopes.size, y.size
    now = 0
    for k in range(order, size):
        push = 0.0
        for j in range(pushes.size):
            push += pushes[j] * command[k - j]
        plus, minus = push, push
        for i in range(order):
            plus += slopes[i] * pasts[now, 0, i] * y[k - 1 - i]
            minus += slopes[i] * pasts[now, 1, i] * y[k - 1 - i]
        for state in range(2):
            z = y[k] if state == 0 else -y[k]
            stayed = costs[now, 0] + (z - plus) * (z - plus)
            turned = costs[now, 1] + (z - minus) * (z - minus)
            via = 0 if stayed <= turned else 1
            costs[1 - now, state] = stayed if via == 0 else turned
            came[k, state] = via
            pasts[1 - now, state, 0] = 1.0 if state == 0 else -1.0
            for i in range(order - 1):
                pasts[1 - now, state, i + 1] = pasts[now, via, i]
        now = 1 - now
    state = 0 if costs[now, 0] <= costs[now, 1] else 1
    total = costs[now, state]
    for k in range(size - 1, order - 1, -1):
        signs[k] = 1.0 if state == 0 else -1.0
        state = came[k, state]
    if state == 1:
        for i in range(order):
            signs[i] = -signs[i]
    return total

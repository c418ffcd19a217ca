"""The backward difference, v_k = (y_k - y_{k-1}) / h.

Exact for a constant velocity; half a period late. With an encoder step D it has steps of D / h.
"""

import numpy as np

from zwidth.sim.estimators.estimator import Complexes, Estimator, Linear, Settings

DIFFERENCE = 0


def _linear(_: Settings) -> Linear:
    return Linear(np.zeros((1, 1)), np.ones(1), np.array([-1.0]), 1.0, np.ones(1))


def _response(_: Settings, z: Complexes) -> Complexes:
    return np.ones_like(z)


difference = Estimator(
    name="difference",
    code=DIFFERENCE,
    settings=(),
    meaning="the last reading less the one before, over the time between them",
    reference="Euler's backward difference",
    room=lambda settings: 0,  # the interface remembers the reading anyway
    numbers=lambda settings: (),
    begin=lambda settings, read, speed: [],
    linear=_linear,
    response=_response,
)

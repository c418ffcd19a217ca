"""Velocity estimators of the tick, one file each, and the table of them.

An estimator computes a velocity from the encoder's readings, before the low-pass of the interface.
It has a name, its settings, its memory, a compiled step (`dispatch.py`) and, if it is linear, its
difference equation for the theory (`estimator.py`).
"""

from zwidth.sim.estimators.difference import difference
from zwidth.sim.estimators.estimator import Estimator, Linear, Settings
from zwidth.sim.estimators.foaw import MOST_WINDOW, foaw, foaw_end
from zwidth.sim.estimators.kalman import kalman
from zwidth.sim.estimators.kalman_acceleration import kalman_acceleration
from zwidth.sim.estimators.levant import levant

ESTIMATORS: dict[str, Estimator] = {
    e.name: e for e in (difference, foaw, foaw_end, levant, kalman, kalman_acceleration)
}

__all__ = ["ESTIMATORS", "MOST_WINDOW", "Estimator", "Linear", "Settings"]

"""The response of the velocity estimate to a motion, in z.

With q = 1/z, the weights (a, b, c, d) of the filter (`Interface.velocity_filter`), and the response
E of the estimator over the backward difference (`sim/estimators`),

    v (1 - q + q G) = G E (1 - q) y / T,    G = a + b c q / (1 - d q).

Limits: one rate only, since an estimate made every few ticks is not a function of z alone; linear
estimators only, since the gain of any other depends on the motion.
"""

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.loop import linear_estimator

Complexes = NDArray[np.complex128]


def filter_response(interface: Interface, z: Complexes) -> Complexes:
    """Return the response of estimator and filter at z: v over the backward difference.

    Raises ValueError for an estimator that is not linear.
    """
    linear_estimator(interface)
    estimated = interface.estimator.response
    first = 1.0 if estimated is None else estimated(interface.estimator_settings, z)
    a, b, c, d = interface.velocity_filter
    behind = 1.0 / z
    straight = a + b * c * behind / (1.0 - d * behind)
    return first * straight / (1.0 - behind + behind * straight)


def velocity_response(interface: Interface, z: Complexes) -> Complexes:
    """Return the velocity estimate's response at z: v over the position [1/s]."""
    return filter_response(interface, z) * (1.0 - 1.0 / z) / interface.period


def refuse_force(device: Device, what: str) -> None:
    """Raise ValueError for a device with force feedback, which `what` does not cover."""
    if device.interface.force_gain > 0.0:
        raise ValueError(
            f"force_gain is {device.interface.force_gain:g}, but {what} takes no force feedback:"
            " set it to 0, or use the linear boundary"
        )

"""A force sensor in a link of the chain, and its force as a function of the state.

The sensor measures the force with which the device pushes the masses beyond it, that of the link's
spring and damper, F = k (q_i - q_{i+1}) + c (v_i - v_{i+1}), at the moment of the encoder's reading
and without an error. The interface feeds it back: with a law's command w it sends

    u = w + G (w - F),

so that the hand feels the mass and damping on the device's side of the sensor divided by 1 + G, and
the wall unchanged (C. R. Carignan, K. R. Cleary, Haptics-e 1 (2), 2000: closed-loop impedance
control).

Limits: forces of effects inside the sensor's link are not measured.
"""

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.chain import Chain
from zwidth.sim.interface import Interface
from zwidth.sim.place import place_at

Floats = NDArray[np.float64]


def force_row(chain: Chain, interface: Interface, dof: int) -> Floats:
    """Return the row that gives the measured force from [q, v], (2 dof,); (0,) without a sensor.

    dof: number of moving masses, including those of effects. Raises ValueError if the chain has no
    such link.
    """
    if not interface.force_sensor:
        return np.zeros(0)
    link = place_at(interface.force_sensor).index
    if link >= chain.link_springs.size:
        raise ValueError(
            f"interface.force_sensor is {interface.force_sensor!r}; the device has"
            f" {chain.masses.size} masses, so give a link between two of them, or none"
        )
    row = np.zeros(2 * dof)
    for offset, value in ((0, chain.link_springs[link]), (dof, chain.link_dampers[link])):
        row[offset + link], row[offset + link + 1] = value, -value
    return row

"""Possible differences between Table I's model and Table II's device: quantities, candidates.

Limits: priors of 10 % on inertia and frequencies, 30 % on c and d, 50 % on b restrict the
parameters; 24 rows cannot distinguish all candidates.
"""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.identification.coordinates import parameters
from zwidth.scenarios.table_2 import DEVICE
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.modal import ModalModel, Mode
from zwidth.stability.describing import friction_damper
from zwidth.stability.limited_relay import limited_reading
from zwidth.stability.linear import critical_stiffness

Floats = NDArray[np.float64]
PARAMETERS = ("m", "b", "omega_1", "c_1", "v_1", "d_1", "omega_2", "c_2", "v_2", "d_2")
SECOND = PARAMETERS[6:]
SPREAD: dict[str, float] = {
    **dict(zip(PARAMETERS, (0.1, 0.5, *(0.1, 0.3, 0.1, 0.3) * 2), strict=True)),
    "viscous": 0.02,
    "delay": 1e-3,
    "gain": 0.1,
    "rho": 0.3,
    "limit": 1.0,
}
NOT_NEGATIVE = ("viscous", "delay", "rho")
RATIO = 30.0  # initial amplifier's limit over the relay's force
ROUNDS = 30  # most iterations of the friction's damper, which depends on the K that it changes
CANDIDATES: dict[str, tuple[str, ...]] = {
    "Table I (the paper's)": (),
    "Coulomb friction": ("rho",),
    "extra viscous friction": ("viscous",),
    "fractional delay": ("delay",),
    "gain error": ("gain",),
    "limited amplifier": ("limit",),
    "gain error, limited amplifier": ("gain", "limit"),
    "inertia and damping": ("m", "b"),
    "inertia and damping, limited amplifier": ("m", "b", "limit"),
    "another second mode": SECOND,
    "second mode, viscous friction": (*SECOND, "viscous"),
    "second mode, Coulomb friction": (*SECOND, "rho"),
    "second mode, limited amplifier": (*SECOND, "limit"),
    "Table I refitted": PARAMETERS,
    "Table I refitted, Coulomb friction": (*PARAMETERS, "rho"),
    "Table I refitted, limited amplifier": (*PARAMETERS, "limit"),
}


class Theory(NamedTuple):
    """A device according to a candidate.

    gain of the amplifier; delay [s] beyond that of the loop; rho: friction over the relay's force;
    ratio: the amplifier's limit over the relay's force, infinite for none.
    """

    model: ModalModel
    period: float
    gain: float
    delay: float
    rho: float
    ratio: float

    def device(self, delay: float) -> Device:
        """Return the linear part at a delay of the loop [s], without gain."""
        return table_1().with_modal(self.model).with_interface(delay=delay + self.delay)

    def reading(self, delay: float, damping: float) -> tuple[float, float]:
        """Return (K_CR, f [Hz]) that a relay reads at a delay [s] and B; (0, nan) for no wall."""
        device, damper = self.device(delay), 0.0
        stiffness, frequency = 0.0, float("nan")
        for _ in range(ROUNDS if self.rho else 1):
            rubbed = friction_damper(device, damper) if damper else device
            if self.ratio < np.inf:
                point = limited_reading(rubbed, self.gain * damping, self.ratio)
            else:
                point = critical_stiffness(rubbed, self.gain * damping)
            if point.stiffness is None or point.frequency_hz is None:
                return 0.0, float("nan")
            stiffness, frequency = point.stiffness, point.frequency_hz
            damper = 0.5 * (damper + self.rho * stiffness / (2.0 * np.pi * frequency))
        return stiffness / self.gain, frequency


def theory(free: Sequence[str], x: Floats) -> Theory:
    """Return the theory at values (p,) of the free quantities."""
    values = dict(zip(free, x.tolist(), strict=True))
    device = table_1()
    assert device.modal is not None
    p = parameters(device.modal) * np.exp([values.get(name, 0.0) for name in PARAMETERS])
    modes = (Mode(*p[2:6].tolist()), Mode(*p[6:10].tolist()))
    return Theory(
        ModalModel(float(p[0]), float(p[1]) + values.get("viscous", 0.0), modes),
        device.interface.period,
        float(np.exp(values.get("gain", 0.0))),
        values.get("delay", 0.0),
        values.get("rho", 0.0),
        RATIO * float(np.exp(values["limit"])) if "limit" in values else np.inf,
    )


@cache
def table_1() -> Device:
    """Return the paper's device."""
    return load_device(DEVICE)

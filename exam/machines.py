"""Machines of full size: one to five masses, clocks and encoders as drives have them.

Sizes are those of small drives: inertias of 1e-4 to 2e-2 kg m2 that turn, 0.1 to 10 kg along a
line, which a pinion of 10 to 50 mm moves. A device file is what a user has: a guess, a guess to
which the linear parameters were fitted, or an exact one.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface

Floats = NDArray[np.float64]
MASSES = (0.35, 0.35, 0.2, 0.06, 0.04)  # shares of one to five masses
ROTARY_SHARE, SPRUNG_SHARE = 0.65, 0.15
RATES_HZ = (100.0, 200.0, 250.0, 500.0, 1000.0, 2000.0)
COUNTS = (500.0, 20000.0)  # steps per turn
DELAYS = (0.0, 0.5, 1.0, 1.5)  # ticks
MODES_HZ = (4.0, 60.0)  # of links, each taken alone
FASTEST_MODE = 0.15  # of the sampling rate
OFF = (0.1, 0.5)  # by how much a number of a guessed device file is too large or too small


@dataclass(frozen=True)
class Machine:
    """A device without physics. radius: of a motion in radians to one of the device, 1 [rad]."""

    device: Device
    radius: float


def draw_machine(random: np.random.Generator) -> Machine:
    """Return a machine whose encoder and clock its device file knows."""
    n = int(random.choice(5, p=MASSES)) + 1
    rotary = bool(random.random() < ROTARY_SHARE)
    radius = 1.0 if rotary else log_uniform(random, 0.01, 0.05)
    total = log_uniform(random, 1e-4, 2e-2) if rotary else log_uniform(random, 0.1, 10.0)
    period = 1.0 / float(random.choice(RATES_HZ))
    masses = total * random.dirichlet(np.full(n, 4.0))
    highest = min(MODES_HZ[1], FASTEST_MODE / period)
    hertz = np.array([log_uniform(random, MODES_HZ[0], highest) for _ in range(n - 1)])
    reduced = masses[:-1] * masses[1:] / (masses[:-1] + masses[1:])
    springs = reduced * (2.0 * np.pi * hertz) ** 2
    links = 2.0 * random.uniform(0.01, 0.1, n - 1) * np.sqrt(springs * reduced)
    dampers = total * log_uniform(random, 0.3, 5.0) * random.dirichlet(np.full(n, 2.0))
    spring = 0.0
    if random.random() < SPRUNG_SHARE:
        spring = total * (2.0 * np.pi * random.uniform(0.5, 3.0)) ** 2
    interface = Interface(
        period=period,
        delay=period * float(random.choice(DELAYS)),
        encoder_step=2.0 * math.pi * radius / round(log_uniform(random, *COUNTS)),
    )
    chain = make_chain(masses, dampers, spring, springs, links)
    return Machine(Device("device", "", rotary, chain, interface), radius)


def guessed(random: np.random.Generator, device: Device) -> Device:
    """Return the device with every number of its chain too large or small by 10 to 50 %."""
    chain = device.chain

    def off(values: object) -> Floats:
        exact = np.asarray(values, dtype=np.float64)
        sign = random.choice((-1.0, 1.0), exact.shape)
        return exact * (1.0 + random.uniform(*OFF, exact.shape)) ** sign

    return replace(
        device,
        chain=make_chain(
            off(chain.masses),
            off(chain.ground_dampers),
            float(off(chain.ground_spring)),
            off(chain.link_springs),
            off(chain.link_dampers),
        ),
        physics=(),
        modal=None,
    )


def log_uniform(random: np.random.Generator, low: float, high: float) -> float:
    """Return a number between two, uniform in its logarithm."""
    return float(np.exp(random.uniform(math.log(low), math.log(high))))

"""A population that follows a recording, and each member alone."""

import numpy as np
from engine_examples import Floats

from zwidth.sim.device import Device
from zwidth.sim.equations import equations
from zwidth.sim.population import Population, Recorded
from zwidth.sim.predict import GROUND, Outputs, alone
from zwidth.sim.run import Start, start_memory

TICKS = 700  # more than a piece
OUTPUTS = Outputs(
    np.array([0, 4]), np.array([True, False]), np.array([GROUND, GROUND]), np.zeros(2)
)


def recorded(ticks: int = TICKS) -> Recorded:
    rng = np.random.default_rng(3)
    walk = 1e-4 * np.cumsum(rng.normal(size=(ticks, 2)), axis=0)
    walk[40:43, 1] = np.nan
    return Recorded(0.1 * rng.normal(size=ticks), walk, OUTPUTS)


def gain(devices: list[Device]) -> Floats:
    found = np.zeros((devices[0].plant().size, 2))
    found[0, 0], found[devices[0].plant().dof, 0], found[1, 1] = 0.3, 20.0, 1e-3
    return found


def start(population: Population) -> Floats:
    masses = population.dof - population.followers.shape[0]
    return 1e-3 * np.random.default_rng(5).normal(size=(population.size, masses))


def own_innovations(device: Device, few: int, many: int, q: Floats, observer: Floats) -> Floats:
    eq, fine, r = equations(device, few), equations(device, many), recorded()
    memory = start_memory(eq, Start(q.tolist()))
    none = np.zeros((0, eq.dof))
    return alone(eq, fine, OUTPUTS, r.command, r.measured, observer, none, memory)

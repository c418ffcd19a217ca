"""Recordings of a device with a law that has no name."""

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.mishaps import silent
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.diagnosis.selection.hypothesis import judged, settled
from zwidth.diagnosis.selection.search import Search
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface

Floats = NDArray[np.float64]
T = 0.004
DEVICE = Device("mass", "", False, make_chain([0.5], [0.8], 30.0), Interface(period=T))
Law = Callable[[float, float], float]


def nothing(_: float, __: float) -> float:
    return 0.0


@cache
def recording(law: Law, seed: int = 3, ticks: int = 2500) -> Experiment:
    """A mass on a spring under a law, by classical Runge-Kutta in halves of a tick."""
    random = np.random.default_rng(seed)
    command = np.repeat(random.normal(0.0, 4.0, ticks // 25 + 1), 25)[:ticks]
    x, position = np.zeros(2), np.zeros(ticks)

    def moves(x: Floats, u: float) -> Floats:
        q, v = float(x[0]), float(x[1])
        return np.array([v, (u - 0.8 * v - 30.0 * q + law(q, v)) / 0.5])

    for k in range(ticks):
        position[k] = x[0]
        for _ in range(2):
            h, u = T / 2.0, float(command[k])
            a = moves(x, u)
            b = moves(x + 0.5 * h * a, u)
            c = moves(x + 0.5 * h * b, u)
            x = x + h / 6.0 * (a + 2.0 * b + 2.0 * c + moves(x + h * c, u))
    noisy = position + 2e-5 * random.standard_normal(ticks)
    swing = float(np.std(noisy))
    return Experiment(T, command, noisy[:, None], (Output("position", 0),), swing=swing)


@cache
def without_names(law: Law) -> Search:
    """A search that knows no name."""
    model = Model(DEVICE)
    fit = recording(law).split()[0]
    plain = settled(judged([fit], model, np.zeros(len(model.parameters))))
    return Search(plain, plain, QUICK, silent)

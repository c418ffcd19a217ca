"""Recordings of a drive with play and friction, as a fit has them."""

import numpy as np
from engine_examples import phantom
from numpy.typing import NDArray

from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.run import simulate

Floats = NDArray[np.float64]


def drive(scale: Floats | float = 1.0) -> Device:
    """Return two masses on a link of 34 Hz, at 500 Hz; scale: of masses and spring."""
    factor = np.broadcast_to(scale, 3)
    chain = make_chain(
        np.array([2e-3, 1.5e-3]) * factor[:2], np.array([2e-3, 1e-3]), 0.0, 40.0 * factor[2:],
        np.array([0.02]),
    )  # fmt: skip
    device = phantom().without_physics().with_chain(chain)
    return device.with_interface(period=2e-3, delay=0.0)


def recording(
    device: Device,
    ticks: int,
    seed: int,
    outputs: tuple[int, ...] = (0,),
    push: Floats | float = 0.0,
    size: float = 0.1,
) -> Experiment:
    """Return positions of some masses under a multisine of 0.1 to 20 Hz, in steps of an encoder.

    push: a force on m1 that is not in the recorded command; size: rms of that [N m].
    """
    period, random = device.interface.period, np.random.default_rng(seed)
    t = period * np.arange(ticks)
    hertz = np.arange(0.125, 20.0, 0.125)
    phases = random.uniform(0.0, 2.0 * np.pi, hertz.size)
    lines = np.cos(2.0 * np.pi * np.outer(t, hertz) + phases) / np.hypot(1.0, hertz / 3.0)
    command = size * lines.sum(axis=1) / np.std(lines.sum(axis=1))
    run = simulate(device, recorded(command + push), duration=ticks * period, substeps=64)
    step, noise = 3.8e-4, 8.7e-5
    seen = [run.trace[f"position_m{i + 1}"] for i in outputs]
    noisy = np.column_stack([y + noise * random.standard_normal(ticks) for y in seen])
    measured = step * np.round(noisy / step)
    named = tuple(Output("position", i) for i in outputs)
    return Experiment(period, command, measured, named, "made", float(np.std(measured[:, 0])))


def play(gap: float) -> Physics:
    return make_physics("backlash", "link12", gap=gap)

"""Simulated recordings for the tests of the diagnosis: white torque on the PHANToM of Table I."""

import numpy as np
from numpy.typing import NDArray

from zwidth.controllers.excitation import noise
from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.run import simulate

ENCODER_NOISE, FORCE_NOISE = 1e-5, 2e-3
OUTPUTS = (Output("position", 0),)


def phantom() -> Device:
    return load_device("phantom_1_0").with_interface(delay=0.0)


def shifted(device: Device) -> Device:
    """The device with parameters a few percent off: what a user knows of it."""
    chain = device.chain
    return device.with_chain(
        chain._replace(
            masses=chain.masses * np.array([1.05, 0.95, 1.03]),
            link_springs=chain.link_springs * np.array([1.04, 0.97]),
        )
    )


def record(
    truth: Device,
    seconds: float = 6.0,
    seed: int = 0,
    gain: float = 1.0,
    force: NDArray[np.float64] | float = 0.0,
) -> Experiment:
    """Record a device; gain: by which the command is written down wrong. force: more at m1."""
    random = np.random.default_rng(seed)
    command = noise(duration=seconds, seed=seed)
    run = simulate(
        truth,
        recorded(command),
        duration=seconds,
        disturbance=FORCE_NOISE * random.standard_normal(command.size) + force,
        substeps=20 if truth.physics else 1,
    )
    position = run.trace["position_m1"] + ENCODER_NOISE * random.standard_normal(command.size)
    return Experiment(0.001, gain * command, position[:, None], OUTPUTS)

"""A simulated recording of a planned experiment: the response of a device to a command, with noise.

The experiment is analysed before it is made, so its recording is simulated, with the noise that the
rig is believed to have: a random force at m1, new every tick, and measurement noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.noise.predictor import Observer
from zwidth.diagnosis.noise.steady import steady
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.scenarios.scenario import usual_substeps
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.run import Outcome, simulate

Floats = NDArray[np.float64]
ENCODER = (Output("position", 0),)


@dataclass(frozen=True)
class Noise:
    """Standard deviations: force at m1, new every tick [N m | N]; measurement [rad | m].

    Measured velocities have the position's noise over one period, as differences would.
    """

    process: float
    measurement: float

    def __post_init__(self) -> None:
        for name, value in (("process", self.process), ("measurement", self.measurement)):
            if not 0.0 < value < np.inf:
                raise ValueError(f"noise.{name} is {value:g}; it must be finite and > 0")


class RunsAway(ValueError):
    """A device diverges under a command."""


def rehearse(
    device: Device,
    command: Floats,
    noise: Noise,
    *,
    outputs: Sequence[Output] = ENCODER,
    seed: int = 0,
    name: str = "rehearsal",
) -> Experiment:
    """Return the recording that a device would give under a command (ticks,).

    Raises RunsAway if the device diverges under it.
    """
    random = np.random.default_rng(seed)
    period = device.interface.period
    run = simulate(
        device.with_interface(encoder_step=0.0),
        recorded(command),
        duration=command.size * period,
        disturbance=noise.process * random.standard_normal(command.size),
        substeps=usual_substeps(device),
    )
    if run.outcome is not Outcome.COMPLETED:
        raise RunsAway(f"the motion of {device.name} diverges with {name}: {run.outcome.value}")
    scale = [1.0 if o.quantity == "position" else 1.0 / period for o in outputs]
    sensed = [o.name == "position_m1" for o in outputs]
    seen = ["encoder" if at else o.name for at, o in zip(sensed, outputs, strict=True)]
    y = np.column_stack([run.trace[channel] for channel in seen])
    y += noise.measurement * np.array(scale) * random.standard_normal(y.shape)
    y[:, sensed] = _counted(y[:, sensed], device.interface)  # noise comes before rounding
    return Experiment(period, command, y, tuple(outputs), name, float(np.std(y[:, 0])))


def _counted(y: Floats, interface: Interface) -> Floats:
    step = interface.encoder_step
    if step == 0.0:
        return y
    if interface.encoder_rounding == "floor":
        return step * np.floor(y / step)
    return step * np.sign(y) * np.floor(np.abs(y) / step + 0.5)


def known_observer(device: Device, experiment: Experiment, noise: Noise) -> Observer:
    """Return the observer for a known noise: its gain, and the deviations of its innovations.

    The deviations hold for the linear part. An encoder's rounding counts as noise with the variance
    step^2 / 12. Raises NoObserver if there is no observer (`zwidth.diagnosis.noise.steady`).
    """
    rounding = device.interface.encoder_step**2 / 12.0
    noise = replace(noise, measurement=float(np.sqrt(noise.measurement**2 + rounding)))
    mass = float(device.plant().matrices.mass.trace())
    ratio = (noise.process * experiment.period**2 / (mass * noise.measurement)) ** 2
    found = steady(device, experiment, ratio)
    return Observer(found.gain, noise.measurement * found.scatter, ratio)


def noise_of(device: Device, experiment: Experiment, observer: Observer) -> Noise:
    """Return the noise for which an observer is optimal: the inverse of `known_observer`."""
    unit = known_observer(
        device.with_interface(encoder_step=0.0), experiment, _of_ratio(device, experiment, observer)
    )
    measurement = float(observer.deviation[0] / unit.deviation[0])
    return Noise(_of_ratio(device, experiment, observer).process * measurement, measurement)


def _of_ratio(device: Device, experiment: Experiment, observer: Observer) -> Noise:
    """The noise with the ratio of the observer, for a measurement noise of one."""
    mass = float(device.plant().matrices.mass.trace())
    return Noise(float(np.sqrt(observer.ratio)) * mass / experiment.period**2, 1.0)

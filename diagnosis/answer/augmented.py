"""The device that a fit found: what the fit used, its file says.

A fit reads a recording by a gain of the command, an origin of the position (where a spring to
ground rests) and a command that is held or smooth, takes steps off the recording and lost commands
out of it, and folds a sensor out. All that is the device's, so that `zwidth simulate` of the saved
device, under the command as it was recorded and from where it began, runs as the fit does freely.

Readings that are taken before their commands act (a negative skew) are a delay of the loop, and are
the device's too. Limits: readings that are taken after it have no place in a device, in which a
command follows from its reading; nor has by how much commands arrive early or late on average
(jitter), which is a way to read a velocity and no motion. Which commands were lost is of the
recording: a device has their rate; `scenario_of` plays those that arrived. In several recordings of
which some had smooth commands, the device says so where all did. A simulation's drive is on and at
its nominal supply at all times: a recording in which it was not is no scenario. What limits the
rate of a command lets a recording begin where it is, and a simulation at zero.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.intake.gate import Fault
from zwidth.diagnosis.model.parameters import Model, delivered
from zwidth.diagnosis.noise.predictor import observer_memory
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.scenarios.scenario import Scenario
from zwidth.sim.device import Device
from zwidth.sim.equations import equations
from zwidth.sim.physics import make_physics
from zwidth.sim.predict import alone
from zwidth.sim.run import Start

Floats = NDArray[np.float64]


def augmented(
    model: Model,
    x: Floats,
    swing: float,
    smooth: bool = False,
    folded: bool = False,
    encoder_step: float = 0.0,
    early: float = 0.0,
) -> Device:
    """Return the device of a model at x, with how it reads recordings.

    swing: rms motion, in which the origin counts. smooth: whether the commands were; folded:
    whether the sensor was folded out; encoder_step: what the samples themselves show, or 0.
    early [s]: by how much readings are taken before commands act.
    """
    device, reads, known = model.build(x), model.reads(x), model.nominal.interface
    device = device.with_interface(
        command_gain=known.command_gain * reads.gain,
        position_origin=known.position_origin + reads.origin * swing,
        command_hold="smooth" if smooth else known.command_hold,
        delay=device.interface.delay + early,
    )
    if folded:
        device = device.with_physics(make_physics("rectified_sensor", "sensor"))
    if encoder_step > 0.0:
        step = make_physics("encoder_step", "sensor", step=encoder_step)
        device = device.with_physics(step)
    return device


def free_run(model: Model, x: Floats, taken: Experiment, substeps: int) -> Floats:
    """Return what a fit predicts of a recording from its first sample on, never corrected.

    (ticks, outputs), positions as they were recorded. taken: the recording as the diagnosis takes
    it, with where it begins; substeps a tick.
    """
    device, seen = taken.on(model.acting(x)), model.seen(taken, x)
    eq = equations(device, substeps)
    none = np.zeros((eq.states, len(seen.outputs)))
    silent = np.zeros(seen.measured.shape)
    outputs = seen.places(eq)
    errors = alone(
        eq, eq, outputs, seen.command, silent, none, seen.external(eq.dof),
        observer_memory(eq, seen), seen.strengths,
    )  # fmt: skip
    positions = np.array([o.tells_position for o in seen.outputs])
    known = model.nominal.interface.position_origin
    return -errors + known * positions + model.reads(model.there(x, taken)).offsets(taken)


def scenario_of(
    device: Device, model: Model, x: Floats, recording: Experiment, taken: Experiment, substeps: int
) -> Scenario:
    """Return the scenario in which a saved device does what the fit does freely.

    recording: with the command as it was recorded, in SI; taken: as the diagnosis takes it.
    """
    eq = equations(taken.on(model.acting(x)), substeps)
    state = observer_memory(eq, model.seen(taken, x)).x
    own = eq.dof - eq.followers.shape[0]
    positions = state[:own] + _origin(model, x, taken.swing)
    start = Start(positions.tolist(), state[eq.dof : eq.dof + own].tolist())
    command = recording.command
    if taken.dropped is not None and model.has("dropped_samples"):
        command = delivered(command, taken.dropped)
        device = device.without_physics("dropped_samples")
    return Scenario(
        taken.on(device),
        recorded(command),
        recording.ticks * recording.period,
        start,
        substeps=substeps,
    )


def all_smooth(faults: Sequence[Fault], recordings: Sequence[Experiment]) -> bool:
    """Whether the commands of all recordings were found to be smooth."""
    found = [fault for fault in faults if fault.kind == "smooth_command"]
    return len(found) >= len(recordings) > 0


def _origin(model: Model, x: Floats, swing: float) -> float:
    known = model.nominal.interface.position_origin
    return known + model.reads(x).origin * swing

"""Free runs of a joint of an MJCF or URDF model in MuJoCo, over windows of a recording.

Each window begins in the state that an observer of the device has there, like the device's own free
runs, and the joint is then driven by the recorded command: through its actuator if the model has
one, else as a force on the joint. In a model of several joints that is not an export of this
device, the others are held in its zero pose. Before a window the commands of a few samples are
played, for an actuator with a delay.

Limits: of the outputs the position or velocity of m1 is compared; other joints are not driven.
"""

import math
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.answer.band import Windows
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import followed_by
from zwidth.diagnosis.noise.predictor import (
    SHORTEST_WINDOW,
    Observer,
    beginning_near,
    deviation,
    free_run_starts,
    free_runs,
)
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.export.read_joint import drives_of, input_of, joint_of
from zwidth.sim.band import Band
from zwidth.sim.device import Device

Floats = NDArray[np.float64]
EVERY = 1 << 30  # more free runs than in any recording
AHEAD = 2  # samples played before a window, in addition to the actuator's delay


def simulator_here() -> str:
    """Return the installed simulator of models with its version: "MuJoCo 4.0.0"."""
    return f"MuJoCo {version('mujoco')}"


class _Joint(NamedTuple):
    """Where in a model a joint, its actuator's input (None for none) and its masses stand."""

    position: int
    speed: int
    actuator: int | None
    masses: tuple[tuple[int, int], ...]
    held: NDArray[np.int64]
    held_speeds: NDArray[np.int64]


class ModelRuns:
    """Free runs of a joint of a model; raises ValueError as `joint_of`."""

    def __init__(self, device: Device, path: Path, joint: str) -> None:
        self.device = device
        self.mujoco, self.model, index = joint_of(path, joint)
        self.data: Any = self.mujoco.MjData(self.model)
        self.joint = _places(self.mujoco, self.model, index, device)
        steps = math.ceil(device.interface.period / float(self.model.opt.timestep) - 1e-9)
        self.model.opt.timestep = device.interface.period / steps
        self.steps = steps

    def __call__(self, e: Experiment, band: Band) -> Windows:
        """Return the free runs over a recording's windows. Raises NoObserver if none follows."""
        model, device = Model(self.device), self.device
        x = np.zeros(len(model.parameters))
        built, seen = model.acting(x), model.seen(e, x)
        gain = beginning_near(built, [seen], band.ratio)
        noise = deviation(built, [seen], gain)
        observer = Observer(gain, np.maximum(noise, np.finfo(np.float64).tiny), band.ratio)
        ticks = min(max(SHORTEST_WINDOW, round(band.window / e.period)), e.ticks)
        seen = followed_by(built, seen, observer)
        (runs,) = free_runs(built, seen, gain, [ticks], EVERY)
        starts = free_run_starts(seen, ticks)
        n = device.chain.masses.size
        outputs = [k for k, o in enumerate(e.outputs)
                   if o.mass == 0 and o.quantity in ("position", "velocity")]  # fmt: skip
        errors: list[Floats] = []
        motions: list[Floats] = []
        for first, motion in zip(starts, runs.motion, strict=True):
            state = motion[0, :n] + device.interface.position_origin, motion[0, n:]
            ran = self._run(e.command, first, ticks, state)
            measured = e.measured[first : first + ticks][:, outputs]
            told = np.stack([ran[e.outputs[k].quantity == "velocity"] for k in outputs], axis=1)
            errors.append(np.nanmean((measured - told) ** 2, axis=0))
            motions.append(np.nanvar(measured, axis=0))
        names = tuple(e.outputs[k].name for k in outputs)
        empty = np.zeros((0, len(names)))
        return Windows(
            names, np.array(errors) if errors else empty, np.array(motions) if motions else empty,
            noise[outputs],
        )  # fmt: skip

    def _run(
        self, command: Floats, first: int, ticks: int, state: tuple[Floats, Floats]
    ) -> tuple[Floats, Floats]:
        """Positions and velocities (ticks,) of the joint from a state (masses,) on."""
        mujoco, model, data, joint = self.mujoco, self.model, self.data, self.joint
        mujoco.mj_resetData(model, data)
        late = self.device.interface.delay / self.device.interface.period
        for k in range(max(0, first - math.ceil(late) - AHEAD), first):
            self._tick(float(command[k]))
        data.qpos[:], data.qvel[:] = model.qpos0, 0.0
        for (position, speed), q, v in zip(joint.masses, *state, strict=False):
            data.qpos[position], data.qvel[speed] = q, v
        positions, velocities = np.empty(ticks), np.empty(ticks)
        for k in range(ticks):
            positions[k], velocities[k] = data.qpos[joint.position], data.qvel[joint.speed]
            self._tick(float(command[first + k]))
        return positions, velocities

    def _tick(self, command: float) -> None:
        """A period of the device, the joints that are held put back after it."""
        data, joint = self.data, self.joint
        if joint.actuator is None:
            data.qfrc_applied[joint.speed] = command * self.device.interface.command_gain
        else:
            data.ctrl[joint.actuator] = command
        self.mujoco.mj_step(self.model, data, nstep=self.steps)
        data.qpos[joint.held] = self.model.qpos0[joint.held]
        data.qvel[joint.held_speeds] = 0.0


def _places(mujoco: Any, model: Any, index: int, device: Device) -> _Joint:
    names = [model.joint(i).name for i in range(model.njnt)]
    masses = [f"m{i + 1}" for i in range(device.chain.masses.size)]
    exported = names[index] == "m1" and len(masses) > 1 and set(masses) <= set(names)
    own = [names.index(name) for name in masses] if exported else [index]
    at = [(int(model.jnt_qposadr[i]), int(model.jnt_dofadr[i])) for i in own]
    held = [] if exported else [i for i in range(model.njnt) if i != index]
    driving = [input_of(model, i) for i in drives_of(mujoco, model, index)]
    positions = np.ones(model.nq, dtype=np.bool_)
    speeds = np.ones(model.nv, dtype=np.bool_)
    for position, speed in at:
        positions[position], speeds[speed] = False, False
    if not held:
        positions[:], speeds[:] = False, False
    return _Joint(
        *at[0], driving[0] if len(driving) == 1 else None, tuple(at),
        np.flatnonzero(positions), np.flatnonzero(speeds),
    )  # fmt: skip

"""A machine moved by MuJoCo, an engine of other people, and recorded as other rigs are.

The model is the one that `zwidth export --to mjcf` writes: links are tendons, dry friction is
`frictionloss`, a soft constraint; a friction curve, bristles and cogging are passive `dcmotor`s;
play is a tendon's dead band, in which a damper of the tendon would go on acting, so that only an
undamped link has it: half of the machines have such links. The state of a lag is held over a step
of at most 0.1 ms, so that its force is half a step late.
"""

from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np

from zwidth.exam.filming import Floats, Scene, counted, recorded, streams
from zwidth.exam.machines import Machine, draw_machine
from zwidth.exam.stages import Engine
from zwidth.exam.strata import MUJOCO
from zwidth.export.mjcf import mjcf
from zwidth.scenarios.concealed.integrator import Run
from zwidth.scenarios.concealed.rig import Made, RunAway
from zwidth.scenarios.concealed.truth import truth_of
from zwidth.sim.device import Device

EFFECTS = (
    "coulomb_friction", "stribeck_friction", "presliding_friction", "quadratic_drag",
    "constant_force", "gravity_pendulum", "force_ripple", "backlash", "cubic_stiffness",
    "ground_spring", "extra_mode", "actuator_lag", "saturation", "loop_delay",
)  # fmt: skip
BY_THE_RIG = "the encoder's step"  # sentences of the export on what is made here
STIFFER = "before it slips it gives by"  # of bristles that are as stiff as a step allows
UNDAMPED_SHARE = 0.5
FARTHEST = 1e6  # of positions and rates


def whole(device: Device) -> bool:
    """Whether MuJoCo's model of a device has everything that the device has."""
    lost = mjcf(device, "rig").lost
    return all(any(so in said for so in (BY_THE_RIG, STIFFER)) for said in lost)


def machine_for_mujoco(random: np.random.Generator) -> Machine:
    """Return a machine, half of them with links that nothing damps."""
    machine = draw_machine(random)
    if random.random() < UNDAMPED_SHARE:
        chain = machine.device.chain
        still = chain._replace(link_dampers=np.zeros_like(chain.link_dampers))
        return replace(machine, device=replace(machine.device, chain=still))
    return machine


def _unsaid(_: str) -> None:
    """Hear a warning of MuJoCo."""


def film_by_mujoco(scene: Scene) -> Made:
    """Return the recording of a scene, with this project's own integrator as its run.

    Raises RunAway if the machine leaves all bounds, ImportError without MuJoCo.
    """
    mujoco: Any = import_module("mujoco")
    device, playing, camera = scene.device, scene.playing, scene.camera
    period, ticks = device.interface.period, playing.wanted.size
    _, process, reading, *others = streams(scene)
    force = camera.process * process.standard_normal(ticks)
    noise = camera.reading * reading.standard_normal(ticks)
    model = mujoco.MjModel.from_xml_string(mjcf(device, "rig").body)
    # What diverges is refused below: it must not begin anew at rest, nor be told of in a file.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    mujoco.set_mju_user_warning(_unsaid)
    data = mujoco.MjData(model)
    steps = round(period / float(model.opt.timestep))
    n = device.chain.masses.size
    places = [int(model.joint(f"m{i + 1}").qposadr[0]) for i in range(n)]
    first = int(model.joint("m1").dofadr[0])
    stiffness, damping, weight = playing.feedback
    commands, y, states = np.empty(ticks), np.empty(ticks), np.empty((ticks, 2 * n))
    speed, before = 0.0, 0.0
    for k in range(ticks):
        states[k, :n], states[k, n:] = data.qpos[places], data.qvel[places]
        if not np.abs(states[k]).max() < FARTHEST:
            raise RunAway("the motion in MuJoCo diverges; conceal something weaker")
        y[k] = counted(states[k, :1] + noise[k], device.interface.encoder_step)[0]
        rate = (y[k] - before) / period if k else 0.0
        speed, before = weight * rate + (1.0 - weight) * speed, y[k]
        commands[k] = playing.wanted[k] - stiffness * y[k] - damping * speed
        data.ctrl[0] = commands[k]
        data.qfrc_applied[first] = force[k]
        mujoco.mj_step(model, data, nstep=steps)
    still, none = np.zeros(ticks), np.zeros(ticks, dtype=np.bool_)
    run = Run(truth_of(device, steps), period, steps, commands, still, none, force)

    def read(_: bool, mass: int) -> Floats | None:
        return None if mass == 0 else states[:, mass]

    return Made(recorded(scene, commands, y, read, others), states, none, run)


BY_MUJOCO = Engine(MUJOCO, 19, machine_for_mujoco, film_by_mujoco, frozenset(EFFECTS), whole)

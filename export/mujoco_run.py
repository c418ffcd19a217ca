"""An exported model in MuJoCo, driven by a command."""

import math
from importlib import import_module
from typing import Any

import numpy as np

from zwidth.export.model import Floats

FINE_STEP = 2e-5  # [s], if the format has no step


def engine() -> Any:
    """Return the module mujoco; None if it is not installed."""
    try:
        return import_module("mujoco")
    except ImportError:
        return None


def run_mjcf(text: str, commands: Floats, period: float) -> Floats:
    """Return an MJCF export's encoder readings under commands (ticks,), one per period [s].

    Raises ImportError without MuJoCo, ValueError for a text that it refuses.
    """
    mujoco = import_module("mujoco")
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)

    def command_is(value: float) -> None:
        data.ctrl[0] = value

    return _driven(mujoco, model, data, command_is, commands, period)


def run_urdf(text: str, commands: Floats, period: float, limit: float) -> Floats:
    """Return the same for a URDF export, its joint driven by the command up to the effort limit.

    Gravity is off, and dry friction is as stiff as in `zwidth.export.mjcf`.
    """
    mujoco = import_module("mujoco")
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep = period / math.ceil(period / FINE_STEP)
    model.opt.gravity[:] = 0.0
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.dof_solref[:] = (2.0 * model.opt.timestep, 1.0)
    model.dof_solimp[:, :3] = (0.9999, 0.9999, 1e-3)
    data = mujoco.MjData(model)

    def command_is(value: float) -> None:
        data.qfrc_applied[0] = min(max(value, -limit), limit)

    return _driven(mujoco, model, data, command_is, commands, period)


def _driven(
    mujoco: Any, model: Any, data: Any, command_is: Any, commands: Floats, period: float
) -> Floats:
    address = int(model.joint("m1").qposadr[0])
    steps = round(period / model.opt.timestep)
    positions = np.empty(commands.size)
    for k, command in enumerate(commands.tolist()):
        positions[k] = data.qpos[address]
        command_is(command)
        mujoco.mj_step(model, data, nstep=steps)
    return positions

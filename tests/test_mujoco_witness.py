"""MuJoCo, another engine by other people, on the same chain: springs, dampers, limits, friction.

Three sliding bodies, links as fixed tendons with stiffness and damping, the command held over each
tick by a motor with a control range. Without friction MuJoCo integrates by RK4. Its dry friction is
a soft constraint: a held mass creeps at a speed of about (1 - d) / d times the free one's, d the
impedance, and slides under slightly less than the level. With d = 0.9999 and steps of 10 us that,
and its first order in time with friction, leave the differences that the tolerances state.
"""

from typing import Any

import numpy as np
import pytest
from engine_examples import Floats, coulomb, scaled_error

from zwidth.controllers.recorded import recorded
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics.effect import Physics
from zwidth.sim.run import Start, simulate

mujoco: Any = pytest.importorskip("mujoco", reason="MuJoCo is not installed (pip install mujoco)")

MASSES, DAMPERS = (2e-4, 9e-4, 7e-5), (2e-3, 4e-3, 1e-3)
SPRINGS, LINK_DAMPERS = (217.0, 14.6), (0.06, 1.4e-3)
GROUND_SPRING = 1.5
T, TICKS = 1e-3, 300
START = (2e-3, -1e-3, 4e-3)


def device(limit: float, *physics: Physics) -> Device:
    """Return the chain in zwidth."""
    chain = make_chain(MASSES, DAMPERS, GROUND_SPRING, SPRINGS, LINK_DAMPERS)
    return Device("chain", "-", False, chain, Interface(command_limit=limit), physics)


def commands() -> Floats:
    """Return a swing of the command of up to 0.15 N that ends in a rest."""
    t = np.arange(TICKS) * T
    return 0.15 * np.sin(2.0 * np.pi * 11.0 * t) * np.maximum(0.0, 1.0 - t / 0.2)


def model(limit: float, levels: dict[int, float], step: float) -> Any:
    """Return the chain in MuJoCo."""
    bodies = "".join(
        f'<body><joint name="q{i}" type="slide" axis="1 0 0" damping="{DAMPERS[i]}"'
        f' stiffness="{GROUND_SPRING if i == 0 else 0.0}" frictionloss="{levels.get(i, 0.0)}"'
        f' solreffriction="{2.0 * step} 1" solimpfriction="0.9999 0.9999 1e-3"/>'
        f'<inertial pos="0 0 0" mass="{MASSES[i]}" diaginertia="1 1 1"/></body>'
        for i in range(3)
    )
    links = "".join(
        f'<fixed stiffness="{SPRINGS[i]}" damping="{LINK_DAMPERS[i]}" springlength="0">'
        f'<joint joint="q{i}" coef="-1"/><joint joint="q{i + 1}" coef="1"/></fixed>'
        for i in range(2)
    )
    integrator = "implicitfast" if levels else "RK4"
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{step}" integrator="{integrator}" gravity="0 0 0"'
        f' tolerance="1e-14" iterations="200"><flag contact="disable"/></option>'
        f"<worldbody>{bodies}</worldbody><tendon>{links}</tendon>"
        f'<actuator><motor joint="q0" ctrllimited="true" ctrlrange="{-limit} {limit}"/></actuator>'
        "</mujoco>"
    )


def witness(limit: float, levels: dict[int, float], step: float) -> Floats:
    """Return MuJoCo's positions at the ticks, (TICKS, 3)."""
    chain = model(limit, levels, step)
    data = mujoco.MjData(chain)
    data.qpos[:] = START
    positions = np.empty((TICKS, 3))
    for k, command in enumerate(commands()):
        positions[k] = data.qpos
        data.ctrl[0] = command
        mujoco.mj_step(chain, data, nstep=round(T / step))
    return positions


def ours(limit: float, *physics: Physics, substeps: int = 1) -> Floats:
    """Return our positions at the ticks."""
    run = simulate(
        device(limit, *physics), recorded(commands()), duration=TICKS * T,
        start=Start(START), substeps=substeps,
    )  # fmt: skip
    return np.column_stack([run.trace[f"position_m{i}"] for i in (1, 2, 3)])


def test_springs_dampers_and_limit() -> None:
    """To 1e-9 of the range: RK4 at 20 us against our exact step of 1 ms; the limit cuts a third.

    Mutations: a link damper left out of `sim.chain.matrices`; the limit at 0.1001.
    """
    assert np.abs(commands()).max() > 0.1
    assert scaled_error(ours(0.1), witness(0.1, {}, 2e-5)) < 1e-9


@pytest.mark.parametrize("levels", [{0: 0.02}, {0: 0.02, 2: 0.004}])
def test_dry_friction(levels: dict[int, float]) -> None:
    """To 0.25 % of the range, at m1 and at m1 and m3; half the step halves the difference.

    Mutation: friction at 0.97 of its level.
    """
    physics = [coulomb(level, f"m{i + 1}") for i, level in levels.items()]
    exact = ours(0.1, *physics, substeps=200)
    coarse, fine = (scaled_error(exact, witness(0.1, levels, step)) for step in (2e-5, 1e-5))
    assert fine < 0.0025
    assert 0.4 * coarse < fine < 0.6 * coarse
    assert scaled_error(exact, ours(0.1)) > 0.2  # friction matters here

"""Devices on which the engine's truths are stated."""

import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.run import Run

Floats = NDArray[np.float64]
ROOT = Path(__file__).parents[1]


def uncompiled(code: str) -> str:
    """Return what Python code prints in a process of its own, with numba switched off."""
    environment = os.environ | {
        "NUMBA_DISABLE_JIT": "1",
        "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}",
    }
    plain = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        env=environment, capture_output=True, text=True, check=False, cwd=ROOT,
    )  # fmt: skip
    assert plain.returncode == 0, plain.stderr[-2000:]
    return plain.stdout


@cache
def phantom() -> Device:
    """Return the device of Table I: three masses, a delay of 2 ms."""
    return load_device("phantom_1_0")


def one_mass(
    mass: float, damping: float, ground_spring: float = 0.0, *physics: Physics, **interface: Any
) -> Device:
    """Return a single mass, T = 1 ms unless the interface says otherwise."""
    chain = make_chain([mass], [damping], ground_spring)
    return Device("one mass", "-", True, chain, Interface(**interface), physics)


def coulomb(level: float, at: str = "m1") -> Physics:
    """Return Coulomb friction."""
    return make_physics("coulomb_friction", at, level=level)


def states(run: Run, dof: int) -> Floats:
    """Return the recorded states (samples, 2 dof): positions, then velocities."""
    names = [f"{quantity}_m{i + 1}" for quantity in ("position", "velocity") for i in range(dof)]
    return np.column_stack([run.trace[name] for name in names])


def scaled_error(found: Floats, truth: Floats) -> float:
    """Return the largest error of any column over that column's largest value."""
    return float(np.max(np.abs(found - truth).max(axis=0) / np.abs(truth).max(axis=0)))

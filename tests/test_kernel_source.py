"""The compiled loops equal the same source, uncompiled, bit for bit.

The source runs in a process of its own with numba switched off; both print a fingerprint of every
bit of every state. Effects of `sim/physics` are covered by `test_physics_source.py`; here are the
paths of the loop itself.
"""

import hashlib
import json

import numpy as np
from engine_examples import Floats, coulomb, one_mass, phantom, uncompiled
from estimator_examples import SET

from zwidth.controllers.wall import wall
from zwidth.sim.device import Device
from zwidth.sim.equations import equations
from zwidth.sim.kernel import scratch
from zwidth.sim.law import Law
from zwidth.sim.physics import make_physics
from zwidth.sim.predict import GROUND, Outputs, alone
from zwidth.sim.run import Start, simulate, start_memory
from zwidth.sim.wall_law import MEMORY
from zwidth.sim.windows import MEASURES, Bank, Kept, run_windows

LAWS = (
    Law(),
    Law("texture", 3e-4, 0.4),
    Law("region", width=2e-4),
    Law("guarded", most_damping=0.05),
)


def _hash(*arrays: Floats) -> str:
    """Fingerprint of arrays; the sign of a zero is no difference."""
    digest = hashlib.sha256()
    for array in arrays:
        digest.update((np.asarray(array) + 0.0).tobytes())
    return digest.hexdigest()


def _windows(device: Device, law: Law = LAWS[0]) -> list[Floats]:
    """Return measures and state of one run under a wall, two windows of eight ticks."""
    eq = equations(device, 1)
    memory = start_memory(eq, Start(1e-4, 0.02))
    bank = Bank(
        *(a[None] for a in (memory.x, memory.line, memory.internal, memory.scalars)),
        walls=np.array([[20.0, 0.03, 1e-5, 1.0, *law.numbers]]), past=np.full((1, 3), 0.02),
        bounds=np.full(1, np.inf), escaped=np.zeros(1), controller=np.zeros((1, MEMORY)),
        counters=memory.counters, law=law.code,
    )  # fmt: skip
    kept = Kept(np.zeros((2, MEASURES, 1)), np.zeros((16, 1)))
    run_windows(eq, scratch(eq), bank, np.linspace(0.1, 1.0, 8), kept)
    return [kept.measures, kept.velocities, bank.x, bank.line]


def _predicted(device: Device) -> Floats:
    """Return the innovations of 24 ticks."""
    rng = np.random.default_rng(4)
    eq, fine = equations(device, 1), equations(device, 3)
    outputs = Outputs(
        np.array([0, 4]), np.array([True, False]), np.array([GROUND, GROUND]), np.zeros(2)
    )
    gain = 0.1 * rng.normal(size=(eq.states, 2))
    return alone(
        eq, fine, outputs, 0.05 * rng.normal(size=24), 1e-3 * rng.normal(size=(24, 2)), gain,
        np.zeros((0, eq.dof)), start_memory(eq, Start(1e-4, 0.02)),
    )  # fmt: skip


def fingerprints() -> dict[str, str]:
    """Return a fingerprint of a short run for every path of the loops."""
    stepped = {
        "delay": 0.0023,
        "encoder_step": 2e-6,
        "command_step": 3e-4,
        "command_limit": 0.02,
        "velocity_cutoff_hz": 80.0,
    }
    lag = make_physics("actuator_lag", "command", time_constant=4e-4)
    cubic = make_physics("cubic_stiffness", "link12", coefficient=1e5)
    drag = make_physics("quadratic_drag", "m2", coefficient=1e-2)
    dry = (coulomb(2e-3), coulomb(1e-3, "m2"))
    devices = {
        "linear": (phantom(), 1),
        "linear, one mass, floor": (
            one_mass(1e-3, 2e-3, encoder_step=1e-6, encoder_rounding="floor"), 1,
        ),
        "steps, filter, fractional delay": (phantom().with_interface(**stepped), 2),
        "several rates": (
            phantom().with_interface(
                velocity_ticks=3, position_ticks=2, velocity_cutoff_hz=90.0, velocity_order=2,
            ),
            1,
        ),
        **{f"estimator {n}": (phantom().with_interface(**s), 1) for n, s in SET.items()},
        "force sensor": (
            phantom().with_interface(force_sensor="link23", force_gain=0.5, delay=0.0), 1,
        ),
        "lag": (phantom().with_physics(lag), 1),
        "friction": (phantom().with_interface(delay=0.0013).with_physics(*dry), 3),
        "smooth": (phantom().with_physics(cubic, drag), 2),
        "all": (phantom().with_interface(**stepped).with_physics(lag, *dry, cubic, drag), 2),
    }  # fmt: skip
    found: dict[str, str] = {}
    for name, (device, substeps) in devices.items():
        forces = 0.01 * np.random.default_rng(1).normal(size=(25, device.chain.masses.size))
        for ledger in (False, True):
            run = simulate(
                device, wall(12.0, 0.03, 1e-5, one_sided=True), duration=0.025,
                start=Start(1e-4, 0.02), disturbance=forces if ledger else None,
                substeps=substeps, ledger=ledger, fine=True,
            )  # fmt: skip
            assert run.fine is not None
            rows = (*run.trace.channels.values(), *run.fine.channels.values())
            found[f"{name}, ledger {ledger}"] = _hash(*rows)
    for name, device in {
        "windows": phantom().with_interface(delay=0.0023),
        "windows, steps": phantom().with_interface(**stepped),
        "windows, friction": phantom().with_physics(coulomb(2e-3)),
        **{f"windows, estimator {n}": phantom().with_interface(**s) for n, s in SET.items()},
    }.items():
        found[name] = _hash(*_windows(device))
        for law in LAWS[1:]:
            found[f"{name}, {law.kind}"] = _hash(*_windows(device, law))
        found[name.replace("windows", "predicted")] = _hash(_predicted(device))
    return found


def test_compiled_loops_equal_their_source() -> None:
    """Mutations: fastmath in `sim/jit.py`; a sum in `propagate` written as `np.dot`."""
    code = "import json, test_kernel_source as t; print(json.dumps(t.fingerprints()))"
    assert json.loads(uncompiled(code)) == fingerprints()

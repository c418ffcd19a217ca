"""The compiled loops equal the same source, uncompiled, bit for bit.

The source runs in a process of its own with numba switched off; both print a fingerprint of every
bit of every state. Effects of `sim/physics` are covered by `test_physics_source.py`; here are the
paths of the loop itself.
"""

import hashlib
import json

import numpy as np
from engine_examples import Floats, coulomb, one_mass, phantom, uncompiled

from zwidth.controllers.wall import wall
from zwidth.sim.ensemble import LaneRuns, advance_runs, start_runs, walls
from zwidth.sim.equations import equations
from zwidth.sim.physics import make_physics
from zwidth.sim.run import Start, simulate


def _hash(*arrays: Floats) -> str:
    """Fingerprint of arrays; the sign of a zero is no difference."""
    digest = hashlib.sha256()
    for array in arrays:
        digest.update((np.asarray(array) + 0.0).tobytes())
    return digest.hexdigest()


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
        "lanes": phantom().with_interface(delay=0.0023),
        "lanes, steps": phantom().with_interface(**stepped),
        "lanes, friction": phantom().with_physics(coulomb(2e-3)),
    }.items():
        some = walls(np.linspace(1.0, 40.0, 5), 0.03, 1e-5, one_sided=True)
        runs = start_runs(equations(device, 1), wall(1.0, 0.0), some, [Start(1e-4, 0.02)])
        assert isinstance(runs, LaneRuns)
        measures, after = advance_runs(runs, np.linspace(0.1, 1.0, 8), 2)
        assert isinstance(after, LaneRuns)
        found[name] = _hash(measures, after.bank, after.line)
    return found


def test_compiled_loops_equal_their_source() -> None:
    """Mutations: fastmath in `sim/jit.py`; a sum in `propagate` written as `np.dot`."""
    code = "import json, test_kernel_source as t; print(json.dumps(t.fingerprints()))"
    assert json.loads(uncompiled(code)) == fingerprints()

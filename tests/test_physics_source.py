"""The compiled kernel with every effect on equals the same source, uncompiled, bit for bit."""

import numpy as np
from engine_examples import uncompiled
from physics_examples import EVERYWHERE, example, phantom

from zwidth.controllers.wall import wall
from zwidth.sim.physics import EFFECTS
from zwidth.sim.physics.effect import Physics
from zwidth.sim.run import Start, simulate

FILTERS = [entry for entry in EVERYWHERE if EFFECTS[entry[0]].follows]  # there is room for one
SIGHTED = [e for e in EVERYWHERE if e[0] != "rectified_sensor" and e not in FILTERS[1:]]


def bits() -> str:
    """Return a fingerprint of a run with everything on but what blinds it."""
    physics: list[Physics] = [example(*entry) for entry in SIGHTED]
    device = phantom().with_physics(*physics)
    run = simulate(
        device, wall(12.0, 0.02, one_sided=True), duration=0.012, start=Start(-2e-4, 0.3),
        substeps=4, ledger=True, fine=True, seed=7,
    )  # fmt: skip
    assert run.fine is not None
    traces = (run.trace, run.fine)
    return "".join(np.array(list(trace.channels.values())).tobytes().hex() for trace in traces)


def test_the_compiled_run_equals_its_source_with_every_effect_on() -> None:
    """Mutation: fastmath in `sim/jit.py`."""
    code = "import test_physics_source as t; print(t.bits())"
    assert uncompiled(code).strip() == bits()

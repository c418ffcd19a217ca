"""A run of a device under a controller, or of a whole scenario."""

import numpy as np
from numpy.typing import NDArray

from zwidth.api.given import AnyDevice, device_of
from zwidth.controllers.none import none
from zwidth.scenarios.scenario import Scenario, usual_substeps
from zwidth.sim import run
from zwidth.sim.controller import Controller
from zwidth.sim.run import Run, Start
from zwidth.stability.judging import Trial


def simulate(
    device: AnyDevice | Scenario,
    controller: Controller | None = None,
    *,
    duration: float | None = None,
    start: Start | None = None,
    disturbance: NDArray[np.float64] | None = None,
    substeps: int | None = None,
    seed: int = 0,
    bound: float = 1e6,
    energy: bool = False,
    ledger: bool = False,
    fine: bool = False,
) -> Run:
    """Run a device under a controller, or run a Scenario.

    device: a Device, the name of a shipped one, a device file; or a Scenario, which contains all
    other settings. controller: made by `wall`, `texture`, `region`, `guarded`, `recorded` or
    `none`, or your own; None for none. duration [s]: by default that of a recorded command, else 4
    s. start: by default at rest; with a wall, displaced by 1e-3 [rad | m], since otherwise nothing
    moves. disturbance: forces [N m | N], shape (ticks,) on m1 or (ticks, masses), each held for a
    tick. substeps: per tick, by default one if that is exact, else as many as friction and smooth
    forces need. seed: of random events (lost samples). bound: the run stops when |position of m1|
    exceeds it. energy: record the stored energy; ledger: record also the work of motor, wall, each
    damper and effect. fine: keep the states after every substep.

    Raises ValueError with one sentence for a bad argument.
    """
    if isinstance(device, Scenario):
        return _as_described(device, controller, duration, start, disturbance, substeps)
    device = device_of(device)
    law = none() if controller is None else controller
    if start is None:
        still = law.kind in ("wall", "texture", "region", "guarded") and disturbance is None
        start = Start(Trial().start if still else 0.0)
    if duration is None:
        ticks = law.parameters.size if law.kind == "recorded" else 0
        duration = ticks * device.interface.period or Trial().seconds
    return run.simulate(
        device,
        law,
        duration=duration,
        start=start,
        disturbance=disturbance,
        substeps=usual_substeps(device) if substeps is None else substeps,
        seed=seed,
        bound=bound,
        energy=energy,
        ledger=ledger,
        fine=fine,
    )


def _as_described(scenario: Scenario, *more: object) -> Run:
    if any(value is not None for value in more):
        raise ValueError(
            "a scenario contains every setting of its run; give it alone, or change it with"
            " dataclasses.replace"
        )
    return run.simulate(
        scenario.device,
        scenario.controller,
        duration=scenario.duration,
        start=scenario.start,
        disturbance=scenario.forces(),
        substeps=scenario.substeps,
        seed=scenario.seed,
        bound=scenario.bound,
        energy=scenario.energy != "none",
        ledger=scenario.energy == "ledger",
        fine=scenario.fine,
    )

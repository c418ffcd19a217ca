"""The Z-width over one setting of the interface."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from zwidth.api.given import AnyDevice, device_of
from zwidth.api.notebook import telling
from zwidth.scenarios.scenario import usual_substeps
from zwidth.stability import sweep as sweeping
from zwidth.stability.bisection import Search
from zwidth.stability.judging import Trial
from zwidth.stability.sweep import DAMPINGS, ROUNDS, TOLERANCE, Setting, Sweep


def sweep(
    device: AnyDevice,
    setting: Setting = "cutoff",
    values: Sequence[float] | NDArray[np.float64] | None = None,
    *,
    dampings: int = DAMPINGS,
    rounds: int = ROUNDS,
    trial: Trial | None = None,
    search: Search | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Sweep:
    """Find the Z-width, the area of stable walls, over a setting of the interface, and the best.

    device: a Device, the name of a shipped one, or a device file. setting: cutoff (of the velocity
    filter, Hz), period, delay [s], encoder_step [rad | m], velocity_ticks or position_ticks.
    values: by default its usual range; the device's own value is always tried too. dampings: number
    in each boundary. rounds: of refinement around the best. trial, search: how a wall is judged,
    and how finely K is searched. progress is called with the number of boundaries done and planned;
    without it, a notebook shows these. `result.best.device` is the device at the best value.

    Raises ValueError with a sentence that says what to change.
    """
    device = device_of(device)
    trial = Trial(substeps=usual_substeps(device)) if trial is None else trial
    with telling(None, "finding the widest Z-width") as tell:

        def told(done: int, planned: int) -> None:
            tell(f"{100.0 * done / planned:.0f} %, {done} of {planned} boundaries")

        return sweeping.sweep(
            device, setting, values, dampings=dampings, rounds=rounds, trial=trial,
            search=search or Search(tolerance=TOLERANCE), progress=progress or told,
        )  # fmt: skip

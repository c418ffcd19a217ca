"""The stiffest stable wall over damping."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from zwidth.api.given import AnyDevice, device_of
from zwidth.api.notebook import shares, telling
from zwidth.stability.bisection import Search
from zwidth.stability.boundary import Boundary, default_dampings, find_boundaries
from zwidth.stability.judging import Trial, usual_trial


def boundary(
    device: AnyDevice,
    dampings: Sequence[float] | NDArray[np.float64] | None = None,
    trial: Trial | None = None,
    search: Search | None = None,
    progress: Callable[[float], None] | None = None,
) -> Boundary:
    """Find the stability boundary of a device under a sampled virtual wall.

    device: a Device, the name of a shipped one, or a device file. dampings: B [N m s/rad | N s/m],
    by default from 0 to 1.2 times the last with a stable wall, in 41 steps. trial, search: how a
    wall is judged (by default as in `zwidth boundary`), and how finely K is searched. progress is
    called with the share done; without it, a notebook shows the progress.

    The boundary is found by linear theory and by simulation, at the device's own delay;
    `device.with_interface(delay=0.004)` is the same device with another delay. Raises ValueError
    with a sentence that says what to change.
    """
    device = device_of(device)
    grid = default_dampings(device) if dampings is None else np.asarray(dampings, dtype=np.float64)
    if grid.ndim != 1 or grid.size == 0:
        raise ValueError(f"dampings have shape {grid.shape}; give one row of at least one value")
    trial = usual_trial(device) if trial is None else trial
    with telling(None, "finding the boundary") as tell:
        found = find_boundaries(
            [device], [grid], trial, search or Search(), progress or shares(tell)
        )
    return found[0]

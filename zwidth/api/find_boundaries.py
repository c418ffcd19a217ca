"""Boundaries of several devices, over dampings that the caller chooses."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from zwidth.api.given import AnyDevice, device_of
from zwidth.api.notebook import shares, telling
from zwidth.stability import boundary
from zwidth.stability.bisection import Search
from zwidth.stability.boundary import Boundary
from zwidth.stability.judging import Trial


def find_boundaries(
    devices: Sequence[AnyDevice],
    dampings: Sequence[Sequence[float] | NDArray[np.float64]],
    trial: Trial = Trial(),
    search: Search = Search(),
    progress: Callable[[float], None] | None = None,
) -> list[Boundary]:
    """Return the boundary of each device over its dampings.

    devices: each a Device, the name of a shipped one, or a device file. dampings: for each of them
    a row of B [N m s/rad | N s/m]. trial, search: how a wall is judged, and how finely K is
    searched. progress is called with the share done; without it, a notebook shows the progress.

    Raises ValueError with a sentence that says what to change.
    """
    known = [device_of(device) for device in devices]
    rows = [np.asarray(row, dtype=np.float64) for row in dampings]
    with telling(None, "finding the boundaries") as tell:
        return boundary.find_boundaries(known, rows, trial, search, progress or shares(tell))

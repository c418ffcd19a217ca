"""The relay experiment on a device."""

from collections.abc import Callable, Sequence

import numpy as np

from zwidth.api.given import AnyDevice, device_of
from zwidth.api.notebook import counted, telling
from zwidth.identification.cycles import RelayReadings, relay_conditions
from zwidth.identification.relay import RelayTest
from zwidth.scenarios.scenario import usual_substeps
from zwidth.sim.device import Device
from zwidth.stability.linear import last_stable_damping, stand_in

CONDITIONS = 4  # default number of dampings


def relay(
    device: AnyDevice,
    dampings: float | Sequence[float] | None = None,
    *,
    starts: int = 60,
    seed: int = 0,
    test: RelayTest | None = None,
    progress: Callable[[], None] | None = None,
) -> RelayReadings:
    """Find critical stiffness and ultimate frequency by a relay in the loop.

    device: a Device, the name of a shipped one, or a device file. dampings: B [N m s/rad | N s/m],
    one or several; by default four from 0 to three quarters of the last with a stable wall. starts:
    number of random starts for each damping, to find all limit cycles; seed: of the random starts.
    test: force of the relay, and length of a run. progress is called after each damping; without
    it, a notebook shows the share done.

    Raises ValueError with a sentence that says what to change.
    """
    device = device_of(device)
    values = _usual(device) if dampings is None else np.atleast_1d(dampings).tolist()
    test = RelayTest(substeps=usual_substeps(device)) if test is None else test
    with telling(None, "running the relay experiment") as tell:
        each = progress or counted(tell, len(values))
        found = relay_conditions([device] * len(values), values, starts, seed, test, each)
    return RelayReadings(device, test, tuple(found))


def _usual(device: Device) -> list[float]:
    last = last_stable_damping(stand_in(device)) or 0.0
    return np.linspace(0.0, last, CONDITIONS, endpoint=False).tolist()

"""Events of a run, detected in its trace: contact, command limit, sticking, the end.

The time of an event is the first tick in the new state; the initial state of a run is not an event.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from zwidth.logs.events import Event
from zwidth.sim.device import Device
from zwidth.sim.run import Outcome
from zwidth.sim.trace import Trace

Flags = NDArray[np.bool_]

ENDINGS = {Outcome.ESCAPED: "escaped", Outcome.NOT_FINITE: "not_finite"}


class EventFinder:
    """Finds the events of a run block by block.

    Kinds, with place and value: contact_made, contact_broken (wall, encoder reading);
    limit_reached, limit_left (command, the command); stuck, slipping (a mass with friction, its
    position); escaped, not_finite (m1, its position).
    """

    def __init__(self, device: Device) -> None:
        self.limit = device.interface.command_limit
        places = (p.at for p in device.physics if p.effect.hook == "friction")
        self.dry = sorted(set(places))
        self._before: dict[str, bool] = {}

    def block(self, trace: Trace) -> list[Event]:
        """Return the events of the next block, in the order of their times."""
        found = [*self._changes(trace, trace["contact"] != 0.0, "contact_broken", "contact_made")]
        if np.isfinite(self.limit):
            limited = np.abs(trace["command"]) >= self.limit
            found += self._changes(trace, limited, "limit_left", "limit_reached", "command")
        masks = trace["at_rest"].astype(np.int64)
        for place in self.dry:
            rests = (masks >> (int(place[1:]) - 1) & 1).astype(np.bool_)
            found += self._changes(trace, rests, "slipping", "stuck", place)
        return sorted(found, key=lambda event: event.t)

    def _changes(
        self, trace: Trace, state: Flags, ends: str, begins: str, place: str = "wall"
    ) -> Iterator[Event]:
        if state.size == 0:
            return
        before = np.concatenate([[self._before.get(place, bool(state[0]))], state[:-1]])
        self._before[place] = bool(state[-1])
        channel = {"wall": "encoder", "command": "command"}.get(place, f"position_{place}")
        for tick in np.flatnonzero(state != before).tolist():
            kind = begins if state[tick] else ends
            yield Event(float(trace.t[tick]), kind, place, float(trace[channel][tick]))


def ending(outcome: Outcome, trace: Trace) -> list[Event]:
    """Return the event with which a run stopped early, if it did."""
    if outcome not in ENDINGS or len(trace) == 0:
        return []
    return [Event(float(trace.t[-1]), ENDINGS[outcome], "m1", float(trace["position_m1"][-1]))]

"""A picture of a plane that waits to be shown."""

from typing import NamedTuple

from zwidth.explore.view import OF_THE_PLANE, View, differ
from zwidth.stability.fate_map import FateMap


class Drawn(NamedTuple):
    """A map of a view as far as it was computed after so many seconds."""

    view: View
    result: FateMap
    middle: bool
    finished: bool
    seconds: float

    def older_than(self, other: "Drawn | None") -> bool:
        """Whether other is the same plane, further on: what waits to be shown keeps no order."""
        if other is None or differ(self.view, other.view, OF_THE_PLANE):
            return False
        return self.seconds < other.seconds

"""A picture of a plane that waits to be shown."""

from typing import NamedTuple

from zwidth.stability.fate_map import FateMap


class Drawn(NamedTuple):
    """The state of a map while it is computed.

    request: number of the page's request that asked for it; seconds: computed for so long.
    """

    request: int
    result: FateMap
    middle: bool
    finished: bool
    seconds: float

    def older_than(self, other: "Drawn | None") -> bool:
        """Whether other answers the same request, further on: what waits to be shown has no order.

        Of the same request, not of the same view: who moves a slider and back asks anew, and what
        was seen of the first time must not hide what comes now.
        """
        return other is not None and self.request == other.request and self.seconds < other.seconds

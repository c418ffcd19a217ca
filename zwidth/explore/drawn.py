"""A picture of a plane that waits to be shown."""

from typing import NamedTuple

from zwidth.stability.fate_map import FateMap


class Drawn(NamedTuple):
    """The state of a map while it is computed.

    request: number of the page's request for it; seconds: time computed so far.
    """

    request: int
    result: FateMap
    middle: bool
    finished: bool
    seconds: float

    def older_than(self, other: "Drawn | None") -> bool:
        """Whether `other` is a more complete answer to the same request; they arrive in any order.

        The request counts, not the view: moving a slider and back is a new request, and pictures of
        the first one must not hide those of the second.
        """
        return other is not None and self.request == other.request and self.seconds < other.seconds

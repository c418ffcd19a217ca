"""A map of the outcome of runs over two quantities."""

from collections.abc import Callable
from pathlib import Path

from zwidth.api.given import AnyDevice, device_of
from zwidth.api.notebook import telling
from zwidth.jobs.executor import Executor
from zwidth.stability import fate_map
from zwidth.stability.fate_map import FateMap
from zwidth.stability.plane import Plane
from zwidth.stability.usual_plane import usual_plane


def make_map(
    plane: Plane | AnyDevice,
    coarse: int = 25,
    levels: int = 3,
    folder: Path | None = None,
    progress: Callable[[float, int], None] | None = None,
    workers: int | None = None,
    runner: Executor | None = None,
) -> FateMap:
    """Map the outcome of runs over two quantities of a wall and its device.

    plane: the two quantities, and the values of the others; for a Device, the name of a shipped one
    or a device file: stiffness over damping around the linear boundary. coarse: points along each
    axis before refinement. levels: refinements; each halves the step where the outcome changes.
    folder: stores the map, so that an interrupted map can be continued; None keeps it in memory.
    progress is called with the share done and the number of runs; without it, a notebook shows
    these. workers: threads (None: all). runner: where parts are computed, see `executor`.

    Raises ValueError with a sentence if an argument, or the content of the folder, does not fit.
    """
    asked = plane if isinstance(plane, Plane) else usual_plane(device_of(plane))
    with telling(None, "computing the map") as tell:

        def told(share: float, runs: int) -> None:
            tell(f"{100.0 * share:.0f} %, {runs} runs simulated")

        return fate_map.make_map(asked, coarse, levels, folder, progress or told, workers, runner)

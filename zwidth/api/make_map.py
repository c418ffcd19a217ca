"""A map of what becomes of a run, over two quantities."""

from collections.abc import Callable
from pathlib import Path

from zwidth.api.given import AnyDevice, device_of
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
    """Map what becomes of a run over two quantities of a wall and its device.

    plane: which two, and what is held fixed; of a Device, the name of a shipped one or a device
    file, stiffness over damping around the linear boundary. coarse: points a side before
    refinement; levels: refinements, each halving the step where the fate changes. folder: where an
    interrupted map is taken up again; None keeps it in memory. progress is called with the share
    done and the points run. workers: threads a part (None: all). runner: of `executor`, where parts
    are run.

    Raises ValueError with a sentence where an argument, or what the folder holds, does not fit.
    """
    asked = plane if isinstance(plane, Plane) else usual_plane(device_of(plane))
    return fate_map.make_map(asked, coarse, levels, folder, progress, workers, runner)

"""A logged run, simulated again and compared with its log."""

from collections.abc import Callable
from os import PathLike

from zwidth.api.notebook import shares, telling
from zwidth.scenarios import replay as scenarios
from zwidth.scenarios.replay import ReplayResult
from zwidth.sim.controller import Step


def replay(
    path: str | PathLike[str],
    controller: Step | None = None,
    progress: Callable[[float], object] | None = None,
) -> ReplayResult:
    """Rebuild a run from its log alone, simulate it again, compare every channel bit for bit.

    path: the log of a run. controller: the user's own control law, if the run had one. progress is
    called with the share done; without it, a notebook shows the progress. A log that ends early is
    compared as far as it goes. NaN equals NaN, whatever its payload.

    Raises LogError for a file that is not a log, ScenarioError, NotTheSame or ReplayError for a log
    whose run cannot be rebuilt: a recording, attachments missing or changed, a controller not
    supplied.
    """
    with telling(None, "simulating the log again") as tell:
        return scenarios.replay(path, controller, progress or shares(tell))

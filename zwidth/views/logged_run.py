"""A run and its log."""

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING

from zwidth.scenarios.logged_run import LoggedRun
from zwidth.views import run
from zwidth.views.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset


def table(logged: LoggedRun) -> Table:
    """Return the run, the path of its log, and its events."""
    found = run.table(logged.run)
    counts = Counter(event.kind.replace("_", " ") for event in logged.events)
    events = ", ".join(f"{kind} {count}" for kind, count in counts.items())
    said = [*found.said, f"Log: {logged.path}", *([f"Events: {events}"] if events else [])]
    return replace(found, said=said)


def dataset(logged: LoggedRun) -> "Dataset":
    """Return the run with the notes of its log."""
    found = run.dataset(logged.run)
    found.attrs |= dict(logged.metadata)
    return found


def _drawn(logged: LoggedRun) -> "Figure":
    return run.PICTURES["signals"](logged.run)


PICTURES = {"signals": _drawn}

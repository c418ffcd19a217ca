"""A log, or another recording with everything that belongs to it."""

from typing import TYPE_CHECKING

from zwidth.logs.mcap_reader import Log
from zwidth.views import trace as signals
from zwidth.views.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset

TOLD = ("device", "controller", "verdict", "outcome")


def table(log: Log) -> Table:
    """Return facts about the run, damage of the log, and a row per channel."""
    known = [f"{key} {log.metadata[key]}" for key in TOLD if key in log.metadata]
    said = [", ".join(known)] if known else []
    said += [f"Warning: {warning}." for warning in log.warnings]
    title = f"Log {log.path.name}: {signals.extent(log.tick.t)}, {len(log.events)} event(s)"
    return Table(title, said, *signals.grid(log.tick))


def dataset(log: Log) -> "Dataset":
    """Return every channel over time, with the log's notes."""
    found = signals.dataset(log.tick)
    found.attrs |= dict(log.metadata)
    return found


def _drawn(log: Log) -> "Figure":
    return signals.PICTURES["signals"](log.tick)


PICTURES = {"signals": _drawn}

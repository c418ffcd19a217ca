"""A finished run."""

from typing import TYPE_CHECKING

from zwidth.sim.run import Run
from zwidth.views import trace as signals
from zwidth.views.table import Table
from zwidth.views.units import rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset


def table(run: Run) -> Table:
    """Return how it ended, and a row a channel."""
    title = f"Run of {run.trace.facts.get('device', 'a device')}: {signals.extent(run.trace.t)}"
    return Table(title, [f"Outcome: {run.outcome.value}."], *signals.grid(run.trace))


def dataset(run: Run) -> "Dataset":
    """Return every channel over time, and the ledger of energies, an entry each."""
    found = signals.dataset(run.trace)
    found.attrs["outcome"] = run.outcome.name.lower()
    if not run.ledger:
        return found
    spent = {"ledger": (list(run.ledger.values()), "J")}
    return found.merge(rows("entry", (list(run.ledger), None), spent))


def _drawn(run: Run) -> "Figure":
    device = run.trace.facts.get("device", "a device")
    return signals.drawn(run.trace, f"{device}: {run.outcome.value}")


PICTURES = {"signals": _drawn}

"""A finished run."""

from typing import TYPE_CHECKING

import numpy as np

from zwidth.sim.run import Outcome, Run
from zwidth.views import trace as signals
from zwidth.views.table import Table
from zwidth.views.units import rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset

FEWEST = 10  # least samples in a quarter of a run, to read its peak
CHANGED = 1.2  # ratio of the peaks of first and last quarter, above which it grows or decays


def table(run: Run) -> Table:
    """Return how the run ended, and a row per channel."""
    title = f"Run of {run.trace.facts.get('device', 'a device')}: {signals.extent(run.trace.t)}"
    return Table(title, [f"Outcome: {run.outcome.value}."], *signals.grid(run.trace))


def dataset(run: Run) -> "Dataset":
    """Return every channel over time, and each entry of the energy ledger."""
    found = signals.dataset(run.trace)
    found.attrs["outcome"] = run.outcome.name.lower()
    if not run.ledger:
        return found
    spent = {"ledger": (list(run.ledger.values()), "J")}
    return found.merge(rows("entry", (list(run.ledger), None), spent))


def _drawn(run: Run) -> "Figure":
    device = run.trace.facts.get("device", "a device")
    return signals.drawn(run.trace, f"{device}: {_ended(run)}")


def _ended(run: Run) -> str:
    """What a title says of a run: at a wall from both sides, whether its motion grows or decays."""
    trace = run.trace
    held = "contact" in trace.channels and bool(np.all(trace["contact"]))
    if run.outcome is not Outcome.COMPLETED or not held or len(trace) < 4 * FEWEST:
        return run.outcome.value
    quarters = np.array_split(np.abs(trace["position_m1"]), 4)
    first, last = float(quarters[0].max()), float(quarters[-1].max())
    if last > CHANGED * first:
        return "the motion grows"
    return "the motion decays" if first > CHANGED * last else run.outcome.value


PICTURES = {"signals": _drawn}

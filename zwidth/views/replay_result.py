"""Whether a log and its replay are equal."""

from typing import TYPE_CHECKING

from zwidth.figures.style import BEFORE
from zwidth.scenarios.replay import ReplayResult
from zwidth.views import trace as signals
from zwidth.views.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset


def table(result: ReplayResult) -> Table:
    """Return the extent of the comparison, and the first difference."""
    said = [f"Note: {note}." for note in result.notes]
    first = result.first_difference
    if first is None:
        return Table(f"Replay: identical, {result.ticks} ticks, every channel bit for bit", said)
    headings = ("tick", "time [s]", "topic", "channel", "logged", "replayed")
    row = [f"{first.tick}", f"{first.time:.9g}", first.topic, first.channel,
           *("-" if v is None else repr(v) for v in (first.logged, first.replayed))]  # fmt: skip
    return Table(f"Replay: different, {result.ticks} ticks compared", said, headings, [row])


def dataset(result: ReplayResult) -> "Dataset":
    """Return the logged trace, with the answer as attributes."""
    from xarray import Dataset

    found = Dataset() if result.trace is None else signals.dataset(result.trace)
    first = result.first_difference
    found.attrs |= {"identical": int(result.identical), "ticks": result.ticks}
    found.attrs |= {} if first is None else {"first_difference": str(first)}
    return found


def _drawn(result: ReplayResult) -> "Figure":
    if result.trace is None:
        raise ValueError(
            "this replay result has no trace to draw; call replay(path), whose result has one"
        )
    figure = signals.PICTURES["signals"](result.trace)
    first, top = result.first_difference, figure.axes[0]
    if first is None:
        top.set_title("identical to its replay, bit for bit", loc="left", fontsize=10)
        return figure
    for axes in figure.axes:
        axes.axvline(first.time, color=BEFORE, linestyle="--", linewidth=1.0)
    what = f"{first.channel} differs from t = {first.time:.6g} s on"
    top.set_title(f"Replay: {what} (dashed)", loc="left", fontsize=10)
    return figure


PICTURES = {"signals": _drawn}

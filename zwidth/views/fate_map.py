"""A map of fates."""

from typing import TYPE_CHECKING

from zwidth.stability.fate_map import FateMap, map_dataset
from zwidth.stability.map_summary import summary
from zwidth.views.table import NONE, Table, number
from zwidth.views.units import units

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset


def table(result: FateMap) -> Table:
    """Return a row for each fate that occurs."""
    plane, found = result.plane, summary(result)
    unit = units(plane.device.rotary)
    headings = ("fate", "share of the plane", f"median amplitude [{unit.length}]",
                f"median force [{unit.force}]")  # fmt: skip
    grid = [
        [name, f"{100.0 * fate['share']:.1f} %",
         *(NONE if fate[key] is None else number(fate[key][0]) for key in ("amplitude", "force"))]
        for name, fate in found["fates"].items()
        if fate["share"] > 0.0
    ]  # fmt: skip
    over = f"{plane.y.quantity} over {plane.x.quantity}"
    share = found["stable_but_not_resting"]
    words = f"Of the linearly stable part {100.0 * (share or 0.0):.1f} % does not come to rest."
    said = [] if share is None else [words]
    title = f"Map of {plane.device.name}, {over}: {result.runs} runs for {result.run.size} points"
    return Table(title, said, headings, grid)


def dataset(result: FateMap) -> "Dataset":
    """Return the map over its axes, as written by `save_map`."""
    return map_dataset(result)


def _drawn(result: FateMap) -> "Figure":
    from zwidth.figures.map import map_figure

    return map_figure(result)


PICTURES = {"map": _drawn}

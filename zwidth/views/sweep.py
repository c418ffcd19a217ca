"""The Z-width over a setting of the interface."""

from math import isnan
from typing import TYPE_CHECKING

from zwidth.stability.sweep import WHOLE, Sweep
from zwidth.views.table import Table, number
from zwidth.views.units import rows, units

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset


def table(result: Sweep) -> Table:
    """Return the best value in a sentence, and a row per value."""
    unit = units(result.device.rotary)
    headings = (
        f"{result.setting} [{result.unit}]", "Z-width over the best", "by theory",
        f"K_max [{unit.stiffness}]",
    )  # fmt: skip
    best = result.best
    grid = [
        ["none" if step.value == float("inf") else number(step.value),
         f"{100.0 * step.area / best.area:.1f} %",
         _share(step.linear_area / best.area), number(step.stiffest)]
        for step in result.steps
    ]  # fmt: skip
    said = [f"The Z-width is widest at {result.setting} {_value(result)}, {_gain(result)}."]
    return Table(f"Z-width of {result.device.name} over {result.setting}", said, headings, grid)


def _share(share: float) -> str:
    return "-" if isnan(share) else f"{100.0 * share:.1f} %"


def _value(result: Sweep) -> str:
    if result.best.value == float("inf"):
        return "none"
    unit = "" if result.setting in WHOLE else f" {result.unit}"
    return number(result.best.value) + unit


def _gain(result: Sweep) -> str:
    own = result.without
    if own is None or own is result.best or own.area == 0.0:
        return f"K_max {number(result.best.stiffest)}"
    return f"{result.best.area / own.area:.3g} times that of the device as it is"


def dataset(result: Sweep) -> "Dataset":
    """Return Z-width and largest stiffness over the setting."""
    unit, steps = units(result.device.rotary), result.steps
    of = f"({unit.stiffness})2 s"
    columns = {
        "area": ([s.area for s in steps], of),
        "linear_area": ([s.linear_area for s in steps], of),
        "stiffest": ([s.stiffest for s in steps], unit.stiffness),
    }
    places = ([s.value for s in steps], result.unit)
    return rows(result.setting, places, columns, {"device": result.device.name})


def _drawn(result: Sweep) -> "Figure":
    from zwidth.figures.sweep import sweep_figure

    return sweep_figure(result)


PICTURES = {"sweep": _drawn}

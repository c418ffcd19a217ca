"""Whether a device file still describes its machine: a row for each output of each recording."""

from typing import TYPE_CHECKING

import numpy as np

from zwidth.checking import Check
from zwidth.sim.readable import with_unit
from zwidth.views.table import Table
from zwidth.views.units import Column, rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset


def table(found: Check) -> Table:
    """Return errors of free runs beside the largest error within the band."""
    headings = ("recording", "output", "error", "band, up to", "")
    grid = [
        [
            one.name, o.name, with_unit(o.error, o.unit, 3), with_unit(o.most, o.unit, 3),
            "within" if o.within else "outside",
        ]
        for one in found.recordings
        for o in one.outputs
    ]  # fmt: skip
    return Table(found.sentence, (), headings, grid)


def dataset(found: Check) -> "Dataset":
    """Return over outputs of recordings: error, its limit in the band, motion, whether within.

    Each is in the unit of its output, given by `output_unit`.
    """
    every = [(one.name, o) for one in found.recordings for o in one.outputs]
    columns: dict[str, Column] = {
        name: ([getattr(o, name) for _, o in every], "unit of the output")
        for name in ("error", "most", "motion")
    }
    columns["output"] = [o.name for _, o in every], None
    columns["output_unit"] = [o.unit for _, o in every], None
    columns["within"] = [float(o.within) for _, o in every], "1"
    names = np.array([name for name, _ in every], dtype=object)
    return rows("recording", (names, None), columns, {"sentence": found.sentence})


def _errors(found: Check) -> "Figure":
    from zwidth.figures.check import check_figure

    return check_figure([(f"{one.name}, {o.name}", o.error / o.most, o.within)
                         for one in found.recordings for o in one.outputs])  # fmt: skip


PICTURES = {"errors": _errors}

"""The joints of a recording: a row for each, with what is missing in it."""

import math
from typing import TYPE_CHECKING

import numpy as np

from zwidth.diagnosis.answer.joints import JointAnswers
from zwidth.sim.readable import percent
from zwidth.views.table import NONE, Table
from zwidth.views.units import rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset


def table(found: JointAnswers) -> Table:
    """Return a row for each joint; the errors are those of free runs on held-out data."""
    grid = [
        [
            joint,
            one.headline,
            percent(one.free_run.refit),
            percent(one.free_run.after) if one.findings else NONE,
        ]
        for joint, one in found.answers.items()
    ]
    grid += [[joint, f"not diagnosed: {why}", NONE, NONE] for joint, why in found.left.items()]
    headings = ("joint", "what is missing", "refitted", "with it")
    return Table(f"{len(grid)} joints", (), headings, grid)


def dataset(found: JointAnswers) -> "Dataset":
    """Return over the joints: verdict, headline, and the errors of free runs; NaN without one."""
    every = [*found.answers, *found.left]
    told = [found.answers.get(joint) for joint in every]
    errors = {
        f"free_run_{name}": [
            math.nan if d is None else float(getattr(d.free_run, name)) for d in told
        ]
        for name in ("before", "refit", "after")
    }
    columns: dict[str, tuple[list[float] | list[str], str | None]] = {
        name: (values, "1") for name, values in errors.items()
    }
    columns["verdict"] = ["" if d is None else d.verdict.value for d in told], None
    columns["headline"] = [
        found.left[joint] if d is None else d.headline
        for joint, d in zip(every, told, strict=True)
    ], None  # fmt: skip
    return rows("joint", (np.array(every, dtype=object), None), columns, {})


def _errors(found: JointAnswers) -> "Figure":
    from zwidth.figures.joints import joints_figure

    return joints_figure({joint: one.free_run for joint, one in found.answers.items()})


PICTURES = {"errors": _errors}

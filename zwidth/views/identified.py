"""A device that was fitted to a recording, with the intervals of its parameters."""

from typing import TYPE_CHECKING

import numpy as np

from zwidth.identification.identified import Identified
from zwidth.views.table import Table, number
from zwidth.views.units import Units, rows, units

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset


def table(found: Identified) -> Table:
    """Return a row per parameter."""
    fit, unit = found.fit, units(found.device.rotary)
    grid = [
        [name, _unit(name, unit), *map(number, values)] for name, values in fit.intervals().items()
    ]
    said = [
        f"Noise {number(fit.noise_rms)} {unit.length} rms; mean square of (error of the fit /"
        f" noise): {number(fit.misfit)} (1 if only noise is left)."
    ]
    said += [f"Warning: {fit.note}."] if fit.note else []
    title = f"Identified: {found.device.name}, {len(fit.model.modes)} mode(s)"
    return Table(title, said, ("parameter", "unit", "value", "95 % from", "to"), grid)


def _unit(name: str, unit: Units) -> str:
    return {"m": unit.mass, "b": unit.damping, "delay": "s"}.get(name, "rad/s")


def dataset(found: Identified) -> "Dataset":
    """Return the parameters with their intervals, and the measured and fitted response.

    `unit` is the unit of each parameter.
    """
    fit, unit = found.fit, units(found.device.rotary)
    intervals = fit.intervals()
    value, lower, upper = (list(column) for column in zip(*intervals.values(), strict=True))
    columns = {k: (v, "as in unit") for k, v in zip(
        ("value", "lower", "upper"), (value, lower, upper), strict=True
    )}  # fmt: skip
    names = list(intervals)
    said = {"unit": ([_unit(name, unit) for name in names], None)}
    facts = {"device": found.device.name, "misfit": fit.misfit, "noise_rms": fit.noise_rms}
    response = f"{unit.length}/({unit.force})"
    over = rows("frequency", (fit.response.frequency_hz, "Hz"), {
        "measured": (fit.response.value, response),
        "fitted": (fit.fitted, response),
        "deviation": (np.sqrt(fit.variance), response),
        "coherence": (fit.response.coherence, ""),
    })  # fmt: skip
    return rows("parameter", (names, None), columns | said, facts).merge(over)


def _drawn(found: Identified) -> "Figure":
    from zwidth.figures.identified import fit_figure

    return fit_figure(found.fit)


PICTURES = {"response": _drawn}

"""A fleet: what its recordings have in common, their results, and the odd ones."""

import math
from typing import TYPE_CHECKING

import numpy as np

from zwidth.fleet.reasons import in_words
from zwidth.fleet.result import Fleet
from zwidth.sim.readable import with_unit
from zwidth.views.table import Table
from zwidth.views.units import rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset

ODD = 3  # most recordings named in the sentences


def table(found: Fleet) -> Table:
    """Return the answer in sentences, and a row for each parameter."""
    headings = ("parameter", "value", "differs", "follows")
    grid: list[list[str]] = []
    for name, s in found.spreads.items():
        unit = found.names[name]
        differs = [
            f"{with_unit(rms, unit, 2)} by {word}"
            for has, word, rms in (
                (s.per_device, "device", s.tau_device),
                (s.per_run, "run", s.tau_run),
            )
            if has
        ]
        slopes = [f"{column}, {with_unit(v.value, unit)} a unit" for column, v in s.slopes.items()]
        words = in_words(name).rstrip(","), with_unit(s.center.value, unit)
        grid.append([*words, " and ".join(differs) or "no", "; ".join(slopes) or "-"])
    said = [f"{found.headline}."]
    said += [f"{found.said_of(change)}." for change in found.changes[2:]]
    said += [f"{m.listed.name}: {m.reason.sentence}." for m in found.odd[:ODD] if m.reason]
    title = f"Fleet of {len(found.members)} recordings of {len(found.devices)} devices"
    return Table(title, said, headings, grid)


def dataset(found: Fleet) -> "Dataset":
    """Return over the recordings: each parameter, its error, and its pooled value.

    NaN if a recording has no fit, or is not used for the fleet; an error is infinite if a recording
    does not determine a parameter.
    """
    members, nan = found.members, math.nan
    columns: dict[str, tuple[list[float] | list[str], str | None]] = {}
    for place, name in enumerate(found.names):
        unit = found.names[name]
        own = [nan if m.quick.problem else float(m.quick.values[place]) for m in members]
        error = [nan if m.quick.problem else float(m.quick.errors[place]) for m in members]
        columns[name] = own, unit
        columns[f"{name} error"] = error, unit
        if name in found.spreads:
            pooled, at = found.spreads[name].pooled, found.pooled_places
            together = [float(pooled[at[m.listed.name]]) if m.pooled else nan for m in members]
            columns[f"{name} pooled"] = together, unit
    columns["noise"] = [nan if m.quick.problem else m.quick.noise for m in members], _output(found)
    columns["free_run"] = [nan if m.quick.problem else m.quick.free for m in members], "1"
    known = dict.fromkeys(column for m in members for column in m.listed.known)
    for column in known:  # its unit, if any, is part of its name
        columns[column] = [m.listed.known.get(column, nan) for m in members], ""
    columns["device"] = [m.listed.device for m in members], None
    dates = ["" if m.listed.date is None else m.listed.date.isoformat() for m in members]
    columns["date"] = dates, None
    columns["reason"] = ["" if m.reason is None else m.reason.kind for m in members], None
    names = np.array([m.listed.name for m in members], dtype=object)
    facts = {"headline": found.headline, "structure": " + ".join(found.structure.labels)}
    return rows("recording", (names, None), columns, facts)


def _output(found: Fleet) -> str:
    return "rad" if found.structure.device.rotary else "m"


def _parameters(found: Fleet) -> "Figure":
    from zwidth.figures.fleet import fleet_figure

    return fleet_figure(found)


PICTURES = {"parameters": _parameters}

"""What a recording would show."""

from typing import TYPE_CHECKING

from zwidth.diagnosis.answer.words import own_parameter
from zwidth.planning.limits import SHOWN
from zwidth.planning.plan import ALIKE, Plan, Visible
from zwidth.views.table import Table, number
from zwidth.views.units import numbers, rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset


def table(found: Plan) -> Table:
    """Return a row for each effect: its smallest visible size, and effects that look like it."""
    headings = ("effect", "smallest visible size", "looks like")
    grid = [[v.label, _smallest(v), _alike(found, v.label) or "-"] for v in found.visible]
    pairs = len(found.confusable)
    alike = "1 pair of effects looks" if pairs == 1 else f"{pairs or 'no'} pairs of effects look"
    said = [
        f"Smallest size visible at {SHOWN:g} sigma. At {ALIKE:g} times this size, {alike} alike."
    ]
    return Table(f"Plan: {found.excitation}, {found.seconds:g} s", said, headings, grid)


def _smallest(seen: Visible) -> str:
    """The magnitude, with what it is in front and its unit behind."""
    size = "never" if seen.magnitude is None else f"{number(seen.magnitude)} {seen.unit}"
    return f"{own_parameter(seen.measure)} {size}".strip()


def _alike(found: Plan, label: str) -> str:
    pairs = [(p.effect, p.rival) for p in found.confusable if label in (p.effect, p.rival)]
    return ", ".join(b if a == label else a for a, b in pairs)


def dataset(found: Plan) -> "Dataset":
    """Return the limits over the effects, and the distances of all compared pairs."""
    from xarray import DataArray

    seen = found.visible
    columns = {
        "magnitude": (numbers([v.magnitude for v in seen]), "as in unit"),
        "natural": (numbers([v.natural for v in seen]), "as in unit"),
        "parameter": ([v.name for v in seen], None),
        "unit": ([v.unit for v in seen], None),
        "looks_like": ([_alike(found, v.label) for v in seen], None),
    }
    facts = {"excitation": found.excitation, "seconds": found.seconds, "shown_at_sigma": SHOWN}
    limits = rows("effect", ([v.label for v in seen], None), columns, facts)
    labels = list(found.labels)
    distances = DataArray(
        found.distances, {"compared": labels, "rival": labels}, ("compared", "rival"),
        attrs={"units": "sigma"},
    )  # fmt: skip
    return limits.assign(distance=distances)


def _drawn(found: Plan) -> "Figure":
    from zwidth.figures.plan import plan_figure

    return plan_figure(found, f"{found.excitation}, {found.seconds:g} s")


PICTURES = {"plan": _drawn}

"""What a recording would show."""

from typing import TYPE_CHECKING

from zwidth.planning.limits import SHOWN
from zwidth.planning.plan import ALIKE, Plan, Visible
from zwidth.views.table import Table, number
from zwidth.views.units import numbers, rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset


def table(found: Plan) -> Table:
    """Return a row an effect: the smallest that shows, and what it would be taken for."""
    headings = ("effect", "smallest that shows", "looks like")
    grid = [[v.label, _smallest(v), _alike(found, v.label) or "-"] for v in found.visible]
    pairs = len(found.confusable)
    said = [
        f"Smallest size that shows with {SHOWN:g} sigma after a refit; {pairs} pair(s) cannot be"
        f" told apart at {ALIKE:g} times that."
    ]
    return Table(f"Plan: {found.excitation}, {found.seconds:g} s", said, headings, grid)


def _smallest(seen: Visible) -> str:
    """The magnitude, with what it is in front and its unit behind."""
    size = "never" if seen.magnitude is None else f"{number(seen.magnitude)} {seen.unit}"
    return f"{seen.measure} {size}".strip()


def _alike(found: Plan, label: str) -> str:
    pairs = [(p.effect, p.rival) for p in found.confusable if label in (p.effect, p.rival)]
    return ", ".join(b if a == label else a for a, b in pairs)


def dataset(found: Plan) -> "Dataset":
    """Return the limits over the effects, and the distances of all pairs that were compared."""
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

"""A stability boundary, by theory and by simulation."""

from typing import TYPE_CHECKING

from zwidth.stability.boundary import Boundary, BoundaryPoint
from zwidth.views.table import NONE, Table, number
from zwidth.views.units import Column, numbers, rows, units

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset


def table(boundary: Boundary) -> Table:
    """Return the stiffest stable wall in a sentence, and a row per damping."""
    unit = units(boundary.device.rotary)
    in_k = f"[{unit.stiffness}]"
    headings = (f"B [{unit.damping}]", f"K linear {in_k}", "f [Hz]", f"K stable {in_k}",
                f"K unstable {in_k}", "f [Hz]")  # fmt: skip
    delay = f"delay {1e3 * boundary.device.interface.delay:g} ms"
    title = f"Boundary of {boundary.device.name}, {delay}, {len(boundary.points)} dampings"
    grid = [[number(v) if v is not None else NONE for v in _row(p)] for p in boundary.points]
    return Table(title, [_top(boundary)], headings, grid)


def _top(boundary: Boundary) -> str:
    unit, top = units(boundary.device.rotary), boundary.top
    if top is None or top.simulated.stable is None:
        return "No wall is stable at any of these dampings."
    stiffest = f"K = {number(top.simulated.stable)} {unit.stiffness}"
    at = f"B = {number(top.damping)} {unit.damping}"
    linear = f"linear theory says {number(top.linear.stiffness)}"
    return f"Stiffest stable wall in simulation: {stiffest} at {at}; {linear}."


def _row(point: BoundaryPoint) -> tuple[float | None, ...]:
    linear, seen = point.linear, point.simulated
    frequency = (linear.frequency_hz, seen.frequency)
    return (point.damping, linear.stiffness, frequency[0], seen.stable, seen.unstable, frequency[1])


def dataset(boundary: Boundary) -> "Dataset":
    """Return both boundaries over the damping B; NaN where there is no stable K."""
    unit, points = units(boundary.device.rotary), boundary.points
    damping, *columns = (numbers(c) for c in zip(*map(_row, points), strict=True))
    names = ("linear", "linear_frequency", "stable", "unstable", "frequency")
    of = (unit.stiffness, "Hz", unit.stiffness, unit.stiffness, "Hz")
    found: dict[str, Column] = {n: (v, u) for n, v, u in zip(names, columns, of, strict=True)}
    verdicts = [(p.simulated.stable_verdict, p.simulated.unstable_verdict) for p in points]
    for name, words in zip(
        ("stable_verdict", "unstable_verdict"), zip(*verdicts, strict=True), strict=True
    ):
        found[name] = (["" if word is None else word.value for word in words], None)
    facts = {"device": boundary.device.name, "delay": boundary.device.interface.delay}
    return rows("damping", (damping, unit.damping), found, facts)


def _drawn(boundary: Boundary) -> "Figure":
    from zwidth.figures.boundary import boundary_figure
    from zwidth.results import BoundaryResult, DelayBoundary, point_of

    device = boundary.device
    points = [point_of(point) for point in boundary.points]
    delays = [DelayBoundary(device.interface.delay, points)]
    return boundary_figure(BoundaryResult(device.name, delays, device.rotary))


PICTURES = {"boundary": _drawn}

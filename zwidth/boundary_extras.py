"""Optional additions to a stability boundary: passive walls, a hand, uncertain parameters."""

from collections.abc import Sequence
from typing import NamedTuple

from msgspec import UNSET
from msgspec.structs import replace

from zwidth.covariance import Covariance
from zwidth.results import Critical, Interval, Point, Quantiles
from zwidth.sim.device import Device
from zwidth.stability.hand import hand_band, hand_quantiles
from zwidth.stability.passivity import passive_boundary
from zwidth.stability.uncertainty import stiffness_band


class Asked(NamedTuple):
    """The extras to show: passive walls; a hand at this lever [m], None for no hand; a covariance.

    hands: how many are drawn, 0 for none; extremes: the corners of the hands' range.
    """

    passive: bool = False
    lever: float | None = None
    covariance: Covariance | None = None
    hands: int = 0
    extremes: bool = True


def with_extras(device: Device, points: Sequence[Point], asked: Asked) -> list[Point]:
    """Return the points with the requested extras; raises ValueError as these do."""
    found = list(points)
    dampings = [point.damping for point in found]
    if asked.passive:
        walls = passive_boundary(device, dampings)
        found = [
            replace(
                point,
                passive=None
                if wall.stiffness is None or wall.frequency_hz is None
                else Critical(wall.stiffness, wall.frequency_hz),
            )
            for point, wall in zip(found, walls, strict=True)
        ]
    if asked.lever is not None and asked.hands:
        spread = hand_quantiles(device, dampings, asked.lever, asked.hands)
        found = [replace(p, hands=Quantiles(*s)) for p, s in zip(found, spread, strict=True)]
    if asked.lever is not None and asked.extremes:
        bands = hand_band(device, dampings, asked.lever)
        found = [replace(p, hand=Interval(*band)) for p, band in zip(found, bands, strict=True)]
    if asked.covariance is not None:
        bands = stiffness_band(device, *asked.covariance, dampings)
        found = [
            replace(p, confidence95=Interval(*band)) for p, band in zip(found, bands, strict=True)
        ]
    return found


def extra_headings(asked: Asked) -> list[str]:
    """Return the headings of the columns that `extra_cells` fills."""
    return (
        ["K passive"] * asked.passive
        + ["K of 5, 50, 95 % of hands"] * (asked.hands > 0)
        + ["K with a hand"] * (asked.lever is not None and asked.extremes)
        + ["K at 95 %"] * (asked.covariance is not None)
    )


def extra_cells(point: Point) -> list[str]:
    """Return the cells of a point, one per requested extra."""
    cells: list[str] = []
    if point.passive is not UNSET:
        cells.append("-" if point.passive is None else f"{point.passive.stiffness:.4g}")
    if point.hands is not UNSET:
        three = (point.hands.low, point.hands.median, point.hands.high)
        cells.append(", ".join(f"{k:.4g}" if k > 0.0 else "-" for k in three))
    bands = (point.hand, point.confidence95)
    return cells + [_from_to(band) for band in bands if band is not UNSET]


def _from_to(band: Interval) -> str:
    """A band in a cell: a dash where no case has a stable K, and where only some have none."""
    if band.high == 0.0:
        return "-"
    return f"{band.low:.4g} to {band.high:.4g}" if band.low > 0.0 else f"- to {band.high:.4g}"

"""Table II of the paper: the boundary of a real PHANToM 1.0, 26 points by the relay method."""

import tomllib
from functools import cache
from pathlib import Path
from typing import NamedTuple

TABLE = Path(__file__).parent / "data" / "table_2.toml"
DEVICE = "phantom_1_0"


class MeasuredPoint(NamedTuple):
    """A row of Table II as printed, in SI.

    delay [s], damping B [N m s/rad], stiffness K_CR [N m/rad], ultimate frequency [Hz].
    damping_meant: B where the printed one is a misprint by all evidence, else None.
    """

    delay: float
    damping: float
    stiffness: float
    frequency: float
    damping_meant: float | None = None

    @property
    def place(self) -> float:
        """The damping at which the point belongs: the printed one unless it is a misprint."""
        return self.damping if self.damping_meant is None else self.damping_meant


@cache
def table_2() -> tuple[MeasuredPoint, ...]:
    """Return the 26 rows in the order of the paper: 2 ms, 8 ms, 4 ms."""
    with TABLE.open("rb") as file:
        rows = tomllib.load(file)["row"]
    return tuple(
        MeasuredPoint(
            row["delay_ms"] / 1e3,
            float(row["damping"]),
            float(row["stiffness"]),
            float(row["frequency_hz"]),
            row.get("damping_meant"),
        )
        for row in rows
    )


def measured_at(delay: float) -> list[MeasuredPoint]:
    """Return the points measured at a delay [s], in rising order of the damping they belong to."""
    return sorted(
        (point for point in table_2() if abs(point.delay - delay) < 1e-9),
        key=lambda point: point.place,
    )

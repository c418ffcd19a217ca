"""Table II of the paper: the boundary of a real PHANToM 1.0, 26 points by the relay method."""

import tomllib
from functools import cache
from pathlib import Path
from typing import NamedTuple

from zwidth.scenarios.misprints import Judged, judged
from zwidth.sim.device_file import load_device

TABLE = Path(__file__).parent / "data" / "table_2.toml"
DEVICE = "phantom_1_0"


class MeasuredPoint(NamedTuple):
    """A row of Table II as printed, in SI.

    delay [s], damping B [N m s/rad], stiffness K_CR [N m/rad], ultimate frequency [Hz]. judged: the
    row among its neighbours, if it was compared with them.
    """

    delay: float
    damping: float
    stiffness: float
    frequency: float
    judged: Judged | None = None

    @property
    def damping_meant(self) -> float | None:
        """B that the other rows imply, if the printed B is a misprint; else None."""
        return None if self.judged is None else self.judged.meant

    @property
    def place(self) -> float:
        """The damping to use for the point: the printed one, unless it is a misprint."""
        return self.damping if self.damping_meant is None else self.damping_meant


@cache
def table_2() -> tuple[MeasuredPoint, ...]:
    """Return the 26 rows in the paper's order of delays: 2, 8, 4 ms.

    `judged` of a row says whether the other rows make it a misprint (`scenarios.misprints`).
    """
    with TABLE.open("rb") as file:
        rows = tomllib.load(file)["row"]
    printed = [
        MeasuredPoint(
            row["delay_ms"] / 1e3,
            float(row["damping"]),
            float(row["stiffness"]),
            float(row["frequency_hz"]),
        )
        for row in rows
    ]
    device = load_device(DEVICE)
    assert device.modal is not None
    verdicts = judged(printed, device.modal, device.interface.period)
    return tuple(p._replace(judged=v) for p, v in zip(printed, verdicts, strict=True))


def measured_at(delay: float) -> list[MeasuredPoint]:
    """Return the points measured at a delay [s], in rising order of `place`, their damping."""
    return sorted(
        (point for point in table_2() if abs(point.delay - delay) < 1e-9),
        key=lambda point: point.place,
    )

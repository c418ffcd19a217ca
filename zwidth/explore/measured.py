"""Walls that were measured at the edge of stability on the real devices."""

from collections.abc import Set
from functools import cache
from typing import NamedTuple

from zwidth.scenarios import paddle, table_2
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device


class MeasuredPoint(NamedTuple):
    """A wall measured at the edge of stability, at a delay [s]; frequency [Hz] if known."""

    damping: float
    stiffness: float
    delay: float
    frequency: float | None


def measured_on(names: Set[str]) -> list[MeasuredPoint]:
    """Return the points measured on the first device with one of these names."""
    if _shipped(table_2.DEVICE).name in names:
        return [
            MeasuredPoint(p.place, p.stiffness, p.delay, p.frequency) for p in table_2.table_2()
        ]
    if _shipped(paddle.DEVICE).name in names:
        delay = _shipped(paddle.DEVICE).interface.delay
        return [
            MeasuredPoint(p.damping, p.stiffness, delay, None) for p in paddle.paddle_boundary()
        ]
    return []


@cache
def _shipped(name: str) -> Device:
    return load_device(name)

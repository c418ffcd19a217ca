"""Results as programs read them: the JSON of ``--json``, stable from the first release.

Numbers are SI, a unit stands in the name where it is no SI unit of the device itself; `None` means
that there is none (no stable K), a missing key that it was not measured.
"""

from collections.abc import Mapping
from typing import Any

import msgspec
from msgspec import UNSET, UnsetType


class Critical(msgspec.Struct, frozen=True):
    """The boundary by linear theory: K_CR [N m/rad | N/m] and the ultimate frequency."""

    stiffness: float
    frequency_hz: float


class Bracketed(msgspec.Struct, frozen=True):
    """The boundary in the time domain: a K that is stable and one that is not.

    unstable is None where the stiffest wall tried was still stable.
    """

    stable: float
    unstable: float | None
    frequency_hz: float | None


class Measured(msgspec.Struct, frozen=True, omit_defaults=True):
    """A point measured on the real device.

    damping_printed: B as the source prints it, where the point is placed elsewhere for a misprint.
    """

    stiffness: float
    frequency_hz: float
    damping_printed: float | UnsetType = UNSET


class Interval(msgspec.Struct, frozen=True):
    """Stiffness from low to high [N m/rad | N/m]; 0 where some case has no stable K."""

    low: float
    high: float


class Point(msgspec.Struct, frozen=True, omit_defaults=True):
    """The boundary at one virtual damping B [N m s/rad | N s/m].

    passive: the stiffest passive wall, None where there is none; hand: K_CR over the range of hands
    at m3; confidence95: K_CR by the covariance of the parameters. Absent where not asked for.
    """

    damping: float
    linear: Critical | None
    simulated: Bracketed | None
    measured: Measured | UnsetType = UNSET
    passive: Critical | UnsetType | None = UNSET
    hand: Interval | UnsetType = UNSET
    confidence95: Interval | UnsetType = UNSET


class DelayBoundary(msgspec.Struct, frozen=True):
    """The boundary at one delay."""

    delay_s: float
    points: list[Point]


class BoundaryResult(msgspec.Struct, frozen=True, omit_defaults=True):
    """The result of ``zwidth boundary``; rotary says which units the numbers have."""

    device: str
    boundaries: list[DelayBoundary]
    rotary: bool = True


def as_json(result: msgspec.Struct) -> Mapping[str, Any]:
    """Return the result in plain types, ready for JSON."""
    return msgspec.to_builtins(result)


def boundary_result(values: Mapping[str, Any]) -> BoundaryResult:
    """Read the JSON of ``zwidth boundary`` back; raises ValueError (field and what is wrong)."""
    return msgspec.convert(values, BoundaryResult)

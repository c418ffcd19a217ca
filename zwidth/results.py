"""Results for programs: the JSON of ``--json``, stable from the first release.

Numbers are SI; a name ends in its unit if that is not an SI unit of the device itself; `None` means
that there is no value (no stable K), a missing key that it was not measured.
"""

from collections.abc import Mapping
from typing import Any

import msgspec
from msgspec import UNSET, UnsetType

from zwidth.stability.bisection import Bracket
from zwidth.stability.boundary import BoundaryPoint


class Critical(msgspec.Struct, frozen=True):
    """The boundary by linear theory: K_CR [N m/rad | N/m] and the ultimate frequency."""

    stiffness: float
    frequency_hz: float


class Bracketed(msgspec.Struct, frozen=True, omit_defaults=True):
    """The boundary in the time domain: a K that is stable and one that is not.

    unstable is None if the stiffest wall tried was still stable. grows_from: the starts from which
    the unstable wall grows [rad | m], absent if it grows from all that were tried.
    """

    stable: float
    unstable: float | None
    frequency_hz: float | None
    grows_from: list[float] | UnsetType = UNSET


class Measured(msgspec.Struct, frozen=True, omit_defaults=True):
    """A point measured on the real device.

    damping_printed: B as printed in the source, if the point is at another B because of a misprint.
    """

    stiffness: float
    frequency_hz: float
    damping_printed: float | UnsetType = UNSET


class Interval(msgspec.Struct, frozen=True):
    """Stiffness from low to high [N m/rad | N/m]; 0 if some case has no stable K."""

    low: float
    high: float


class Quantiles(msgspec.Struct, frozen=True):
    """Stiffness [N m/rad | N/m] that 95, 50 and 5 % of cases reach; 0 for no stable K."""

    low: float
    median: float
    high: float


class Point(msgspec.Struct, frozen=True, omit_defaults=True):
    """The boundary at one virtual damping B [N m s/rad | N s/m].

    passive: the stiffest passive wall, None if there is none; hand: K_CR over the range of hands at
    m3; hands: its quantiles over hands that were drawn; confidence95: K_CR by the covariance of the
    parameters; felt: K from which a lasting oscillation is felt, None if it is felt even for the
    softest wall. Absent if not requested. reason, felt_reason: why simulated and felt are None, in
    words.
    """

    damping: float
    linear: Critical | None
    simulated: Bracketed | None
    measured: Measured | UnsetType = UNSET
    passive: Critical | UnsetType | None = UNSET
    hand: Interval | UnsetType = UNSET
    hands: Quantiles | UnsetType = UNSET
    confidence95: Interval | UnsetType = UNSET
    reason: str | UnsetType = UNSET
    felt: Bracketed | UnsetType | None = UNSET
    felt_reason: str | UnsetType = UNSET


class Ending(msgspec.Struct, frozen=True):
    """The oscillation in which the boundary ends near its top, by linear theory.

    Its mode and frequency, and the phase lags of the wall's spring and damper there in degrees.
    """

    damping: float
    mode: str
    frequency_hz: float
    spring_lag_deg: float
    damper_lag_deg: float


class Stiffest(msgspec.Struct, frozen=True, omit_defaults=True):
    """The stiffest wall: the largest stable K tried, in the time domain, and where it ends.

    linear_stiffness, linear_damping: the top by linear theory; frequency_below_hz and
    frequency_above_hz: on either side of that B; they differ if the frequency jumps.
    last_stable_damping: the largest B tried with a stable K; linear_last_stable_damping by theory.
    None if there is none. sentence: the answer in words; endings: the oscillation in which the
    boundary ends there by linear theory, on either side of the top where they differ; frequency_hz:
    of the oscillation in which it ends in the time domain; without: the stable K at the same B
    without each part that the device has (friction, play, encoder_step, velocity_step,
    command_step, command_limit), None for none.
    """

    stiffness: float | None
    damping: float | None
    last_stable_damping: float | None
    linear_stiffness: float | None
    linear_damping: float | None
    frequency_below_hz: float | None
    frequency_above_hz: float | None
    linear_last_stable_damping: float | None
    sentence: str | UnsetType = UNSET
    endings: list[Ending] | UnsetType = UNSET
    frequency_hz: float | UnsetType = UNSET
    without: dict[str, float | None] | UnsetType = UNSET


class DelayBoundary(msgspec.Struct, frozen=True, omit_defaults=True):
    """The boundary at one delay; stiffest answers how stiff a wall may be."""

    delay_s: float
    points: list[Point]
    stiffest: Stiffest | UnsetType = UNSET


class BoundaryResult(msgspec.Struct, frozen=True, omit_defaults=True):
    """The result of ``zwidth boundary``; rotary determines the units of the numbers.

    law: of the walls in the time domain, in words; absent for spring and damper.
    """

    device: str
    boundaries: list[DelayBoundary]
    rotary: bool = True
    law: str | UnsetType = UNSET


def point_of(point: BoundaryPoint, measured: Measured | UnsetType = UNSET) -> Point:
    """Return a point of a boundary, with the measurements there."""
    linear, bracket = point.linear, point.simulated
    critical = None
    if linear.stiffness is not None and linear.frequency_hz is not None:
        critical = Critical(linear.stiffness, linear.frequency_hz)
    simulated = bracketed(bracket)
    reason = bracket.reason or UNSET
    return Point(float(point.damping), critical, simulated, measured, reason=reason)


def bracketed(bracket: Bracket) -> Bracketed | None:
    """Return a bracket, None if it has no stable K."""
    if bracket.stable is None:
        return None
    starts = list(bracket.grows_from) or UNSET
    return Bracketed(bracket.stable, bracket.unstable, bracket.frequency, starts)


def as_json(result: msgspec.Struct) -> Mapping[str, Any]:
    """Return the result in plain types, ready for JSON."""
    return msgspec.to_builtins(result)

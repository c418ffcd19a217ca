"""Factors between units in which a command or output may have been recorded by mistake."""

import math
from collections.abc import Sequence

from zwidth.diagnosis.settings import INTAKE
from zwidth.sim.readable import plain

# Factors that convert a channel into the SI.
UNITS = {
    math.pi / 180.0: "degrees",
    180.0 / math.pi: "degrees",
    1e-3: "mm or mN m",
    1e3: "mm or mN m",
    2.0 * math.pi / 60.0: "turns a minute",
    60.0 / (2.0 * math.pi): "turns a minute",
    1e-2: "cm or percent",
    1e2: "cm or percent",
    9.80665: "kilograms of force",
    1.0 / 9.80665: "kilograms of force",
    25.4e-3: "inches",
    1.0 / 25.4e-3: "inches",
    2.0 * math.pi: "turns",
    1.0 / (2.0 * math.pi): "turns",
    4.4482216: "pounds of force",
    1.0 / 4.4482216: "pounds of force",
    35.27 / 16.0: "pounds",
    16.0 / 35.27: "pounds",
}
ANGLES = "motion in degrees or turns"
# Units that are so often mistaken for the SI that a factor near them counts as this unit.
TURNING = (math.pi / 180.0, 2.0 * math.pi / 60.0, 1e-3)
ALONG = (25.4e-3, 1e-2, 1e-3)


def unit_of(factor: float) -> str | None:
    """Return the unit of a channel that a factor corrects, None if it is not a unit."""
    near = min(UNITS, key=lambda u: abs(math.log(abs(factor) / u)))
    return UNITS[near] if abs(math.log(abs(factor) / near)) < math.log(1.03) else None


def asked_unit(factor: float, command: bool) -> str | None:
    """Return `unit_of`; for a command, `ANGLES` if the unit is one of angles."""
    unit = unit_of(factor)
    return ANGLES if command and unit in ("degrees", "turns", "turns a minute") else unit


def nearest_unit(factor: float, rotary: bool) -> float:
    """Return the common unit (or 1) near a factor, or the factor itself if it is near none.

    The factor comes from a device file, which may be inaccurate.
    """
    common = TURNING if rotary else ALONG
    every = [1.0, *common, *(1.0 / u for u in common)]
    near = min(every, key=lambda u: abs(math.log(abs(factor) / u)))
    close = abs(math.log(abs(factor) / near)) < math.log(INTAKE.near_unit)
    return math.copysign(near if close else abs(factor), factor)


def far_off(factor: float, rotary: bool) -> bool:
    """Whether a factor is near a common unit, and too large for an error of the device file."""
    size = abs(nearest_unit(factor, rotary))
    common = TURNING if rotary else ALONG
    near = any(math.isclose(size, u) or math.isclose(size, 1.0 / u) for u in common)
    return near and abs(math.log(size)) > math.log(INTAKE.far_unit)


def sentence(recording: str, channels: Sequence[str], factor: float) -> str:
    """Say what is wrong with channels of a recording that a factor corrects."""
    command, many = tuple(channels) == ("command",), len(channels) > 1
    what = f"the command of {recording}" if command else f"{' and '.join(channels)} of {recording}"
    entry = "[input]" if command else "each" if many else "its output"
    size = abs(factor)
    if math.isclose(size, 1.0):
        sign = f"sign is inverted; reverse the sign of the scale of {entry}"
        return (
            f"{what} drives the motion backwards: its {sign}"
            if command
            else f"{what} moves against the command: the {sign}"
        )
    times = plain(max(size, 1.0 / size), 3)
    less = f"{times} times too {'small' if size > 1.0 else 'large'}"
    sign = ", and with the wrong sign" if factor < 0.0 else ""
    unit = asked_unit(factor, command)
    asked = f"{'are they' if many else 'is it'} in {unit}?"
    asked = "is the motion in degrees or turns?" if command and unit == ANGLES else asked
    ask = f"check the unit and the scale of {entry}" if unit is None else asked
    return f"{what} {'are' if many else 'is'} {less}{sign} (multiply by {factor:.3g}): {ask}"

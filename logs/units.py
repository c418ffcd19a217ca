"""Units of recordings, and the value of each in SI."""

import math
import re
from typing import NamedTuple

from zwidth.sim.nearest import nearest


class Unit(NamedTuple):
    """A unit: `factor` times the SI unit."""

    si: str
    factor: float


TURN = 2.0 * math.pi
DEGREE = TURN / 360.0
POUND_FORCE = 4.4482216152605  # N, exact by definition
INCH = 0.0254
GRAVITY = 9.80665

UNITS: dict[str, Unit] = {
    # angle and length
    "rad": Unit("rad", 1.0),
    "mrad": Unit("rad", 1e-3),
    "urad": Unit("rad", 1e-6),
    "deg": Unit("rad", DEGREE),
    "mdeg": Unit("rad", DEGREE * 1e-3),
    "arcmin": Unit("rad", DEGREE / 60.0),
    "arcsec": Unit("rad", DEGREE / 3600.0),
    "rev": Unit("rad", TURN),
    "m": Unit("m", 1.0),
    "cm": Unit("m", 1e-2),
    "mm": Unit("m", 1e-3),
    "um": Unit("m", 1e-6),
    "nm": Unit("m", 1e-9),
    "in": Unit("m", INCH),
    # their rates
    "rad/s": Unit("rad/s", 1.0),
    "mrad/s": Unit("rad/s", 1e-3),
    "deg/s": Unit("rad/s", DEGREE),
    "rev/s": Unit("rad/s", TURN),
    "rpm": Unit("rad/s", TURN / 60.0),
    "erpm": Unit("rad/s", TURN / 60.0),  # for one pair of poles; see `ELECTRICAL`
    "m/s": Unit("m/s", 1.0),
    "cm/s": Unit("m/s", 1e-2),
    "mm/s": Unit("m/s", 1e-3),
    "um/s": Unit("m/s", 1e-6),
    "in/s": Unit("m/s", INCH),
    "rad/s2": Unit("rad/s2", 1.0),
    "deg/s2": Unit("rad/s2", DEGREE),
    "rev/s2": Unit("rad/s2", TURN),
    "m/s2": Unit("m/s2", 1.0),
    "mm/s2": Unit("m/s2", 1e-3),
    "g": Unit("m/s2", GRAVITY),
    # torque and force
    "Nm": Unit("N m", 1.0),
    "mNm": Unit("N m", 1e-3),
    "uNm": Unit("N m", 1e-6),
    "Ncm": Unit("N m", 1e-2),
    "Nmm": Unit("N m", 1e-3),
    "kNm": Unit("N m", 1e3),
    "ozfin": Unit("N m", POUND_FORCE / 16.0 * INCH),
    "kgfcm": Unit("N m", GRAVITY * 1e-2),
    "lbfin": Unit("N m", POUND_FORCE * INCH),
    "lbfft": Unit("N m", POUND_FORCE * 12.0 * INCH),
    "N": Unit("N", 1.0),
    "mN": Unit("N", 1e-3),
    "kN": Unit("N", 1e3),
    "kgf": Unit("N", GRAVITY),
    "lbf": Unit("N", POUND_FORCE),
    # input of an amplifier
    "V": Unit("V", 1.0),
    "mV": Unit("V", 1e-3),
    "A": Unit("A", 1.0),
    "mA": Unit("A", 1e-3),
    # output of an encoder
    "counts": Unit("counts", 1.0),
    "counts/s": Unit("counts/s", 1.0),
    "counts/s2": Unit("counts/s2", 1.0),
    # time
    "s": Unit("s", 1.0),
    "ms": Unit("s", 1e-3),
    "us": Unit("s", 1e-6),
    "ns": Unit("s", 1e-9),
    "min": Unit("s", 60.0),
    "hour": Unit("s", 3_600.0),
    "day": Unit("s", 86_400.0),
    "100us": Unit("s", 1e-4),  # SampleTimeFine of Xsens MTi
    "100ns": Unit("s", 1e-7),  # ticks of .NET and of Windows
}

SPELLINGS = {
    "°": "deg", "degree": "deg", "degrees": "deg", "°/s": "deg/s", "degrees/s": "deg/s",
    "°/s2": "deg/s2", "radian": "rad", "radians": "rad", "radians/s": "rad/s",
    "turn": "rev", "turns": "rev", "revs": "rev", "r/min": "rpm", "rev/min": "rpm", "1/min": "rpm",
    "rpms": "rpm", "dps": "deg/s", "rps": "rev/s",
    "step": "counts", "steps": "counts", "lsb": "counts", "lsbs": "counts", "pulse": "counts",
    "pulses": "counts", "qc": "counts", "steps/s": "counts/s", "pulses/s": "counts/s",
    "count": "counts", "cts": "counts", "cnt": "counts", "tick": "counts", "ticks": "counts",
    "inc": "counts",
    "cnt/s": "counts/s", "cnt/sec": "counts/s", "counts/sec": "counts/s", "cps": "counts/s",
    "tps": "counts/s", "count/s": "counts/s", "cts/s": "counts/s", "ticks/s": "counts/s",
    "volt": "V", "volts": "V", "ampere": "A", "amperes": "A", "amp": "A", "amps": "A",
    "newton": "N", "newtons": "N", "metre": "m", "meter": "m", "metres": "m", "meters": "m",
    "inch": "in", "sec": "s", "secs": "s", "second": "s", "seconds": "s", "msec": "ms",
    "usec": "us", "nsec": "ns", "minutes": "min", "m/sec": "m/s", "rad/sec": "rad/s",
    "deg/sec": "deg/s", "newtonmetre": "Nm", "newtonmeter": "Nm",
    "newtonmeters": "Nm", "newtonmetres": "Nm", "milliseconds": "ms", "microseconds": "us",
    "nanoseconds": "ns", "millis": "ms", "micros": "us", "millimeter": "mm", "millimeters": "mm",
    "millivolt": "mV", "millivolts": "mV", "milliamps": "mA", "milliamp": "mA", "kgcm": "kgfcm",
    "hours": "hour", "days": "day", "Grad": "deg", "NM": "Nm", "mNM": "mNm",
    "min1": "rpm", "ozin": "ozfin", "lbin": "lbfin",
}  # fmt: skip
"""Other spellings of the same units, after removal of spaces, dots and stars."""

SI = {
    "position": ("rad", "m"),
    "velocity": ("rad/s", "m/s"),
    "acceleration": ("rad/s2", "m/s2"),
    "force": ("N m", "N"),
    "command": ("N m", "N"),
}
"""Quantity -> its SI unit on a rotary and on a linear device."""
OF_DRIVE = {"enable": ("", ""), "supply": ("V", "V")}
"""The same for the recorded state of a drive."""
GOAL = SI["position"]
"""Further units of a command: a servo's command is the position of its goal."""


ELECTRICAL = "erpm"
"""Turns of the field: n for one turn of a motor with n pole pairs."""


def find_unit(text: str) -> Unit | None:
    """Return the unit with a spelling ("N·m", "deg/s^2", "µm"), or None."""
    spelled = re.sub(r"[\s.·⋅*_-]|\^|\*\*", "", text.strip("[]() "))
    spelled = re.sub("[\u00b5\u03bc]", "u", spelled).replace("²", "2")
    spelled = SPELLINGS.get(spelled, SPELLINGS.get(spelled.lower(), spelled))
    return UNITS.get(spelled) or (UNITS.get(spelled.lower()) if len(spelled) > 2 else None)


def known_unit(text: str, where: str) -> Unit:
    """Return the unit; raises ValueError that begins with `where` and names the nearest one."""
    unit = find_unit(text)
    if unit is None:
        raise ValueError(f"{where} is {text!r}, which is not a known unit; {nearest(text, UNITS)}")
    return unit

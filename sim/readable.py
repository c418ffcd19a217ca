"""Numbers as people write them: with a suitable prefix of the unit, and only the known digits.

Files and JSON have plain SI units; the text for people (headlines, reports, pages) is written here.
"""

import math
import re
from collections.abc import Generator
from contextlib import contextmanager
from contextvars import ContextVar

PREFIXES = {-9: "n", -6: "\u00b5", -3: "m", 0: "", 3: "k", 6: "M"}
NO_KILO = ("rad", "s", "m", "m/s", "rad/s")  # kilosecond and kiloradian are not used
BARE = ("kg m2", "rms motions", "", "%")  # units that take no prefix
UNCOUNTABLE = ("counts", "counts/s", "counts/s2")  # nor do these
TIGHT = 5e-5  # of a value: a narrower interval is given in percent, not by its ends
LARGE = 9.995  # of the motion, from which an error is given as a multiple, not in percent


_scales: ContextVar[tuple[str, str]] = ContextVar("scales", default=("", ""))


@contextmanager
def counted_in(force: str, length: str) -> Generator[None]:
    """Within the block, write forces in the unit of the command, lengths in that of the reading.

    If their scales are not known, one of each counts as one SI unit: a friction of 0.4 N m is then
    written 0.4 A, and an inertia is in A s2/count. force: "A", "V", "counts", length: "counts"; ""
    for a known scale.
    """
    before = _scales.set((force, length))
    try:
        yield
    finally:
        _scales.reset(before)


def as_counted(unit: str) -> str:
    """Return the text for an SI unit if scales are not known (`counted_in`)."""
    force, length = _scales.get()
    if not (force or length):
        return unit
    turns = "rad" in unit or "N m" in unit or unit == "kg m2"
    f, way = force or ("N m" if turns else "N"), length or ("rad" if turns else "m")
    per = way.removesuffix("s") if way == "counts" else way
    if unit in ("kg m2", "kg"):
        return f"{f} s2/{per}"
    above, line, below = unit.partition("/")
    said = re.sub(r"\bN m\b|\bN\b", f, above)
    if not re.search(r"\bN\b", above):  # the metre of a torque is not a length of travel
        said = re.sub(r"\b(?:rad|m)(?=\d?\b)", way, said)
    return f"{said}{line}{re.sub(r'(?:rad|m)(?=[0-9]?$|[0-9]? )', per, below)}"


def with_unit(value: float, unit: str, digits: int = 4) -> str:
    """Return a value with the prefix for a number between 1 and 1000: 2e-3, "N m" -> "2 mN m".

    Infinity is "none" (a limit that limits nothing), NaN "unknown".
    """
    if not math.isfinite(value):
        return "none" if value > 0.0 else "unknown"
    factor, shown = scaled(value, unit)
    number = plain(factor * value, digits)
    if number in ("1", "-1") and shown.startswith("counts"):
        shown = shown.replace("counts", "count", 1)
    return f"{number} {shown}".rstrip()


def scaled(size: float, unit: str) -> tuple[float, str]:
    """Return the factor and the unit by which a quantity of this size [unit] is written.

    The same for an axis: 2e-3, "rad" -> (1e3, "mrad"). Masses go from gram to kilogram; inertias
    stay in kg m2, and angles, lengths and times never get a kilo.
    """
    unit = as_counted(unit)
    if unit == "kg":
        return (1.0, "kg") if not 0.0 < abs(size) < 0.9995 else _by_prefix(1e3 * size, "g", 1e3)
    if unit in BARE or unit in UNCOUNTABLE or not (unit[0].isalpha() and math.isfinite(size)):
        return 1.0, unit
    return _by_prefix(size, unit, 1.0)


def _by_prefix(size: float, unit: str, already: float) -> tuple[float, str]:
    power, letter = prefix(size)
    if power > 0 and unit in NO_KILO:
        power, letter = 0, ""
    return already * 10.0 ** (-power), letter + unit


def prefix(value: float) -> tuple[int, str]:
    """Return the power of ten, and its letter, for a number between 1 and 1000."""
    if value == 0.0 or not math.isfinite(value):
        return 0, ""
    power = 3 * math.floor(math.log10(abs(value)) / 3.0 + 1e-9)
    power = min(max(power, min(PREFIXES)), max(PREFIXES))
    return power, PREFIXES[power]


def plain(value: float, digits: int = 4) -> str:
    """Return a number with some significant digits, as people write it: 2.05e-4, 12400."""
    text = f"{value:.{digits}g}"
    if 0.0 < abs(value) < 1e-3 and "e" not in text:
        text = f"{value:.{digits - 1}e}"
        mantissa, _, exponent = text.partition("e")
        text = f"{mantissa.rstrip('0').rstrip('.')}e{exponent}" if "." in mantissa else text
    if "e" not in text:
        return text
    if 1.0 <= abs(value) < 1e6:
        return f"{float(text):.0f}"
    mantissa, _, exponent = text.partition("e")
    return f"{mantissa}e{int(exponent)}"


def number(value: float) -> str:
    """Four significant digits; a dash for unknown."""
    return plain(value) if math.isfinite(value) else "-"


def interval(value: float, lower: float, upper: float, unit: str) -> str:
    """Return a value with its interval, to the digits that the interval determines.

    0.0201, 0.0197, 0.0205, "N m" -> "20.1 mN m (19.7 to 20.5)"; five digits and "(within 0.01 %)"
    if more than four are known; without an interval if its ends are not known.
    """
    half = 0.5 * (upper - lower)
    if not math.isfinite(value):
        return "-"
    if not (math.isfinite(half) and half > 0.0):
        return with_unit(value, unit)
    if half < TIGHT * abs(value):
        factor, shown = scaled(value, unit)
        text = f"{factor * value:#.5g}".rstrip(".").replace("e-0", "e-")
        within = "0.01 %" if half > 1e-5 * abs(value) else "0.001 %"
        return f"{text} {shown}".rstrip() + f" (within {within})"
    shown, texts = _known(value, lower, upper, unit)
    said = f"{texts[0]} {shown}".rstrip()
    return f"{said} ({texts[1]} to {texts[2]})"


def without_interval(value: float, lower: float, upper: float, unit: str, most: int = 3) -> str:
    """Return a value to the digits that its interval determines, at most `most`.

    0.0250004, 0.0249990, 0.0250018, "N m" -> "25.0 mN m"; 10.2, 6.0, 13.0, "N" -> "10 N".
    """
    half = 0.5 * (upper - lower)
    if not (math.isfinite(value) and math.isfinite(half) and half > 0.0):
        return interval(value, lower, upper, unit)
    rounded = f"{value:.{most - 1}e}"
    least = 5.0 * 10.0 ** (int(rounded.partition("e")[2]) - most + 1) if value else 0.0
    if half < least:
        value, half = float(rounded), least
    shown, texts = _known(value, value - half, value + half, unit)
    return f"{texts[0]} {shown}".rstrip()


def _known(value: float, lower: float, upper: float, unit: str) -> tuple[str, list[str]]:
    """Return the unit, and value and ends to the digits that the interval knows."""
    half = 0.5 * (upper - lower)
    factor, shown = scaled(max(abs(value), half), unit)
    first = math.floor(math.log10(factor * half))
    leading = factor * half / 10.0**first
    decimals = (1 if leading < 2.0 else 0) - first  # two digits of 0.014, one of 0.044
    size = factor * max(abs(value), half)
    if (decimals > 5 and size < 1e-3) or size >= 1e6:  # exponents, to the same digits
        digits = max(2, decimals + 1 + math.floor(math.log10(size)))
        return shown, [_exponent(factor * v, digits) for v in (value, lower, upper)]
    return shown, [_rounded(factor * v, decimals) for v in (value, lower, upper)]


def _exponent(value: float, digits: int) -> str:
    mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
    return "0" if value == 0.0 else f"{mantissa}e{int(exponent)}"


def _rounded(value: float, decimals: int) -> str:
    text = f"{round(value, decimals):.{max(decimals, 0)}f}"
    return text.removeprefix("-") if float(text) == 0.0 else text


def percent(share: float) -> str:
    """Return a share of the motion as people say it: "2.1 %", "14 times", "without bound"."""
    if math.isnan(share):
        return "unknown"
    if not share < 1e6:
        return "without bound"
    if share >= LARGE:
        return f"{plain(share, 3)} times"
    return f"{plain(100.0 * share, 3 if share >= 1.0 else 2)} %"


def of_the_motion(share: float) -> str:
    """Return an error over the motion in words: "2.1 % of the motion", "14 times the motion"."""
    text = percent(share)
    if text.endswith("%"):
        return f"{text} of the motion"
    return f"{text} the motion" if text.endswith("times") else text


def most(share: float) -> str:
    """Return a share or a probability up to one; no value below one is written as 100 %."""
    return "over 99.9 %" if share > 0.9995 else f"{100.0 * share:.3g} %"

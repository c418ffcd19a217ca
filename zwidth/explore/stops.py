"""Where a slider can stand, and how its values are written for people."""

import math
from dataclasses import dataclass

OWN = " (the device's)"
FIRST_DIGITS = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
PREFIXES = {-9: "n", -6: "\u00b5", -3: "m", 0: "", 3: "k", 6: "M"}


def decades(low: int, high: int) -> list[float]:
    """Return six values a decade, from 10^low to 10^high."""
    exact = [float(f"{d:g}e{n}") for n in range(low, high) for d in FIRST_DIGITS]
    return [*exact, float(f"1e{high}")]


def with_unit(value: float, unit: str, digits: int = 4) -> str:
    """Return a value with the prefix that brings it between 1 and 1000: 2e-3, "N m" -> "2 mN m"."""
    if not math.isfinite(value):
        return "none" if value > 0.0 else "unknown"
    if value == 0.0:
        return f"0 {unit}"
    power, letter = prefix(value)
    return f"{value / 10.0**power:.{digits}g} {letter}{unit}"


def prefix(value: float) -> tuple[int, str]:
    """Return the power of ten, and its letter, that bring a value between 1 and 1000."""
    if value == 0.0 or not math.isfinite(value):
        return 0, ""
    power = 3 * math.floor(math.log10(abs(value)) / 3.0 + 1e-9)
    power = min(max(power, min(PREFIXES)), max(PREFIXES))
    return power, PREFIXES[power]


@dataclass(frozen=True)
class Stops:
    """The values of a slider and what is written at them, in the order in which they stand."""

    values: tuple[float, ...]
    labels: tuple[str, ...]

    def label(self, value: float) -> str:
        """Return what is written at a value that is one of them."""
        return self.labels[self.values.index(value)]

    def value(self, label: str) -> float:
        """Return the value at which this is written."""
        return self.values[self.labels.index(label)]


def stops(
    values: list[float], unit: str, own: float | None, present: float, nothing: float | None
) -> Stops:
    """Return stops at values, at the device's own value and at the present one.

    nothing: the value written as "none". The device's own is marked as such.
    """
    added = {v for v in (own, present, nothing) if v is not None}
    everything = sorted({*values, *added})
    labels: list[str] = []
    for value in everything:
        text = "none" if value == nothing else with_unit(value, unit)
        if text in labels or text + OWN in labels:
            text = "none" if value == nothing else with_unit(value, unit, digits=15)
        labels.append(text + (OWN if value == own else ""))
    return Stops(tuple(everything), tuple(labels))

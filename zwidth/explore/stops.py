"""The possible values of a slider, and how they are written for people."""

from dataclasses import dataclass

from zwidth.sim.readable import with_unit

OWN = " (the device's)"
FIRST_DIGITS = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)


def decades(low: int, high: int) -> list[float]:
    """Return six values per decade, from 10^low to 10^high."""
    exact = [float(f"{d:g}e{n}") for n in range(low, high) for d in FIRST_DIGITS]
    return [*exact, float(f"1e{high}")]


@dataclass(frozen=True)
class Stops:
    """The values of a slider and their labels, in the order of the slider."""

    values: tuple[float, ...]
    labels: tuple[str, ...]

    def label(self, value: float) -> str:
        """Return the label of one of the values."""
        return self.labels[self.values.index(value)]

    def value(self, label: str) -> float:
        """Return the value with a label."""
        return self.values[self.labels.index(label)]


def stops(
    values: list[float], unit: str, own: float | None, present: float, nothing: float | None
) -> Stops:
    """Return stops at values, at the device's own value, and at the present one.

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

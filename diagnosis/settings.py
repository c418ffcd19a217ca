"""The numbers that decide what a diagnosis says, all of them.

One frozen class a part of the pipeline, one field a number. Under each stand its unit, where it
comes from (derived, by convention, elicited from engineers, or tuned) and the data behind it. What
only steers a method (rounds of a solver, a guard against rounding) stands with the method, as the
default of an argument; nothing there may change what is said of a recording.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Evidence:
    """When one hypothesis is believed over another."""

    alpha: float = 1e-3
    """Odds at which what is not true is believed over what is. Convention."""


EVIDENCE = Evidence()


@dataclass(frozen=True)
class Scales:
    """How slow a search begins."""

    slower: int = int(__import__('os').environ.get('ZW_SLOW','1'))
    """Times the recorded period. Tuned: machines at 100 to 1000 Hz, read at a fifth of their rate,
    kept the names that move them and lost those of clocks and filters."""
    least_ticks: int = 1200
    """Ticks that recordings keep together. Derived: an observer is given 100 ticks to settle, and
    a filter of order 8 wants a hundred samples a coefficient."""


SCALES = Scales()

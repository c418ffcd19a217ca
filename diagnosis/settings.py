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
class Laws:
    """When a law of no name is sought, kept, and called by a formula."""

    better: float = 0.8
    """Share of the names' error of free runs on other data, below which a law is kept. Tuned:
    nobody would act on less, and slow chance forces can make as much (of 13 recordings without a
    law one got a law that left 0.94, `benchmarks/learned_laws.py`)."""

    comes_back: float = 1.5
    """Times that each state is met on the mean, below which it tells time and no law is sought over
    it: half of the states twice. Derived."""

    left: float = 2.0
    """Share of the square of the noise of free runs, from which their error's square leaves
    something for a law over two states: half of it is then something else. Derived."""

    within: float = 0.01
    """Chance of a distance as large, above which a formula is within a law's band. Convention."""

    even: float = 2.0
    """-2 ln, within which two formulas are even, and that of the fewest numbers is said: "not worth
    more than a bare mention". Convention (Kass & Raftery, J. Am. Stat. Assoc. 90, 1995)."""

    apart: float = 6.0
    """-2 ln, from which two formulas are told apart: "strong" evidence. Convention (as above)."""


LAWS = Laws()

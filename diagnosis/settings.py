"""The numbers that decide what a diagnosis says, all of them.

One frozen class a part of the pipeline, one field a number. Under each stand its unit, where it
comes from (derived, by convention, elicited from engineers, or tuned) and the data behind it. What
only steers a method (rounds of a solver, a guard against rounding) stands with the method, as the
default of an argument; nothing there may change what is said of a recording.
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Evidence:
    """When one hypothesis is believed over another."""

    alpha: float = 1e-3
    """Odds at which what is not true is believed over what is. Convention."""


EVIDENCE = Evidence()


@dataclass(frozen=True)
class Changes:
    """What is believed to change while a device is recorded, or to happen once."""

    prior: float = 0.05
    """Share of recordings in which a parameter changes, and of those in which something happens.
    Elicited: most recordings are of one device that is left alone."""

    most: int = 4
    """Changes, and events, of all recordings together. By convention: what is more often is physics
    that is missing."""

    @property
    def rarity(self) -> float:
        """What a change pays for being rare, in -2 ln."""
        return 2.0 * math.log((1.0 - self.prior) / self.prior)

    @property
    def within(self) -> float:
        """In -2 ln, what a number costs less than at the ends of its 95 % interval (chi-square)."""
        return 3.84

    @property
    def dated(self) -> float:
        """The same of the time of a step: P(xi <= z) = (1 - exp(-z / 2))^2.

        Of a step that is small against its noise (Hansen, Econometrica 68, 2000).
        """
        return -2.0 * math.log(1.0 - math.sqrt(0.95))


CHANGES = Changes()


@dataclass(frozen=True)
class Events:
    """What something was that happened once."""

    longest_s: float = 3.0
    """How long an event lasts at most [s]: a hand. By convention; what acts longer is a change."""

    short_s: float = 0.05
    """What lasts less is a hit, what lasts twice as long a hand [s]. By convention: steel on steel
    takes 1 ms, rubber 10 ms, a tap with a finger 50 ms."""

    slow: float = 0.1
    """Share of a speed that is no motion: of the usual one where a device is held, of that before
    where it met a stop. Tuned on `benchmarks/events.py`."""

    at_end: float = 0.03
    """Share of the travel from its end within which a stop is. Tuned on `benchmarks/events.py`."""

    ended: float = 0.1
    """Share of how long a force acted for which it must be seen not to act any more. Tuned: a
    parameter that changes shortly before the last sample looks like a force until then."""


EVENTS = Events()

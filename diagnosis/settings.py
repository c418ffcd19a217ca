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
class Residual:
    """When a force is left that no effect explains, and what is said of where it is."""

    odds: float = 1e-8
    """Odds per recording at which chance alone shows such a force. Tuned: far below
    `Evidence.alpha`, since drawn noise is not the noise of every machine. It stands for chi-squares
    of 60 (8 unknowns) and of 60 + 1.5 an unknown, and for once in 1e8 recordings of a wave, which
    were tuned one by one on recordings in which nothing was missing."""

    slower: float = 1e-2
    """Ratio of process to measurement noise, over the likeliest, under which forces are sought that
    the likeliest observer takes for disturbance. Tuned on friction and stops of simulated
    machines."""

    telling: float = 0.25
    """Share of the excess of the residual in a part of the motion that is worth a sentence.
    Convention."""

    denser: float = 1.5
    """How much denser than elsewhere it lies there at least. Convention."""


RESIDUAL = Residual()

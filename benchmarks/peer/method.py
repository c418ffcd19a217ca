"""What a method hands back, and the state that a free run begins with."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Foretold:
    """What a method foretells of the held-out part (ticks, o), and what it found, in a sentence.

    also: what the same fit foretells in another form, by its name in the table.
    """

    held: Floats
    found: str
    also: dict[str, Floats] = field(default_factory=dict[str, Floats])


def state_before(
    simulated: Callable[[Floats], Floats], measured: Floats, guess: Floats, scale: Floats
) -> Floats:
    """Return the state (s,) at the first of measured samples (ticks, o) that explains them best.

    simulated: gives the outputs (ticks, o) of a free run from a state. guess, scale (s,): where to
    begin, and how far each state may be off. Used on the last samples before the held-out part.
    """
    swing = np.maximum(measured.std(axis=0), 1e-12)

    def off(z: Floats) -> Floats:
        with np.errstate(all="ignore"):
            errors = ((simulated(guess + scale * z) - measured) / swing).ravel()
        return np.where(np.isfinite(errors), np.clip(errors, -1e3, 1e3), 1e3)

    found = least_squares(off, np.zeros(guess.size), max_nfev=30)
    return guess + scale * found.x if math.isfinite(found.cost) else guess

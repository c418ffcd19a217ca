"""What a recording can show: how many sigma of an effect a refit of the device cannot absorb.

Let e(device) be the innovations under a fixed observer, in units of their deviations. The signature
of an effect is s = e(device with the effect) - e(device), and J has the derivatives of e by masses,
dampers and springs, and by the other quantities that a refit absorbs: delay, constant force and
spring to ground. A matched filter with a refit of all these sees the effect at

    sigma = |(I - P) s|,    P the projector on the span of J:

which is the square root of the chi-square that a fit gains by the effect if the effect is true (for
one parameter this is the Cramer-Rao bound). If the effect is itself one of these quantities, that
one is left out of the refit. Signatures of clipping, free play and steps are not linear in
magnitude, so the magnitude at which sigma = 5 is found by bracketing. The clock's skew has the
effect of a delay and is only limited by its prior: a delay of d has a sigma of at most d over the
prior's width.

Limits: J and s are computed for one device on one recording. For an encoder's step only the gain in
prediction counts, not the fact that all values are then multiples of the step.
"""

from collections.abc import Callable
from math import exp, isfinite, log

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.model.parameters import SKEW_SCALE
from zwidth.diagnosis.seeking.magnitude import magnitude, strengthened
from zwidth.planning.reference import Reference, reference
from zwidth.planning.rehearsal import Noise
from zwidth.planning.separation import separation
from zwidth.sim.physics.dropped_samples import dropped_samples
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.loop_delay import loop_delay

__all__ = ["SHOWN", "Noise", "Reference", "limit", "magnitude", "reference", "separation", "sigma",
           "strengthened"]  # fmt: skip

Floats = NDArray[np.float64]
SHOWN = 5.0  # sigma at which an effect counts as visible
CLOSE = 0.02  # relative tolerance of sigma at the returned magnitude
JUMP = 1e-5  # relative width at which a bracket is narrow enough, even if sigma jumps in it
DROPS = 50  # lost commands from which the effect of one is estimated
WEAKEST, STRONGEST = 1e-12, 1e6  # range of factors on the magnitude in which a limit is sought
TRIES = 80


def sigma(reference: Reference, physics: Physics) -> float:
    """Return at how many sigma an effect with these values is visible after a refit.

    dropped_samples: the mean over possible sets of lost commands, zero if fewer than one is lost.
    """
    name = physics.effect.name
    if name == dropped_samples.name:
        return _lost(reference, physics.values["rate"])
    found = float(np.linalg.norm(reference.off(name)(reference.signature(physics))))
    if name == loop_delay.name:
        period = reference.experiments[0].period
        return min(found, physics.values["delay"] / (SKEW_SCALE * period))
    return found


def _lost(reference: Reference, rate: float) -> float:
    """Few losses add up in chi-square, so it is measured at a higher rate and scaled down."""
    if rate * reference.ticks < 1.0:
        return 0.0
    tried = min(1.0, max(rate, DROPS / reference.ticks))
    signature = reference.signature(Physics(dropped_samples, "clock", {"rate": tried}))
    return float(np.linalg.norm(reference.off()(signature))) * (rate / tried) ** 0.5


def limit(reference: Reference, physics: Physics) -> Physics | None:
    """Return the effect with its magnitude scaled so that it is at five sigma (`SHOWN`).

    The other parameters (a period, a velocity) stay as given. None if no magnitude reaches five
    sigma, or the effect has no magnitude.
    """

    def sigma_at(factor: float) -> float | None:
        scaled = strengthened(physics, factor, reference.peak)
        return None if scaled is None else sigma(reference, scaled)

    if not magnitude(physics, reference.peak):
        return None
    factor = crossing(sigma_at)
    return None if factor is None else strengthened(physics, factor, reference.peak)


def crossing(sigma_at: Callable[[float], float | None]) -> float | None:
    """Return the factor, near the smallest, at which sigma is 5; None if there is no such factor.

    sigma_at returns None if the effect does not allow a factor. The factor is bracketed in growing
    steps and then found by secants in the logarithms, which are exact for a power law.
    """
    low: tuple[float, float] | None = None
    high: tuple[float, float] | None = None
    beyond: float | None = None
    factor = 1.0
    for _ in range(TRIES):
        if not WEAKEST < factor < STRONGEST:
            return None
        found = sigma_at(factor)
        if found is None or not isfinite(found):
            beyond = factor
        elif abs(found / SHOWN - 1.0) < CLOSE:
            return factor
        elif found < SHOWN:
            low = (factor, found)
        else:
            high = (factor, found)
        if high is not None and low is not None:
            if high[0] / low[0] < 1.0 + JUMP:
                return high[0]
            factor = _between(low, high)
        elif high is not None:
            factor = high[0] * max(1e-3, min(0.67, 0.77 * SHOWN / high[1]))
        elif low is not None and beyond is None:
            factor = low[0] * (min(1e3, max(1.5, 1.3 * SHOWN / low[1])) if low[1] > 0.0 else 10.0)
        elif low is not None and beyond is not None:
            if beyond / low[0] < 1.0 + JUMP:
                return None
            factor = (low[0] * beyond) ** 0.5
        else:
            factor *= 0.1
    return None if high is None else high[0]


def _between(low: tuple[float, float], high: tuple[float, float]) -> float:
    """Secant in logarithms, kept inside the inner 90 % of the bracket."""
    a, b = log(low[0]), log(high[0])
    share = log(SHOWN / low[1]) / log(high[1] / low[1]) if low[1] > 0.0 else 0.5
    return exp(a + min(0.95, max(0.05, share)) * (b - a))

"""The strength of an effect as one number, in which detection limits are given."""

import math
from collections.abc import Mapping
from dataclasses import replace

from zwidth.sim.physics.effect import Effect, Physics


def magnitude(physics: Physics, peak: float = math.inf) -> float | None:
    """Return the strength of an effect, zero for no effect; None if it has no such number.

    For example, the level of a friction, the absolute coefficient of a cubic spring, |ratio - 1| of
    a gain asymmetry, how far the limit of a saturation is below the largest command `peak`, and the
    reciprocal of a limit of a rate or over speed (`Parameter.inverse`).
    """
    name = physics.effect.strength
    if name is None:
        return None
    parameter, value = physics.effect.parameter(name), physics.values[name]
    if parameter.inverse:
        return 1.0 / value
    if parameter.neutral == math.inf:
        return max(0.0, peak - value)
    return abs(value - parameter.none_of_it())


def strengthened(physics: Physics, factor: float, peak: float = math.inf) -> Physics | None:
    """Return the effect with a multiple of its strength; None if its bounds do not allow it.

    Parameters of shape (a ripple's period, a Stribeck velocity) stay.
    """
    effect, values = physics.effect, dict(physics.values)
    if effect.strength is None:
        return None
    for name in effect.magnitudes or (effect.strength,):
        if effect.parameter(name).inverse:
            values[name] /= factor
            continue
        none = effect.parameter(name).none_of_it(peak)
        values[name] = none + factor * (values[name] - none)
    return replace(physics, values=values) if within_bounds(effect, values) else None


def within_bounds(effect: Effect, values: Mapping[str, float]) -> bool:
    """Whether a device may have the effect with these values."""
    return all(p.lower <= values[p.name] <= p.upper for p in effect.parameters)

"""How strong an effect is, as one number: what a limit is given in, and what may be scaled."""

import math
from dataclasses import replace

from zwidth.diagnosis.candidates import MAGNITUDE
from zwidth.sim.physics.effect import Physics

STEPS = {"command_step": "step", "encoder_step": "step", "dropped_samples": "rate"}


def magnitude_name(physics: Physics) -> str | None:
    """Return the parameter that says how strong an effect is, None where there is none."""
    name = physics.effect.name
    if name in MAGNITUDE:
        return MAGNITUDE[name][0]
    return {"saturation": "limit", "gain_asymmetry": "ratio", **STEPS}.get(name)


def magnitude(physics: Physics, peak: float = math.inf) -> float | None:
    """Return how strong an effect is, zero for not at all; None where there is no such number.

    Of friction the level, of a cubic spring the absolute coefficient, of a gain asymmetry
    |ratio - 1|, of a saturation how far its limit lies below the largest command, `peak`.
    """
    key = magnitude_name(physics)
    if key is None:
        return None
    value = physics.values[key]
    if physics.effect.name == "saturation":
        return max(0.0, peak - value)
    return abs(value - 1.0) if physics.effect.name == "gain_asymmetry" else abs(value)


def strengthened(physics: Physics, factor: float, peak: float = math.inf) -> Physics | None:
    """Return the effect a factor as strong; None where its parameters do not reach that far.

    What says how large and not how strong (a ripple's period, a Stribeck velocity) stays.
    """
    name, values = physics.effect.name, dict(physics.values)
    if name in MAGNITUDE:
        values |= {key: factor * values[key] for key in MAGNITUDE[name]}
    elif name == "saturation":
        values["limit"] = peak - factor * (peak - values["limit"])
        if values["limit"] <= 0.0:
            return None
    elif name == "gain_asymmetry":
        values["ratio"] = 1.0 + factor * (values["ratio"] - 1.0)
    elif name in STEPS:
        values[STEPS[name]] *= factor
    else:
        return None
    inside = all(p.lower <= values[p.name] <= p.upper for p in physics.effect.parameters)
    return replace(physics, values=values) if inside else None

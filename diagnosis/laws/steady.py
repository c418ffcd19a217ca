"""What laws give in steady motion over one state, named and learned, one by one and together.

What acts at a place over a velocity is the sum of all laws there that follow it: friction, a drag,
a table. A dry force slides at its bound; a bristle that has bent to its end pulls by its level. A
law that follows another state as well, or the path, is no part of such a sum, and is left out.

The sum is the curve that an engineer measures, and has the band that the covariance C of all
parameters gives it,

    sum over laws of f(s; x),    J C J',    J its slopes by x.

A straight part is the device's own damper or spring as well, and is left to that.

Whether a law makes energy is asked of that sum. A force over a velocity feeds the motion where
f(v) v > 0, what of it is straight being its place's damper b as well: f(v) - b v. A force over a
position, or over what a link gives way, is the slope of an energy: round any closed path it makes
none. What enters by the command or the reading is driven, and no part that could be passive.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.fit import Fitted
from zwidth.diagnosis.fitting.uncertainty import Z95, covariance, covariance_beside
from zwidth.diagnosis.laws.points import law_at
from zwidth.sim.physics.dispatch import (
    amplified,
    force_over_states,
    friction_bounds,
    is_over_states,
    sensed,
    smooth_force,
)
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_law import is_table
from zwidth.sim.physics.points import named_states
from zwidth.sim.place import Place

Floats = NDArray[np.float64]
STATES = {"free_spring": "q", "free_damper": "v", "free_amplifier": "u", "free_sensor": "q"}
HOOKS = {"free_amplifier": "command", "free_sensor": "sensor"}
OF_MEMORY = ("hysteresis", "backlash")  # what they give depends on the path


def along(law: Physics, curve: str, at: Floats) -> Floats | None:
    """Return what a law gives at states (points,) of a curve, such as "free_damper".

    None where it enters elsewhere than such a curve does, or follows more than that state.
    """
    effect = law.effect
    if is_table(effect.parameters):
        return law_at(law, at) if effect.name == curve else None
    over = named_states(law)
    force = effect.hook in ("force", "friction")
    enters = force if curve not in HOOKS else effect.hook == HOOKS[curve]
    if len(over) > 1 or "time" in over or effect.borrows or not enters:
        return None
    state = STATES[curve]
    if effect.name == "presliding_friction":  # whose memory sliding exhausts
        return -law.values["level"] * np.sign(at) if state == "v" else None
    if effect.code == 0 or effect.name in OF_MEMORY:
        return None
    p = law.vector()
    asides = ((0.0, 0.0, 0.0), (0.7, -0.4, 0.9), (-1.3, 0.8, -0.5))  # what the other states are
    found = [np.array([_gives(law, state, s, aside, p) for s in at]) for aside in asides]
    size = float(np.abs(found[0]).max())
    alike = all(np.abs(other - found[0]).max() <= 1e-9 * size for other in found[1:])
    return found[0] if alike else None


def _gives(
    law: Physics, state: str, value: float, aside: tuple[float, float, float], p: Floats
) -> float:
    """A law at one state, the others aside."""
    q, v, u = (value if name == state else other for name, other in zip("qvu", aside, strict=True))
    code = law.effect.code
    match law.effect.hook:
        case "friction":
            lower, upper, _, _ = friction_bounds(code, q, v, u, 1.0, p)
            return float(lower if v > 0.0 else upper if v < 0.0 else 0.0)
        case "command":
            return float(amplified(code, u, p)) - u
        case "sensor":
            return float(sensed(code, q, p)) - q
        case _ if is_over_states(code):  # over one state that is no time
            return float(force_over_states(code, q, v, u, 0.0, p))
        case _:
            return float(smooth_force(code, q, v, 0.0, u, u, 1.0, p))


def follows(law: Physics, curve: str, place: Place) -> bool:
    """Whether a law acts at a place and follows the state of a curve ("free_damper") alone."""
    there = law.place.acts_on == place.acts_on
    return there and along(law, curve, np.array([-1.0, 0.5])) is not None


@dataclass(frozen=True)
class Together:
    """The sum of the laws that follow one state at one place.

    names: of those that are no table. states, forces, lower, upper (points,): the sum with its 95 %
    band; covariance (points, points) of the forces.
    """

    names: tuple[str, ...]
    states: Floats
    forces: Floats
    lower: Floats
    upper: Floats
    covariance: Floats


def together(
    fitted: Fitted, curve: str, place: Place, states: Floats, bends: bool = False
) -> Together | None:
    """Return what the laws of a fit that follow a curve's state at a place give at some states.

    None where no name does. states (points,): none of them rest, where friction has no value.
    bends: whether the band is that of the bends alone, beside damper, spring and origin as they
    were fitted, which a line and a constant are as well.
    """
    model, x = fitted.model, fitted.x
    effects = model.effects_at(x)
    mine = [i for i, law in enumerate(effects) if follows(law, curve, place)]
    names = tuple(
        named(effects[i]) for i in mine if not is_table(effects[i].effect.parameters)
    )  # fmt: skip
    if not names:
        return None

    def whole(x: Floats) -> Floats:
        own = model.effects_at(x)
        given = [along(own[i], curve, states) for i in mine]
        return np.sum([g for g in given if g is not None], axis=0)

    forces, step = whole(x), 1e-3
    slopes = np.zeros((states.size, x.size))
    for j, p in enumerate(model.parameters):
        if p.kind == "effect" and p.index in mine:
            moved = x.copy()
            moved[j] += step
            slopes[:, j] = (whole(moved) - forces) / step
    gauges = _line_and_constant(fitted, curve, place) if bends else []
    spread = covariance_beside(fitted, gauges) if gauges else covariance(fitted)
    spread[~np.isfinite(spread)] = 0.0
    known = slopes @ spread @ slopes.T
    half = Z95 * np.sqrt(np.maximum(np.diag(known), 0.0))
    return Together(names, states, forces, forces - half, forces + half, known)


def _line_and_constant(fitted: Fitted, curve: str, place: Place) -> list[int]:
    """The places in x of what a line and a constant over a curve's state are as well."""
    link = int(place.kind == "link")
    kinds = {"free_damper": ("damper", "link"), "free_spring": ("k0", "spring")}
    kind = kinds[curve][link] if curve in kinds else ""
    return [
        j
        for j, p in enumerate(fitted.model.parameters)
        if p.kind == "origin" or (p.kind == kind and p.index == place.index)
    ]


def named(law: Physics) -> str:
    """Return an effect as answers name it: "coulomb_friction at m1"."""
    return f"{law.effect.name} at {law.at}"

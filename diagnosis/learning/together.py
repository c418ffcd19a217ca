"""Total force at a place over one state: learned law plus named effects, as one curve.

A measured friction curve is the sum of named effects (friction, a drag) and a learned table. So
laws that depend on the same state at the same place (`steady.along`) are added, with the band from
the covariance of all their parameters,

    sum over laws of f(s; x),    J C J',    J its slopes by x, C of the fit.

A straight part cannot be distinguished from the device's own damper or spring.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.fit import Fitted
from zwidth.diagnosis.fitting.uncertainty import Z95, covariance, covariance_beside
from zwidth.diagnosis.learning.steady import along
from zwidth.diagnosis.model.parameters import Model
from zwidth.shown import Valued
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_law import is_table
from zwidth.sim.place import Place

Floats = NDArray[np.float64]
STEP = 1e-3  # in x, for the difference quotient of the sum


@dataclass(frozen=True)
class Together(Valued):
    """The sum of the laws over one state at one place.

    names: of the effects that are not tables. states, forces, lower, upper (points,): the sum with
    its 95 % band; covariance (points, points) of the forces.
    """

    names: tuple[str, ...]
    states: Floats
    forces: Floats
    lower: Floats
    upper: Floats
    covariance: Floats


def follows(law: Physics, curve: str, place: Place) -> bool:
    """Whether a law acts at a place and depends only on the state of a curve ("free_damper")."""
    there = law.place.acts_on == place.acts_on
    return there and along(law, curve, np.array([-1.0, 0.5])) is not None


def together(
    fitted: Fitted, curve: str, place: Place, states: Floats, bends: bool = False
) -> Together | None:
    """Return the sum of a fit's laws over a curve's state at a place; None if it has no effect.

    states (points,): not zero, where friction has no value. bends: whether the band is that of the
    curvature alone, with damper, spring and origin (equivalent to a line and a constant) as fitted.
    """
    model, x = fitted.model, fitted.x
    effects = model.effects_at(x)
    mine = [i for i, law in enumerate(effects) if follows(law, curve, place)]
    names = tuple(f"{effects[i].effect.name} at {effects[i].at}" for i in mine
                  if not is_table(effects[i].effect.parameters))  # fmt: skip
    if not names:
        return None

    def whole(x: Floats) -> Floats:
        own = model.effects_at(x)
        given = [along(own[i], curve, states) for i in mine]
        return np.sum([g for g in given if g is not None], axis=0)

    forces = whole(x)
    slopes = np.zeros((states.size, x.size))
    for j, p in enumerate(model.parameters):
        if p.kind == "effect" and p.index in mine:
            moved = x.copy()
            moved[j] += STEP
            slopes[:, j] = (whole(moved) - forces) / STEP
    held = _elsewhere(model, curve, place) if bends else []
    spread = covariance_beside(fitted, held) if held else covariance(fitted)
    spread[~np.isfinite(spread)] = 0.0
    known = slopes @ spread @ slopes.T
    half = Z95 * np.sqrt(np.maximum(np.diag(known), 0.0))
    return Together(names, states, forces, forces - half, forces + half, known)


def _elsewhere(model: Model, curve: str, place: Place) -> list[int]:
    """The indices in x of parameters equivalent to a line and a constant over a curve's state."""
    link = place.kind == "link"
    kinds = {"free_damper": ("damper", "link"), "free_spring": ("k0", "spring")}
    kind = kinds[curve][int(link)] if curve in kinds else ""
    return [
        j
        for j, p in enumerate(model.parameters)
        if p.kind == "origin" or (p.kind == kind and p.index == place.index)
    ]

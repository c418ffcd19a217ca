"""Dry friction of constant level: |f| <= level at rest, f = -level sign(v) in motion."""

from collections.abc import Iterator

import numpy as np

from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Bounds, Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import Sizes, most_friction, up_to
from zwidth.sim.place import MASSES, Place

SHARES = (0.001, 0.004, 0.015, 0.06, 0.2)  # of the rms command


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    for share in SHARES:
        yield {"level": share * z.force}, {"level": share * z.force}


def _sweep(z: Sizes, _: Place) -> Iterator[Scaled]:
    for level in up_to(z.peak):
        yield {"level": level}, {"level": level}


def _bounds(z: Sizes, place: Place) -> Bounds:
    return {"level": (0.0, most_friction(z, place))}


def _drawn(_: np.random.Generator, z: Sizes, __: Place) -> Values:
    return {"level": 0.01 * z.force}


coulomb_friction = Effect(
    name="coulomb_friction",
    summary="dry friction of constant level",
    said="Coulomb friction of {level}",
    formula="f = -level sign(v) in motion,  |f| <= level at rest",
    places=MASSES,
    parameters=(
        Parameter(
            "level",
            "f_c",
            "N m",
            0.0,
            1e6,
            0.0,
            role="magnitude",
            meaning="force at which it slips, and in sliding",
        ),
    ),
    hook="friction",
    code=1,
    mistaken_for=(
        "stribeck_friction",
        "rising_friction",
        "presliding_friction",
        "directional_friction",
        "dead_band",
    ),
    reference="Coulomb 1785; implicit as in Moreau, Unilateral contact and dry friction, 1988",
    prior=0.3,  # bearings, seals, brushes and cables: hardly a mechanism is without
    family="dry friction",
    creased=True,
    weakens=True,
    starts=_starts,
    sweep=_sweep,
    bounds=_bounds,
    drawn=_drawn,
    odds=6.0,
)


@part
def coulomb_bounds(p):
    """Bounds: (lower, upper) sliding, (lower, upper) sticking."""
    return -p[0], p[0], -p[0], p[0]

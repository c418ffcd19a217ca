"""A constant force on a mass: weight, an amplifier's offset, a cable's pull."""

from collections.abc import Iterator

import numpy as np

from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import Sizes, sign, up_to
from zwidth.sim.place import MASSES, Place


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    for share in (0.01, -0.01):
        yield {"level": share * z.force}, {"level": abs(share) * z.force}


def _sweep(z: Sizes, _: Place) -> Iterator[Scaled]:
    for level in up_to(z.peak):
        yield {"level": level}, {"level": level}
        yield {"level": -level}, {"level": level}


def _drawn(random: np.random.Generator, z: Sizes, _: Place) -> Values:
    return {"level": sign(random) * 0.01 * z.force}


constant_force = Effect(
    name="constant_force",
    summary="a constant force or offset",
    formula="f = level",
    places=MASSES,
    parameters=(
        Parameter(
            "level",
            "f_0",
            "N m",
            -1e6,
            1e6,
            0.0,
            role="magnitude",
            meaning="the force, positive along the position",
        ),
    ),
    hook="force",
    code=3,
    mistaken_for=("gravity_pendulum", "gain_asymmetry"),
    reference="-",
    prior=0.1,  # an amplifier's offset, a cable, weight on a slide
    elsewhere=0.03,  # weight and cables only: an offset of the command is a force on m1
    absorbed=True,
    known_if_sprung="straight",
    starts=_starts,
    sweep=_sweep,
    drawn=_drawn,
    odds=1.5,
)


@part
def constant_level(p):
    """Return the force."""
    return p[0]

"""Weight of a pendulum that turns with a mass: f = -level sin(q + angle).

level: weight times lever; angle: of the pendulum at q = 0, from hanging straight down.
"""

import math
from collections.abc import Iterator

import numpy as np

from zwidth.sim.elementary import sin
from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import QUARTER, Sizes, turn, up_to
from zwidth.sim.place import MASSES, Place


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    for share in (0.01, 0.1, 0.5):
        for angle in (0.0, QUARTER):
            level = share * z.force
            yield {"level": level, "angle": angle}, {"level": level, "angle": 0.5}


def _sweep(z: Sizes, _: Place) -> Iterator[Scaled]:
    for level in up_to(z.peak):
        for angle in (-QUARTER, 0.0, QUARTER, 2.0 * QUARTER):
            yield {"level": level, "angle": angle}, {"level": level, "angle": 0.5}


def _drawn(random: np.random.Generator, z: Sizes, _: Place) -> Values:
    return {"level": 0.01 * z.force, "angle": turn(random)}


gravity_pendulum = Effect(
    name="gravity_pendulum",
    summary="weight on a lever that turns with the axis",
    formula="f = -level sin(q + angle)",
    places=MASSES,
    parameters=(
        Parameter(
            "level",
            "f_g",
            "N m",
            0.0,
            1e6,
            0.0,
            role="magnitude",
            meaning="weight times lever: the most that it pulls",
        ),
        Parameter(
            "angle",
            "phi_g",
            "rad",
            -2.0 * math.pi,
            2.0 * math.pi,
            None,
            role="turning",
            meaning="how far from hanging straight down it is at position 0",
        ),
    ),
    hook="force",
    code=6,
    mistaken_for=("ground_spring", "constant_force", "force_ripple"),
    reference="plane pendulum",
    rotary_only=True,
    prior=0.1,  # a link or a handle out of balance, unless the axis is vertical
    contains=("constant_force", "ground_spring"),
    starts=_starts,
    sweep=_sweep,
    drawn=_drawn,
    odds=2.5,
)


@part
def pendulum_force(q, p):
    """Force at position q."""
    return -p[0] * sin(q + p[1])

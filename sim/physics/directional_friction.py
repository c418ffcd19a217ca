"""Friction that differs between the two directions, dry and viscous.

    f = -(level_plus + viscous_plus v) for v > 0,    f = level_minus + viscous_minus |v| for v < 0,
    -level_plus <= f <= level_minus at rest.

The viscous part is part of the bound, not a force of its own: friction of any size then stops a
mass and never throws it back, so no viscosity is unstable at any substep. The bound is the mean of
its values at the start and at the predicted end of a substep: second order for h << m / viscous,
also across v = 0 without dry levels, where the bound is continuous.
"""

from collections.abc import Iterator

import numpy as np

from zwidth.sim.jit import part
from zwidth.sim.lane_type import greatest
from zwidth.sim.physics.effect import Bounds, Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import Sizes, most_friction, spread, up_to
from zwidth.sim.place import MASSES, Place


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    for share in (0.01, 0.06, 0.2):
        drag = 0.3 * share * z.force / z.speed
        level = share * z.force
        yield (
            {"level_plus": level, "level_minus": level, "viscous_plus": drag,
             "viscous_minus": 0.5 * drag},
            {"level_plus": level, "level_minus": level, "viscous_plus": drag,
             "viscous_minus": drag},
        )  # fmt: skip


def _sweep(z: Sizes, place: Place) -> Iterator[Scaled]:
    for level in up_to(z.peak):
        drag = 0.3 * level / z.speeds[place.index]
        scales = {"level_plus": level, "level_minus": level, "viscous_plus": drag,
                  "viscous_minus": drag}  # fmt: skip
        for plus, minus in ((1.0, 0.5), (0.5, 1.0)):
            for viscous in (0.0, 1.0):
                yield (
                    {"level_plus": plus * level, "level_minus": minus * level,
                     "viscous_plus": plus * viscous * drag,
                     "viscous_minus": minus * viscous * drag},
                    scales,
                )  # fmt: skip


def _bounds(z: Sizes, place: Place) -> Bounds:
    most = most_friction(z, place)
    return {"level_plus": (0.0, most), "level_minus": (0.0, most)}


def _drawn(random: np.random.Generator, z: Sizes, _: Place) -> Values:
    level = 0.01 * z.force
    plus = level / z.speed * float(random.uniform(0.2, 1.0))
    return {"level_plus": level, "level_minus": level * spread(random, 0.3, 3.0),
            "viscous_plus": plus, "viscous_minus": plus * spread(random, 0.3, 3.0)}  # fmt: skip


directional_friction = Effect(
    name="directional_friction",
    summary="dry and viscous friction that differ between the two directions",
    formula=(
        "f = -(level_plus + viscous_plus v) for v > 0,  "
        "f = level_minus + viscous_minus |v| for v < 0,  "
        "-level_plus <= f <= level_minus at rest"
    ),
    places=MASSES,
    parameters=(
        Parameter(
            "level_plus",
            "f_c+",
            "N m",
            0.0,
            1e6,
            0.0,
            role="magnitude",
            meaning="dry friction against motion in the positive direction",
        ),
        Parameter(
            "level_minus",
            "f_c-",
            "N m",
            0.0,
            1e6,
            0.0,
            role="magnitude",
            meaning="the same in the negative direction",
        ),
        Parameter(
            "viscous_plus",
            "b_+",
            "N m s/rad",
            0.0,
            1e6,
            0.0,
            role="magnitude",
            meaning="damper in the positive direction",
        ),
        Parameter(
            "viscous_minus",
            "b_-",
            "N m s/rad",
            0.0,
            1e6,
            0.0,
            role="magnitude",
            meaning="damper in the negative direction",
        ),
    ),
    hook="friction",
    code=3,
    mistaken_for=("coulomb_friction", "constant_force"),
    reference="Armstrong-Helouvry, Control of Machines with Friction, Kluwer 1991",
    varies_with_speed=True,
    prior=0.03,  # worn gears and brushes; most friction is the same both ways
    contains=("coulomb_friction", "constant_force", "quadratic_drag"),
    family="dry friction",
    holds_constant=("level_minus", "level_plus"),
    creased=True,
    starts=_starts,
    sweep=_sweep,
    bounds=_bounds,
    drawn=_drawn,
    odds=1.5,
)


@part
def directional_bounds(v, p):
    """Bounds at velocity v: (lower, upper) sliding, (lower, upper) sticking."""
    lower = -(p[0] + p[2] * greatest(v, 0.0))
    upper = p[1] + p[3] * greatest(-v, 0.0)
    return lower, upper, -p[0], p[1]

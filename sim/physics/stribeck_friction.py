"""Dry friction that is highest at rest and falls with speed, to a level.

    g(v) = level + (static_level - level) exp(-(v / velocity)^2),    |f| <= g(0) at rest,
    f = -g(v) sign(v) in motion.

The friction is continuous at v = 0: a mass that breaks away starts without a jump of the force.

Limits: a substep must be short against m velocity / (static_level - level), the time in which the
falling friction lets a mass run away.
"""

from collections.abc import Iterator

import numpy as np

from zwidth.sim.elementary import exp
from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Bounds, Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import Sizes, most_friction, spread, up_to
from zwidth.sim.place import MASSES, Place

SLOWEST = 1e-3  # of the rms speed


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    for share in (0.01, 0.06, 0.2):
        for slow in (0.03, 0.3):
            values = {
                "level": share * z.force,
                "static_level": 1.6 * share * z.force,
                "velocity": slow * z.speed,
            }
            yield values, {k: 0.5 * x for k, x in values.items()}


def _sweep(z: Sizes, place: Place) -> Iterator[Scaled]:
    for level in up_to(z.peak / 1.6):
        for slow in (0.03, 0.3):
            values = {
                "level": level,
                "static_level": 1.6 * level,
                "velocity": slow * z.speeds[place.index],
            }
            yield values, {k: 0.5 * x for k, x in values.items()}


def _bounds(z: Sizes, place: Place) -> Bounds:
    """A fall at a velocity above the highest recorded one cannot be seen.

    Nor at a velocity so low that a mass passes it within one sample: that is Coulomb friction.
    """
    most = most_friction(z, place)
    return {
        "level": (0.0, most),
        "static_level": (0.0, most),
        "velocity": (SLOWEST * z.speeds[place.index], z.fastest[place.index]),
    }


def _drawn(random: np.random.Generator, z: Sizes, _: Place) -> Values:
    level = 0.01 * z.force
    static = level * float(random.uniform(1.3, 2.5))
    return {"level": level, "static_level": static, "velocity": z.speed * spread(random, 0.03, 0.5)}


def _forbidden(values: Values) -> str:
    """Friction that is smaller at rest than in motion would take the place of a drag."""
    return "static_level" if values["static_level"] < values["level"] else ""


stribeck_friction = Effect(
    name="stribeck_friction",
    summary="dry friction that falls with speed from a higher level at rest",
    formula=(
        "f = -(level + (static_level - level) exp(-(v / velocity)^2)) sign(v) in motion,  "
        "|f| <= static_level at rest"
    ),
    places=MASSES,
    parameters=(
        Parameter(
            "level", "f_c", "N m", 0.0, 1e6, 0.0, role="magnitude", meaning="force in fast sliding"
        ),
        Parameter(
            "static_level",
            "f_s",
            "N m",
            0.0,
            1e6,
            0.0,
            role="magnitude",
            meaning="force at rest, to break away",
        ),
        Parameter(
            "velocity",
            "v_s",
            "rad/s",
            1e-12,
            1e6,
            None,
            meaning="speed over which it falls from the one to the other",
        ),
    ),
    hook="friction",
    code=2,
    mistaken_for=("coulomb_friction", "presliding_friction"),
    reference="Armstrong-Helouvry, Dupont & Canudas de Wit, Automatica 30(7), 1994, eq. (4)",
    varies_with_speed=True,
    prior=0.05,  # of dry friction, where it is lubricated and moves slowly enough
    contains=("coulomb_friction",),
    family="dry friction",
    creased=True,
    starts=_starts,
    sweep=_sweep,
    bounds=_bounds,
    drawn=_drawn,
    forbidden=_forbidden,
    odds=2.0,
)


# Over a substep the bound is the mean of g at its start and at its predicted end (second order
# while sliding); sticking and stopping are those of `coulomb_friction`. g falls steepest at
# v = velocity / sqrt(2), by 0.86 (static_level - level) / velocity.


@part
def stribeck_bounds(v, p):
    """Bounds at velocity v: (lower, upper) sliding, (lower, upper) sticking (read at v = 0)."""
    ratio = v / p[2]
    g = p[0] + (p[1] - p[0]) * exp(-ratio * ratio)
    return -g, g, -g, g

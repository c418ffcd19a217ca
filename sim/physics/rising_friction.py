"""Dry friction that is lowest at rest and rises with speed, to a level: creep before sliding.

    g(v) = level - (level - static_level) exp(-|v| / velocity),    |f| <= static_level at rest,
    f = -g(v) sign(v) in motion.

Under a load between the two levels a mass creeps, at the speed v at which g(v) is the load, and
slides when the load is above `level`: greased gears and polymer seals, whose break-away depends on
how slowly they are loaded. It is Tustin's form of the curve of Stribeck turned round: concave where
that falls, with a kink at rest and no valley.

Over a substep the bound is the mean of its values at the start and at the predicted end, as that of
`stribeck_friction`: second order for h << m velocity / (level - static_level), in which creep
settles, and stable at any h, since friction only ever stops a mass.
"""

from collections.abc import Iterator

import numpy as np

from zwidth.sim.elementary import exp
from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Bounds, Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import Sizes, most_friction, spread, up_to
from zwidth.sim.place import MASSES, Place

SLOWEST, FASTEST = 1e-3, 0.5  # of the rms speed, of the highest
AT_REST = 0.3  # of the level, where a search begins


def _from(level: float, velocity: float) -> Scaled:
    values = {"level": level, "static_level": AT_REST * level, "velocity": velocity}
    return values, {k: 0.5 * x for k, x in values.items()}


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    for share in (0.01, 0.06, 0.2):
        for slow in (0.01, 0.1):
            yield _from(share * z.force, slow * z.speed)


def _sweep(z: Sizes, place: Place) -> Iterator[Scaled]:
    for level in up_to(z.peak):
        for slow in (0.01, 0.1):
            yield _from(level, slow * z.speeds[place.index])


def _bounds(z: Sizes, place: Place) -> Bounds:
    """Friction that still rises at half of the highest speed is a drag without a level."""
    most = most_friction(z, place)
    return {
        "level": (0.0, most),
        "static_level": (0.0, most),
        "velocity": (SLOWEST * z.speeds[place.index], FASTEST * z.fastest[place.index]),
    }


def _drawn(random: np.random.Generator, z: Sizes, _: Place) -> Values:
    level = 0.01 * z.force
    static = level * float(random.uniform(0.1, 0.6))
    return {"level": level, "static_level": static, "velocity": z.speed * spread(random, 0.01, 0.2)}


def _forbidden(values: Values) -> str:
    """Friction that is larger at rest than in motion falls with speed, which is another law."""
    return "static_level" if values["static_level"] > values["level"] else ""


rising_friction = Effect(
    name="rising_friction",
    summary="dry friction that rises with speed from a lower level at rest: creep before sliding",
    formula=(
        "f = -(level - (level - static_level) exp(-|v| / velocity)) sign(v) in motion,  "
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
            meaning="force at rest, above which it creeps",
        ),
        Parameter(
            "velocity",
            "v_s",
            "rad/s",
            1e-12,
            1e6,
            None,
            meaning="speed over which it rises from the one to the other",
        ),
    ),
    hook="friction",
    code=5,
    mistaken_for=("coulomb_friction", "presliding_friction", "directional_friction"),
    reference=(
        "Bo & Pavelescu, The friction-speed relation and its influence on the critical velocity of"
        " stick-slip motion, Wear 82(3), 1982, with exponent 1 and f_s < f_c"
    ),
    varies_with_speed=True,
    prior=0.03,  # of dry friction, where a joint is greased and moves slowly enough to creep
    contains=("coulomb_friction",),
    family="dry friction",
    creased=True,
    starts=_starts,
    sweep=_sweep,
    bounds=_bounds,
    drawn=_drawn,
    forbidden=_forbidden,
    odds=1.0,
)


@part
def rising_bounds(v, p):
    """Bounds at velocity v: (lower, upper) sliding, (lower, upper) sticking (read at v = 0)."""
    g = p[0] + (p[1] - p[0]) * exp(-abs(v) / p[2])
    return -g, g, -p[1], p[1]

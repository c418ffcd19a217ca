"""A spring that hardens (coefficient > 0) or softens: f = -k3 q^3 of the relative position."""

from collections.abc import Iterator

import numpy as np

from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import Sizes, sign, up_to
from zwidth.sim.place import LINKS, Place


def _starts(z: Sizes, place: Place) -> Iterator[Scaled]:
    reach, held = z.reach(place), z.held(place)
    for share in (3e-4, -3e-4, 0.01, -0.01, 0.2, -0.2):
        size = share * held / reach**3
        yield {"coefficient": size}, {"coefficient": abs(size)}


def _sweep(z: Sizes, place: Place) -> Iterator[Scaled]:
    """From a bend that nobody sees; one that softens more has no stable rest."""
    reach, held = z.reach(place), z.held(place)
    for share in up_to(10.0):
        size = share * held / reach**3
        yield {"coefficient": size}, {"coefficient": size}
        if share < 0.5:
            yield {"coefficient": -size}, {"coefficient": size}


def _natural(z: Sizes, place: Place) -> float:
    return z.force / z.reach(place) ** 3


def _drawn(random: np.random.Generator, z: Sizes, place: Place) -> Values:
    reach = z.reach(place)
    if place.kind == "link":
        return {"coefficient": sign(random) * 0.01 * z.springs[place.index] / reach**2}
    return {"coefficient": 0.01 * z.force / z.position / reach**2}


cubic_stiffness = Effect(
    name="cubic_stiffness",
    summary="cubic part of a spring",
    said="a spring's cubic part of {coefficient}",
    formula="f = -coefficient q^3",
    places=("ground", *LINKS),
    parameters=(
        Parameter(
            "coefficient",
            "k_3",
            "N m/rad3",
            -1e15,
            1e15,
            0.0,
            role="magnitude",
            meaning="force over deflection cubed; above 0 the spring hardens, below it softens",
        ),
    ),
    hook="force",
    code=1,
    mistaken_for=("backlash", "force_ripple"),
    reference="G. Duffing, Erzwungene Schwingungen, 1918",
    prior=0.03,  # springs are bent by design, or where they are short and stretched far
    starts=_starts,
    sweep=_sweep,
    natural=_natural,
    drawn=_drawn,
    odds=2.0,
)


@part
def cubic_force(q, p):
    """Force at relative position q."""
    return -p[0] * q * q * q

"""Drag of a mass against its surroundings, growing with the square of speed: f = -c v |v|."""

from collections.abc import Iterator

import numpy as np

from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import Sizes, up_to
from zwidth.sim.place import MASSES, Place


def _starts(z: Sizes, place: Place) -> Iterator[Scaled]:
    for share in (0.004, 0.06):  # what is linear in its strength needs few
        size = share * z.force / z.speed**2
        yield {"coefficient": size}, {"coefficient": size}


def _sweep(z: Sizes, place: Place) -> Iterator[Scaled]:
    for force in up_to(z.peak):
        size = force / z.speeds[place.index] ** 2
        yield {"coefficient": size}, {"coefficient": size}


def _natural(z: Sizes, _: Place) -> float:
    return z.force / z.speed**2


def _drawn(_: np.random.Generator, z: Sizes, __: Place) -> Values:
    return {"coefficient": 0.01 * z.force / z.speed**2}


quadratic_drag = Effect(
    name="quadratic_drag",
    summary="drag that grows with the square of speed",
    said="quadratic drag of {coefficient}",
    formula="f = -coefficient v |v|",
    places=MASSES,
    parameters=(
        Parameter(
            "coefficient",
            "c_2",
            "N m s2/rad2",
            0.0,
            1e6,
            0.0,
            role="magnitude",
            meaning="force over the square of the speed",
        ),
    ),
    hook="force",
    code=2,
    mistaken_for=("coulomb_friction",),
    reference="turbulent drag, Rayleigh",
    prior=0.03,  # a fan, a liquid, fast parts; haptic devices are slow and in air
    starts=_starts,
    sweep=_sweep,
    natural=_natural,
    drawn=_drawn,
    odds=1.5,
)


@part
def drag_force(v, p):
    """Force at velocity v."""
    return -p[0] * v * abs(v)

"""A further mass on a spring and damper: an unmodelled mode, or a hand; solved exactly.

It is one more mass of the device, after those of the chain (`Device.plant`), and starts at rest or
as `Start` says. With a mass of zero nothing is added.
"""

import math
from collections.abc import Iterator

import numpy as np

from zwidth.sim.chain import Matrices
from zwidth.sim.physics.effect import Effect, Numbers, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import Sizes, spread, up_to
from zwidth.sim.place import MASSES, Place


def _hung(matrices: Matrices, host: int, values: Numbers) -> Matrices:
    """M, C, K with one more mass, the last, on a spring and damper to its host."""
    if np.all(np.equal(values["mass"], 0.0)):
        return matrices
    room = [(0, 0)] * (matrices.mass.ndim - 2) + [(0, 1)] * 2
    grown = Matrices(*(np.pad(matrix, room) for matrix in matrices))
    grown.mass[..., -1, -1] = values["mass"]
    link = np.array([[1.0, -1.0], [-1.0, 1.0]])
    ends = (..., *np.ix_([host, -1], [host, -1]))
    grown.damping[ends] += np.asarray(values["damping"])[..., None, None] * link
    grown.stiffness[ends] += np.asarray(values["stiffness"])[..., None, None] * link
    return grown


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    for share in (0.02, 0.15):
        mass = share * z.mass
        for hertz in np.geomspace(6.0, 0.4 / z.period, 6).tolist():
            stiffness = mass * (2.0 * math.pi * hertz) ** 2
            damping = 0.1 * math.sqrt(stiffness * mass)
            yield (
                {"mass": mass, "stiffness": stiffness, "damping": damping},
                {"mass": 0.5 * mass, "stiffness": 0.5 * stiffness, "damping": damping},
            )


def _sweep(z: Sizes, _: Place) -> Iterator[Scaled]:
    for mass in up_to(z.mass):
        for hertz in np.geomspace(2.0, 0.2 / z.period, 5).tolist():
            stiffness = mass * (2.0 * math.pi * hertz) ** 2
            damping = 0.2 * math.sqrt(stiffness * mass)
            yield (
                {"mass": mass, "stiffness": stiffness, "damping": damping},
                {"mass": 0.5 * mass, "stiffness": 0.5 * stiffness, "damping": damping},
            )


def _natural(z: Sizes, _: Place) -> float:
    return z.mass


def _at_share(random: np.random.Generator, z: Sizes, _: Place, share: float) -> Values:
    """Of all masses together."""
    mass = share * z.mass
    rate = 2.0 * math.pi * spread(random, 8.0, 150.0)
    damping = 2.0 * float(random.uniform(0.02, 0.2)) * mass * rate
    return {"mass": mass, "stiffness": mass * rate**2, "damping": damping}


def _drawn(random: np.random.Generator, z: Sizes, place: Place) -> Values:
    return _at_share(random, z, place, 0.03)


extra_mode = Effect(
    name="extra_mode",
    summary="a further mass on a spring and damper",
    formula="mass x'' = stiffness (q - x) + damping (q' - x'),  f = -mass x''",
    places=MASSES,
    parameters=(
        Parameter(
            "mass",
            "m_x",
            "kg m2",
            0.0,
            1e6,
            0.0,
            "kg",
            role="magnitude",
            meaning="the further mass",
        ),
        Parameter(
            "stiffness",
            "k_x",
            "N m/rad",
            0.0,
            1e12,
            None,
            role="magnitude",
            meaning="of the spring between it and the mass",
        ),
        Parameter(
            "damping",
            "b_x",
            "N m s/rad",
            0.0,
            1e9,
            None,
            role="magnitude",
            meaning="of the damper beside this spring",
        ),
    ),
    hook="structure",
    code=0,
    mistaken_for=("ground_spring", "actuator_lag"),
    reference="a hand as mass, spring and damper: Hogan, Proc. ICRA 1989",
    alters=_hung,
    adds_mass=True,
    prior=0.05,  # a hand, a bracket, a cable that swings: seldom, and much looks like one
    contains=("ground_spring",),
    sought="resonances",
    starts=_starts,
    sweep=_sweep,
    natural=_natural,
    drawn=_drawn,
    odds=1.0,
    at_share=_at_share,
)

"""A spring to ground, solved exactly; at m1 the parameter is the chain's own k0."""

from collections.abc import Iterator

import numpy as np

from zwidth.sim.chain import Matrices
from zwidth.sim.physics.effect import Effect, Numbers, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import Sizes, up_to
from zwidth.sim.place import MASSES, Place


def _tied(matrices: Matrices, mass: int, values: Numbers) -> Matrices:
    tied = matrices.stiffness.copy()
    tied[..., mass, mass] += values["stiffness"]
    return matrices._replace(stiffness=tied)


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    for share in (0.01, 0.1):
        stiffness = share * z.force / z.position
        yield {"stiffness": stiffness}, {"stiffness": stiffness}


def _sweep(z: Sizes, place: Place) -> Iterator[Scaled]:
    for force in up_to(z.peak):
        stiffness = 2.0 * force / z.spans[place.index]
        yield {"stiffness": stiffness}, {"stiffness": stiffness}


def _natural(z: Sizes, _: Place) -> float:
    return z.force / z.position


def _drawn(_: np.random.Generator, z: Sizes, __: Place) -> Values:
    return {"stiffness": 0.01 * z.force / z.position}


ground_spring = Effect(
    name="ground_spring",
    summary="a spring from a mass to ground",
    formula="f = -stiffness q",
    places=MASSES,
    parameters=(
        Parameter(
            "stiffness",
            "k_0",
            "N m/rad",
            0.0,
            1e12,
            0.0,
            role="magnitude",
            meaning="force for each unit of position",
        ),
    ),
    hook="structure",
    code=0,
    mistaken_for=("gravity_pendulum", "extra_mode"),
    reference="Hooke's law",
    alters=_tied,
    in_chain="ground_spring",
    prior=0.05,  # cables, hoses, a centring spring missing in the drawing
    elsewhere=0.02,
    absorbed=True,
    known_if_sprung="yes",
    weakens=True,
    starts=_starts,
    sweep=_sweep,
    natural=_natural,
    drawn=_drawn,
    odds=0.7,
)

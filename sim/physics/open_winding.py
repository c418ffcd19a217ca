"""A drive that is off does not brake: f = b v while it is off, which cancels a part of a damper.

A motor whose winding is shorted while its drive is off still brakes by its back-EMF, as a damper of
k_t k_e / R at its shaft; one whose bridge opens turns freely except for its gear. The device's
damper (with a `position_servo` its back-EMF, else that of m1) always includes the back-EMF. b is
the part that disappears while the drive is off: zero if the winding is shorted, all of the back-EMF
if it is open.

Limits: off is what a recording says (`[enable]`); a simulation's drive is always on. The force is
held over a substep (second order), which has to be short against m / b.
"""

from collections.abc import Iterator

import numpy as np

from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import Sizes, up_to
from zwidth.sim.place import Place


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    if z.switched and z.speed > 0.0:
        for share in (0.1, 0.3, 1.0, 3.0):
            damping = share * z.force / z.speed
            yield {"damping": damping}, {"damping": 0.5 * damping}


def _sweep(z: Sizes, _: Place) -> Iterator[Scaled]:
    if z.switched and z.speed > 0.0:
        for damping in up_to(10.0 * z.force / z.speed):
            yield {"damping": damping}, {"damping": 0.5 * damping}


def _natural(z: Sizes, _: Place) -> float:
    return z.force / z.speed if z.speed > 0.0 else 1.0


def _drawn(_: np.random.Generator, z: Sizes, place: Place) -> Values:
    return {"damping": 0.01 * _natural(z, place)}


open_winding = Effect(
    name="open_winding",
    summary="a drive whose back-EMF does not brake while it is off",
    formula="f = damping v while the drive is off",
    places=("m1",),
    parameters=(
        Parameter(
            "damping",
            "b_o",
            "N m s/rad",
            0.0,
            1e12,
            0.0,
            role="magnitude",
            meaning="damping that is there only while the drive is on",
        ),
    ),
    hook="force",
    code=16,
    reference="a winding's current is (u - k_e w) / R in a closed circuit and 0 in an open one",
    of_drive=True,
    prior=0.4,  # bridges open as often as they brake
    starts=_starts,
    sweep=_sweep,
    natural=_natural,
    drawn=_drawn,
)


@part
def lost_damping(v, s, p):
    """What undoes the damper while the drive's strength s is 0."""
    return p[0] * v if s == 0.0 else 0.0 * v

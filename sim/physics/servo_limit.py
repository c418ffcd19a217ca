"""A servo with a largest force: f = s clip(a, -limit, limit) - a, where its loop asks for a.

a = command - stiffness q - damping v of the `position_servo`; without one, a is the held command. s
is the share of the drive's force that acts: 1 unless a recording states it (0 if it was off, the
supply over its nominal voltage). A supply limits the voltage; the damper of the back-EMF belongs to
the mechanism and acts beyond the limit.

Limits: the command is the held one, before an `actuator_lag`. The force is held over a substep
(second order), which has to be short against the servo's own period.
"""

import math
from collections.abc import Iterator

from zwidth.sim.jit import part
from zwidth.sim.lane_type import greatest, least
from zwidth.sim.physics.effect import Effect, Parameter, Scaled
from zwidth.sim.physics.position_servo import asked
from zwidth.sim.physics.saturation import (
    bounds_of_limit,
    drawn_of_limit,
    natural_of_limit,
    sweep_of_limit,
)
from zwidth.sim.physics.sizes import Sizes
from zwidth.sim.place import Place


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    for share in (0.9, 0.7, 0.5, 0.3, 0.15, 0.07):
        yield {"limit": share * z.peak}, {"limit": 0.2 * share * z.peak}


servo_limit = Effect(
    name="servo_limit",
    summary="the limit of a servo's force, or of its voltage",
    formula=(
        "force of the servo: a within -limit and limit, else the limit,  a: what its loop asks for"
    ),
    places=("m1",),
    parameters=(
        Parameter(
            "limit",
            "f_max",
            "N m",
            1e-12,
            math.inf,
            math.inf,
            role="strength",
            least=0.3,
            meaning="largest force of the loop",
        ),
    ),
    hook="force",
    code=12,
    mistaken_for=("saturation",),
    reference="ideal saturation inside the loop",
    of_drive=True,
    borrows=("servo",),
    needs="position_servo",
    prior=0.3,  # every servo has one, and a step of its goal goes there
    creased=True,
    starts=_starts,
    sweep=sweep_of_limit,
    bounds=bounds_of_limit,
    natural=natural_of_limit,
    drawn=drawn_of_limit,
)


@part
def beyond_limit(w, q, v, s, p):
    """The part of the force demanded by command w that limit and strength s remove."""
    a = asked(w, q, v, p, 1)
    return s * least(greatest(a, -p[0]), p[0]) - a

"""Dry friction proportional to the load of the drive, as in a gear: |f| <= ratio |a|.

a: the drive's force at m1, which is the held command or, with a `position_servo`, the force that
its loop asks for within its `servo_limit`, less the back-EMF (an `open_winding` has none while the
drive is off). A drive that holds a load presses the teeth of its gear together, at rest and in
motion alike; this adds to the dry friction without a load.

Limits: the command is the held one, before an `actuator_lag`. A load that drives the gear backwards
has the same friction, which is not true of a worm gear.
"""

from collections.abc import Iterator

import numpy as np

from zwidth.sim.jit import part
from zwidth.sim.lane_type import greatest, least
from zwidth.sim.physics.effect import Effect, Parameter, Scaled, Values
from zwidth.sim.physics.position_servo import asked
from zwidth.sim.physics.sizes import Sizes, up_to
from zwidth.sim.place import Place


def _starts(_: Sizes, __: Place) -> Iterator[Scaled]:
    for ratio in (0.01, 0.05, 0.2):
        yield {"ratio": ratio}, {"ratio": 0.5 * ratio}


def _sweep(_: Sizes, __: Place) -> Iterator[Scaled]:
    for ratio in up_to(0.5):
        yield {"ratio": ratio}, {"ratio": 0.5 * ratio}


def _natural(_: Sizes, __: Place) -> float:
    return 1.0


def _drawn(_: np.random.Generator, __: Sizes, ___: Place) -> Values:
    return {"ratio": 0.01}


load_friction = Effect(
    name="load_friction",
    summary="dry friction in proportion to the drive's force, as of a gear",
    formula=(
        "f = -ratio |a| sign(v) in motion,  |f| <= ratio |a| at rest,  a: the force of the drive"
    ),
    places=("m1",),
    parameters=(
        Parameter(
            "ratio",
            "mu",
            "",
            0.0,
            0.99,
            0.0,
            role="magnitude",
            meaning="friction over the drive's force",
        ),
    ),
    hook="friction",
    code=4,
    mistaken_for=("coulomb_friction",),
    reference="M. Duclusaud et al., Extended friction models for servo actuators, 2025",
    borrows=("servo",),
    varies_with_speed=True,
    prior=0.05,  # of geared drives, where they carry more than they turn
    creased=True,
    weakens=True,
    starts=_starts,
    sweep=_sweep,
    natural=_natural,
    drawn=_drawn,
    odds=1.0,
)


@part
def load_bounds(q, v, w, s, p):
    """Bounds under the held command w: (lower, upper) sliding, (lower, upper) sticking."""
    back = p[3] if s > 0.0 else p[3] - p[5]
    a = s * least(greatest(asked(w, q, v, p, 1), -p[4]), p[4]) - back * v
    g = p[0] * abs(a)
    return -g, g, -g, g

"""A force periodic in position, such as a motor's cogging or a cable drum's runout.

    f = amplitude sin(2 pi q / period + phase)

At a mass it has the potential amplitude period / (2 pi) cos(2 pi q / period + phase). A substep
must be short against the time period / |v| in which the mass crosses a period.

In a link it is the ripple of a gear mesh or a capstan: f on the first mass and -f on the second,
over the position q of the first. Teeth that are not where they should be, by e(q), stretch the link
by as much, and it carries k (q_1 - q_2 + e): both masses feel k e more, so the amplitude is k |e|.
Left out is de/dq times the force of the link, a force on the first mass alone; it balances the work
that the pair does on the stretch s of the link, and is of order 2 pi s / period relative to f. So
the law holds for a link whose deflection is much smaller than a period; then it does not matter,
either, over which of its two masses the ripple is taken.
"""

import math
from collections.abc import Iterator

import numpy as np

from zwidth.sim.elementary import sin
from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Bounds, Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import LONGEST, QUARTER, Sizes, spread, turn, up_to
from zwidth.sim.place import LINKS, MASSES, Place

SEEN = 1.5  # waves in the travel, at least: a line, a square and a cube bend as often as fewer do


def _starts(z: Sizes, place: Place) -> Iterator[Scaled]:
    """A starting value must stay within a fraction of a wave over the whole travel.

    The residual's own spectrum (`zwidth.diagnosis.seeking.waves`) shows the shorter ones.
    """
    span = z.spans[place.index]
    for period in np.geomspace(span / 9.0, span / SEEN, 7).tolist():
        for phase in (0.0, QUARTER):
            yield (
                {"amplitude": 0.02 * z.force, "period": period, "phase": phase},
                {"amplitude": 0.02 * z.force, "period": 0.02 * period, "phase": 0.5},
            )


def _sweep(z: Sizes, place: Place) -> Iterator[Scaled]:
    for amplitude in up_to(z.peak):
        for waves in (9.0, 4.0, SEEN):
            period = z.spans[place.index] / waves
            for phase in (0.0, QUARTER):
                yield (
                    {"amplitude": amplitude, "period": period, "phase": phase},
                    {"amplitude": amplitude, "period": 0.02 * period, "phase": 0.5},
                )


def _bounds(z: Sizes, place: Place) -> Bounds:
    """Of longer waves less than half is seen to repeat: a force that bends once is a spring's.

    On a spring that hardens (Silverbox), 1.2 waves over the travel cost 526 less in -2 ln than the
    published cubic law; 1.8 waves of a motor's cogging have been found. A fit that ends on the
    bound is no answer.
    """
    return {"period": (0.0, z.spans[place.index] / SEEN)}


def _drawn(random: np.random.Generator, z: Sizes, _: Place) -> Values:
    period = z.span * spread(random, 0.03, 0.5)
    return {"amplitude": 0.01 * z.force, "period": period, "phase": turn(random)}


force_ripple = Effect(
    name="force_ripple",
    summary="a force periodic in position",
    formula="f = amplitude sin(2 pi q / period + phase)",
    places=(*MASSES, *LINKS),
    parameters=(
        Parameter(
            "amplitude",
            "a_r",
            "N m",
            0.0,
            1e6,
            0.0,
            role="magnitude",
            meaning="largest force of the wave",
        ),
        Parameter(
            "period",
            "lambda_r",
            "rad",
            1e-9,
            1e6,
            None,
            most=LONGEST,
            meaning="length of a wave in the position",
        ),
        Parameter(
            "phase",
            "phi_r",
            "rad",
            -2.0 * math.pi,
            2.0 * math.pi,
            None,
            "rad",
            role="turning",
            meaning="of the wave at position 0",
        ),
    ),
    hook="force",
    code=7,
    mistaken_for=("gravity_pendulum", "encoder_eccentricity", "cubic_stiffness"),
    reference="Holtz & Springob, IEEE T. Industrial Electronics 43(2), 1996",
    over_first=True,
    prior=0.1,  # cogging of motors with iron, capstans and gears
    elsewhere=0.03,  # no motor there
    sought="waves",
    contains=("gravity_pendulum",),  # a wave as long as a turn
    starts=_starts,
    sweep=_sweep,
    bounds=_bounds,
    drawn=_drawn,
    odds=2.5,
)


@part
def ripple_force(q, p):
    """Force at position q."""
    return p[0] * sin(2.0 * math.pi * q / p[1] + p[2])

"""The encoder's disk runs off centre: it reads q + amplitude sin(2 pi q / period + phase).

amplitude: eccentricity over the disk's radius (in rad on a rotary device); period: the travel
of m1 during one turn of the disk.
"""

import math
from collections.abc import Iterator

import numpy as np

from zwidth.sim.elementary import sin
from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Bounds, Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import LONGEST, QUARTER, WAVES, Sizes, spread, turn, up_to
from zwidth.sim.place import Place

SHARES = (0.5, 0.35, 0.2, 0.07)  # of the travel; what is shorter the residual shows
LEAST_COUNTS = 4.0  # of an encoder in a wave: a shorter one is how it counts


def _periods(z: Sizes, shares: tuple[float, ...]) -> list[float]:
    """Return periods to try: shares of the travel, and one turn if the travel has two turns.

    Less than two waves cannot be told from a curve of another shape.
    """
    turns = [2.0 * math.pi] if z.rotary and z.span >= WAVES * 2.0 * math.pi else []
    return [*(z.span * share for share in shares), *turns]


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    for period in _periods(z, SHARES):
        for phase in (0.0, QUARTER):
            yield (
                {"amplitude": 1e-3 * z.span, "period": period, "phase": phase},
                {"amplitude": 1e-3 * z.span, "period": 0.1 * period, "phase": 0.5},
            )


def _sweep(z: Sizes, _: Place) -> Iterator[Scaled]:
    for period in _periods(z, (0.5, 0.2, 0.07)):
        for amplitude in up_to(0.9 * period / (2.0 * math.pi)):
            for phase in (0.0, QUARTER):
                yield (
                    {"amplitude": amplitude, "period": period, "phase": phase},
                    {"amplitude": amplitude, "period": 0.1 * period, "phase": 0.5},
                )


def _bounds(z: Sizes, _: Place) -> Bounds:
    """With fewer than two waves no repetition can be seen, on a disk as along a line.

    On joints of robots that turned by less than two of its waves, this imitated any missing
    physics: an "eccentric encoder" of 0.5 rad beside a friction, with a period of the whole travel.
    """
    return {"period": (LEAST_COUNTS * z.step, z.span / WAVES)}


def _natural(z: Sizes, _: Place) -> float:
    return z.span


def _drawn(random: np.random.Generator, z: Sizes, _: Place) -> Values:
    period = z.span * spread(random, 0.05, 0.5)
    return {"amplitude": 1e-3 * z.span, "period": period, "phase": turn(random)}


def _forbidden(values: Values) -> str:
    """An encoder that is farther off centre would count backwards."""
    backwards = 2.0 * math.pi * abs(values["amplitude"]) > values["period"]
    return "amplitude" if backwards else ""


def _at_share(random: np.random.Generator, z: Sizes, place: Place, share: float) -> Values:
    """A tenth of the share of the rms travel."""
    return _drawn(random, z, place) | {"amplitude": 0.1 * share * z.position}


encoder_eccentricity = Effect(
    name="encoder_eccentricity",
    summary="the error of the reading repeats with position",
    formula="reading = q + amplitude sin(2 pi q / period + phase)",
    places=("sensor",),
    parameters=(
        Parameter(
            "amplitude",
            "a_e",
            "rad",
            0.0,
            1e3,
            0.0,
            role="magnitude",
            meaning="largest error of the reading",
        ),
        Parameter(
            "period",
            "lambda_e",
            "rad",
            1e-9,
            1e6,
            None,
            most=LONGEST,
            meaning="travel of m1 during one turn of the disk",
        ),
        Parameter(
            "phase",
            "phi_e",
            "rad",
            -2.0 * math.pi,
            2.0 * math.pi,
            None,
            "rad",
            role="turning",
            meaning="of the wave at position 0",
        ),
    ),
    hook="sensor",
    code=1,
    mistaken_for=("force_ripple",),
    reference="first harmonic of an off-centre disk, to first order in the eccentricity",
    prior=0.05,  # every disk is off centre; few of them so far that it shows
    sought="waves",
    starts=_starts,
    sweep=_sweep,
    bounds=_bounds,
    natural=_natural,
    drawn=_drawn,
    forbidden=_forbidden,
    odds=0.7,
    at_share=_at_share,
)


@part
def off_centre(position, p):
    """Return the reading of a position."""
    return position + p[0] * sin(2.0 * math.pi * position / p[1] + p[2])

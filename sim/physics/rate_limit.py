"""A command with a limited rate of change, such as of a slew-limited amplifier.

    u_k = u_(k-1) + clip(a_k - u_(k-1), -rate T, rate T)

of the requested force a_k, at ticks of T; it comes last, after the amplifier's limit. A recorded
command starts at its first value, and not at zero.
"""

import math
from collections.abc import Iterator

import numpy as np

from zwidth.sim.jit import part
from zwidth.sim.lane_type import select, signed
from zwidth.sim.physics.effect import Bounds, Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import Sizes, up_to
from zwidth.sim.place import Place

TICKS = (3.0, 10.0, 30.0, 100.0)  # in which a command may go from zero to its peak
LONGEST_TICKS = 200.0  # a slower one leaves hardly anything of a command


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    for ticks in TICKS:
        rate = z.peak / (ticks * z.period)
        yield {"rate": rate}, {"rate": 0.3 * rate}


def _sweep(z: Sizes, _: Place) -> Iterator[Scaled]:
    for ticks in up_to(LONGEST_TICKS):
        rate = z.peak / (ticks * z.period)
        yield {"rate": rate}, {"rate": 0.3 * rate}


def _bounds(z: Sizes, _: Place) -> Bounds:
    """No command changes by more than twice its peak in one tick."""
    return {"rate": (0.0, 2.0 * z.peak / z.period)}


def _natural(z: Sizes, _: Place) -> float:
    return LONGEST_TICKS * z.period / z.peak


def _drawn(_: np.random.Generator, z: Sizes, __: Place) -> Values:
    return {"rate": z.peak / (3.0 * z.period)}


rate_limit = Effect(
    name="rate_limit",
    summary="a largest rate of change of the command",
    formula="|force'| <= rate",
    places=("command",),
    parameters=(
        Parameter(
            "rate",
            "r",
            "N m/s",
            1e-12,
            math.inf,
            math.inf,
            role="strength",
            least=0.3,
            inverse=True,
            meaning="largest change of the force a second",
        ),
    ),
    hook="command",
    code=4,
    mistaken_for=("actuator_lag", "loop_delay"),
    reference="ideal slew-rate limiter",
    prior=0.02,  # drives of large machines, to spare their gears
    creased=True,
    weakens=True,
    starts=_starts,
    sweep=_sweep,
    bounds=_bounds,
    natural=_natural,
    drawn=_drawn,
)


@part
def followed_at(command, last, most):
    """Return how far a command is followed in one tick from the last, by `most` at most.

    NaN stays NaN, so that the run stops.
    """
    change = command - last
    return select(abs(change) > most, last + signed(most, change), command)

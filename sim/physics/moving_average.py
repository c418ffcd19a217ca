"""Mean of the motion over a window before the reading, as a second-order filter.

The mean of q over [t - W, t] is (1 - exp(-s W)) / (s W) of it, whose reciprocal is, with x = s W,

    x / (1 - exp(-x)) = 1 + x / 2 + x^2 / 12 - x^4 / 720 + ...:

A filter of second order with w = sqrt(12) / W and zeta = sqrt(3) / 2 (Bessel's) agrees with this
within (omega W)^4 / 720: 0.1 % at omega W = 1, 1 % at 1.7, a window of a quarter wave. At higher
frequencies it does not have the zeros of a mean. The difference of two positions, divided by the
time W between them, is exactly the mean velocity over W; for successive samples it is half a sample
late.
"""

import math

import numpy as np

from zwidth.sim.following import Following, second_order
from zwidth.sim.physics.effect import Effect, Numbers, Parameter, Values
from zwidth.sim.physics.lasting import LONGEST_TICKS, Lasting, one_tick
from zwidth.sim.physics.sensor_lag import LONGEST_DRAWN
from zwidth.sim.physics.sizes import Sizes
from zwidth.sim.place import Place

BESSEL = math.sqrt(3.0) / 2.0


_time = Lasting("window", (1.0, 4.0, 16.0, 50.0), longest=2.0 * LONGEST_TICKS, reads=True)


def _follows(values: Numbers) -> Following:
    return second_order(values["window"] / math.sqrt(12.0), BESSEL)


def _drawn(_: np.random.Generator, __: Sizes, ___: Place) -> Values:
    return {"window": 2e-4}


def _at_share(_: np.random.Generator, __: Sizes, ___: Place, share: float) -> Values:
    return {"window": 2.0 * share * LONGEST_DRAWN}


moving_average = Effect(
    name="moving_average",
    summary="each reading is the mean over the window before it",
    formula="reading(t) = mean of q from t - window to t",
    places=("sensor", "velocity"),
    parameters=(
        Parameter(
            "window",
            "W",
            "s",
            0.0,
            10.0,
            0.0,
            role="magnitude",
            meaning="length of the window; for differences of positions, the time between them",
        ),
    ),
    hook="structure",
    code=0,
    mistaken_for=("sensor_lag", "sensor_filter", "actuator_lag", "loop_delay"),
    reference="mean over a window, to (omega W)^4 / 720; Bessel filter of second order",
    follows=_follows,
    prior=0.05,  # most velocities are differences, but this seldom shows
    family="reading_filter",
    starts=_time.starts,
    sweep=_time.sweep,
    bounds=_time.bounds,
    natural=one_tick,
    drawn=_drawn,
    odds=0.4,
    excludes=("actuator_lag", "loop_delay"),
    at_share=_at_share,
)

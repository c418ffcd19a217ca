"""Second-order filter of a reading: T^2 s'' + 2 zeta T s' + s = q, solved exactly.

T is 1 / (2 pi f) of the filter's frequency f; a damping of 0.707 is Butterworth's. `sensor_lag.py`
explains how a filter of readings differs from one of the command.
"""

import math
from collections.abc import Iterator

import numpy as np

from zwidth.sim.following import Following, second_order
from zwidth.sim.physics.effect import Bounds, Effect, Numbers, Parameter, Scaled, Values
from zwidth.sim.physics.lasting import Lasting, one_tick
from zwidth.sim.physics.sensor_lag import LONGEST_DRAWN
from zwidth.sim.physics.sizes import Sizes
from zwidth.sim.place import Place

BUTTERWORTH = math.sqrt(0.5)
_time = Lasting("time_constant", (0.5, 2.0, 10.0, 30.0), reads=True)
DAMPINGS = (0.3, 2.0)  # of real filters: lower ones ring, higher ones are two of first order


def _follows(values: Numbers) -> Following:
    return second_order(values["time_constant"], values["damping"])


def _damped(of_time: Iterator[Scaled]) -> Iterator[Scaled]:
    for values, steps in of_time:
        yield {**values, "damping": BUTTERWORTH}, {**steps, "damping": 0.3 * BUTTERWORTH}


def _starts(z: Sizes, place: Place) -> Iterator[Scaled]:
    return _damped(_time.starts(z, place))


def _sweep(z: Sizes, place: Place) -> Iterator[Scaled]:
    return _damped(_time.sweep(z, place))


def _bounds(z: Sizes, place: Place) -> Bounds:
    return {**_time.bounds(z, place), "damping": DAMPINGS}


def _drawn(_: np.random.Generator, __: Sizes, ___: Place) -> Values:
    return {"time_constant": 1e-4, "damping": BUTTERWORTH}


def _at_share(random: np.random.Generator, _: Sizes, __: Place, share: float) -> Values:
    return {
        "time_constant": 0.5 * share * LONGEST_DRAWN,
        "damping": float(random.uniform(0.5, 1.0)),
    }


sensor_filter = Effect(
    name="sensor_filter",
    summary="second-order filter between the motion and its reading",
    formula="time_constant^2 s'' + 2 damping time_constant s' + s = q,  s: the reading",
    places=("sensor", "velocity"),
    parameters=(
        Parameter(
            "time_constant",
            "tau_f",
            "s",
            0.0,
            10.0,
            0.0,
            role="magnitude",
            meaning="1 / (2 pi f), with f the natural frequency of the filter in Hz",
        ),
        Parameter(
            "damping",
            "zeta_f",
            "",
            0.0,
            100.0,
            None,
            meaning="damping ratio; 0.707 is a Butterworth filter's",
        ),
    ),
    hook="structure",
    code=0,
    mistaken_for=("sensor_lag", "moving_average", "actuator_lag", "loop_delay"),
    reference="second-order low-pass, 1 / (1 + 2 zeta_f tau_f s + tau_f^2 s^2)",
    follows=_follows,
    prior=0.02,  # anti-alias filters, drives; mostly documented, or above the recorded band
    contains=("moving_average",),
    family="reading_filter",
    starts=_starts,
    sweep=_sweep,
    bounds=_bounds,
    natural=one_tick,
    drawn=_drawn,
    odds=0.4,
    excludes=("actuator_lag", "loop_delay"),
    at_share=_at_share,
)

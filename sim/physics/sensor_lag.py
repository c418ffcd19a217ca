"""First-order lag of a reading: T s' = q - s, exact in the propagator (`sim/reading.py`).

What is recorded, or read by a law, is s; forces act by the motion itself. Under a command that is
played the motion of a linear device lags alike by its amplifier (`actuator_lag`): a law that reads,
another reading, or a force that follows the motion (friction) tells the two apart.
"""

from collections.abc import Iterator

import numpy as np

from zwidth.sim.following import Following, first_order
from zwidth.sim.physics.effect import Bounds, Effect, Numbers, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import Sizes, up_to
from zwidth.sim.place import Place

LONGEST_TICKS = 50.0  # a longer one is another mechanism
LONGEST_DRAWN = 0.03  # s, of which the exam takes a share


def _follows(values: Numbers) -> Following:
    return first_order(values["time_constant"])


def _starts(z: Sizes, place: Place) -> Iterator[Scaled]:
    if place.kind == "velocity" and not z.rates_beside:
        return
    for ticks in (0.3, 1.5, 8.0, 30.0):
        yield {"time_constant": ticks * z.period}, {"time_constant": ticks * z.period}


def _sweep(z: Sizes, place: Place) -> Iterator[Scaled]:
    if place.kind == "velocity" and not z.rates_beside:
        return
    for time in up_to(LONGEST_TICKS * z.period):
        yield {"time_constant": time}, {"time_constant": time}


def _bounds(z: Sizes, _: Place) -> Bounds:
    return {"time_constant": (0.0, LONGEST_TICKS * z.period)}


def _natural(z: Sizes, _: Place) -> float:
    return z.period


def _drawn(_: np.random.Generator, __: Sizes, ___: Place) -> Values:
    return {"time_constant": 1e-4}


def _at_share(_: np.random.Generator, __: Sizes, ___: Place, share: float) -> Values:
    return {"time_constant": share * LONGEST_DRAWN}


sensor_lag = Effect(
    name="sensor_lag",
    summary="first-order lag of what is read behind the motion",
    formula="time_constant s' = q - s,  s: the reading",
    places=("sensor", "velocity"),
    parameters=(
        Parameter(
            "time_constant",
            "tau_s",
            "s",
            0.0,
            10.0,
            0.0,
            role="magnitude",
            meaning="in which the reading follows a step to 63 %",
        ),
    ),
    hook="structure",
    code=0,
    mistaken_for=("actuator_lag", "loop_delay", "sensor_filter", "moving_average"),
    reference="first-order low-pass, 1 / (1 + tau_s s)",
    follows=_follows,
    prior=0.03,  # a filter of readings is mostly written in the data sheet, or in the log's name
    family="reading_filter",
    starts=_starts,
    sweep=_sweep,
    bounds=_bounds,
    natural=_natural,
    drawn=_drawn,
    odds=0.7,
    excludes=("actuator_lag", "loop_delay"),
    at_share=_at_share,
)

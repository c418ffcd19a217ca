"""First-order lag of a reading: T s' = q - s, solved exactly (`sim/reading.py`).

A recording, or a law, reads s; forces depend on the motion itself. For a linear device whose
command is played from a file, a lag of the amplifier (`actuator_lag`) delays the motion equally.
The two differ if a law uses the reading, if there is another reading, or if a force depends on the
motion (friction).
"""

import numpy as np

from zwidth.sim.following import Following, first_order
from zwidth.sim.physics.effect import Effect, Numbers, Parameter, Values
from zwidth.sim.physics.lasting import Lasting, one_tick
from zwidth.sim.physics.sizes import Sizes
from zwidth.sim.place import Place

LONGEST_DRAWN = 0.03  # s; the exam draws a share of it


_time = Lasting("time_constant", (0.3, 1.5, 8.0, 30.0), reads=True)


def _follows(values: Numbers) -> Following:
    return first_order(values["time_constant"])


def _drawn(_: np.random.Generator, __: Sizes, ___: Place) -> Values:
    return {"time_constant": 1e-4}


def _at_share(_: np.random.Generator, __: Sizes, ___: Place, share: float) -> Values:
    return {"time_constant": share * LONGEST_DRAWN}


sensor_lag = Effect(
    name="sensor_lag",
    summary="first-order lag of the reading behind the motion",
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
            meaning="time in which the reading reaches 63 % of a step",
        ),
    ),
    hook="structure",
    code=0,
    mistaken_for=("actuator_lag", "loop_delay", "sensor_filter", "moving_average"),
    reference="first-order low-pass, 1 / (1 + tau_s s)",
    follows=_follows,
    prior=0.03,  # a filter of readings is mostly documented in the data sheet, or in the log's name
    family="reading_filter",
    starts=_time.starts,
    sweep=_time.sweep,
    bounds=_time.bounds,
    natural=one_tick,
    drawn=_drawn,
    odds=0.7,
    excludes=("actuator_lag", "loop_delay"),
    at_share=_at_share,
)

"""First-order lag of the amplifier: tau a' = u - a, solved exactly (`sim/plant.py`)."""

import numpy as np

from zwidth.sim.physics.effect import Effect, Parameter, Values
from zwidth.sim.physics.lasting import Lasting, one_tick
from zwidth.sim.physics.sizes import Sizes
from zwidth.sim.place import Place

LONGEST_DRAWN = 0.05  # s; the exam draws a share of it


_time = Lasting("time_constant", (0.05, 0.3, 1.5, 8.0, 30.0))


def _drawn(_: np.random.Generator, __: Sizes, ___: Place) -> Values:
    return {"time_constant": 1e-4}


def _at_share(_: np.random.Generator, __: Sizes, ___: Place, share: float) -> Values:
    return {"time_constant": share * LONGEST_DRAWN}


actuator_lag = Effect(
    name="actuator_lag",
    summary="first-order lag between command and force",
    formula="time_constant a' = u - a,  a: the force",
    places=("command",),
    parameters=(
        Parameter(
            "time_constant",
            "tau_a",
            "s",
            0.0,
            10.0,
            0.0,
            role="magnitude",
            meaning="time in which the force reaches 63 % of a step",
        ),
    ),
    hook="structure",
    code=0,
    mistaken_for=("loop_delay", "extra_mode", "sensor_lag"),
    reference="first-order model of the current loop; a lag counts as delay at low frequency",
    lags=True,
    prior=0.1,  # every amplifier and filter lags; most by far less than a tick
    starts=_time.starts,
    sweep=_time.sweep,
    bounds=_time.bounds,
    natural=one_tick,
    drawn=_drawn,
    odds=1.5,
    excludes=("loop_delay",),
    at_share=_at_share,
)

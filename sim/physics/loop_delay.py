"""The command takes effect some time after the encoder reading; stored as `Interface.delay`."""

import numpy as np

from zwidth.sim.physics.effect import Effect, Parameter, Values
from zwidth.sim.physics.lasting import Lasting, one_tick
from zwidth.sim.physics.sizes import Sizes
from zwidth.sim.place import Place

LONGEST_DRAWN = 0.03  # s; the exam draws a share of it


_time = Lasting("delay", (0.05, 0.3, 1.0, 3.0, 12.0), most=0.3)


def _drawn(_: np.random.Generator, __: Sizes, ___: Place) -> Values:
    return {"delay": 1e-4}


def _at_share(_: np.random.Generator, __: Sizes, ___: Place, share: float) -> Values:
    return {"delay": share * LONGEST_DRAWN}


loop_delay = Effect(
    name="loop_delay",
    summary="time from the encoder reading until the command acts",
    formula="force(t) = u(t - delay)",
    places=("clock",),
    parameters=(
        Parameter(
            "delay",
            "t_d",
            "s",
            0.0,
            10.0,
            0.0,
            role="magnitude",
            meaning="from the reading to the moment the command acts, in seconds",
        ),
    ),
    hook="clock",
    code=0,
    mistaken_for=("actuator_lag",),
    reference="Gil et al., J. Comput. Inf. Sci. Eng. 9, 011005, 2009",
    in_interface="delay",
    adds=True,
    prior=0.1,  # every loop has one, and device files often omit it
    absorbed=True,
    starts=_time.starts,
    sweep=_time.sweep,
    bounds=_time.bounds,
    natural=one_tick,
    drawn=_drawn,
    odds=1.5,
    at_share=_at_share,
)

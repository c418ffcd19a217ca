"""The command takes effect later than the encoder was read; its home is `Interface.delay`."""

from collections.abc import Iterator

import numpy as np

from zwidth.sim.physics.effect import Bounds, Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import Sizes, up_to
from zwidth.sim.place import Place

LONGEST_TICKS = 50.0  # a longer one is another mechanism
LONGEST_DRAWN = 0.03  # s, of which the exam takes a share


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    for ticks in (0.05, 0.3, 1.0, 3.0, 12.0):
        yield {"delay": ticks * z.period}, {"delay": min(ticks, 0.3) * z.period}


def _sweep(z: Sizes, _: Place) -> Iterator[Scaled]:
    for delay in up_to(LONGEST_TICKS * z.period):
        yield {"delay": delay}, {"delay": min(delay, 0.3 * z.period)}


def _bounds(z: Sizes, _: Place) -> Bounds:
    return {"delay": (0.0, LONGEST_TICKS * z.period)}


def _natural(z: Sizes, _: Place) -> float:
    return z.period


def _drawn(_: np.random.Generator, __: Sizes, ___: Place) -> Values:
    return {"delay": 1e-4}


def _at_share(_: np.random.Generator, __: Sizes, ___: Place, share: float) -> Values:
    return {"delay": share * LONGEST_DRAWN}


loop_delay = Effect(
    name="loop_delay",
    summary="time from encoder reading to command taking effect",
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
    prior=0.1,  # every loop has one, and device files forget it
    absorbed=True,
    starts=_starts,
    sweep=_sweep,
    bounds=_bounds,
    natural=_natural,
    drawn=_drawn,
    odds=1.5,
    at_share=_at_share,
)

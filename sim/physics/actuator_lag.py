"""First-order lag of the amplifier: tau a' = u - a, exact in the propagator (`sim/plant.py`)."""

from collections.abc import Iterator

import numpy as np

from zwidth.sim.physics.effect import Bounds, Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import Sizes, up_to
from zwidth.sim.place import Place

LONGEST_TICKS = 50.0  # a longer one is another mechanism, and without end it cuts the command off
LONGEST_DRAWN = 0.05  # s, of which the exam takes a share


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    for ticks in (0.05, 0.3, 1.5, 8.0, 30.0):
        yield {"time_constant": ticks * z.period}, {"time_constant": ticks * z.period}


def _sweep(z: Sizes, _: Place) -> Iterator[Scaled]:
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
            meaning="in which the force follows a step to 63 %",
        ),
    ),
    hook="structure",
    code=0,
    mistaken_for=("loop_delay", "extra_mode", "sensor_lag"),
    reference="first-order model of the current loop; a lag counts as delay at low frequency",
    lags=True,
    prior=0.1,  # every amplifier and filter lags; most by far less than a tick
    starts=_starts,
    sweep=_sweep,
    bounds=_bounds,
    natural=_natural,
    drawn=_drawn,
    odds=1.5,
    excludes=("loop_delay",),
    at_share=_at_share,
)

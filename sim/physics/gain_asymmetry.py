"""The amplifier's gain differs for the two signs: ratio = positive gain over negative gain.

The mean of both gains stays 1, gain 2 r / (1 + r) for u > 0 and 2 / (1 + r) for u < 0, so that the
ratio does not change the mean gain.
"""

from collections.abc import Iterator

import numpy as np

from zwidth.sim.jit import part
from zwidth.sim.lane_type import select
from zwidth.sim.physics.effect import Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import Sizes, sign, up_to
from zwidth.sim.place import Place


def _starts(_: Sizes, __: Place) -> Iterator[Scaled]:
    for off in (-0.1, -0.01, 0.01, 0.1):
        yield {"ratio": 1.0 + off}, {"ratio": abs(off)}


def _sweep(_: Sizes, __: Place) -> Iterator[Scaled]:
    for more in up_to(2.0):
        yield {"ratio": 1.0 + more}, {"ratio": more}
        yield {"ratio": 1.0 / (1.0 + more)}, {"ratio": more / (1.0 + more)}


def _natural(_: Sizes, __: Place) -> float:
    return 1.0


def _drawn(random: np.random.Generator, _: Sizes, __: Place) -> Values:
    return {"ratio": 1.0 + 0.01 * sign(random)}


gain_asymmetry = Effect(
    name="gain_asymmetry",
    summary="positive and negative commands are amplified differently",
    formula="force = 2 ratio / (1 + ratio) u for u > 0,  2 / (1 + ratio) u for u < 0",
    places=("command",),
    parameters=(
        Parameter(
            "ratio",
            "r",
            "",
            1e-3,
            1e3,
            1.0,
            role="magnitude",
            meaning="gain for positive commands over that for negative ones",
        ),
    ),
    hook="command",
    code=2,
    mistaken_for=("constant_force",),
    reference="two-slope gain",
    prior=0.03,  # two half bridges that differ; a closed current loop has one gain
    starts=_starts,
    sweep=_sweep,
    natural=_natural,
    drawn=_drawn,
    odds=0.7,
)


@part
def two_gains(command, p):
    """Return the command times the gain of its sign."""
    gain = 2.0 / (1.0 + p[0])
    return select(command > 0.0, gain * p[0], gain) * command

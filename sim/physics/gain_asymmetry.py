"""The amplifier's gain differs between the two signs: ratio = positive gain over negative gain.

The mean of both gains stays 1, gain 2 r / (1 + r) for u > 0 and 2 / (1 + r) for u < 0, so that the
ratio says nothing about the gain as a whole.
"""

from zwidth.sim.jit import part
from zwidth.sim.lane_type import select
from zwidth.sim.physics.effect import Effect, Parameter

gain_asymmetry = Effect(
    name="gain_asymmetry",
    summary="positive and negative commands are amplified differently",
    places=("command",),
    parameters=(Parameter("ratio", "r", "", 1e-3, 1e3, 1.0),),
    hook="command",
    code=2,
    reference="two-slope gain",
)


@part
def two_gains(command, p):
    """Return the command times the gain of its sign."""
    gain = 2.0 / (1.0 + p[0])
    return select(command > 0.0, gain * p[0], gain) * command

"""The amplifier gives no more than its limit; its home is `Interface.command_limit`."""

import math

from zwidth.sim.jit import part
from zwidth.sim.lane_type import greatest, least
from zwidth.sim.physics.effect import Effect, Parameter

saturation = Effect(
    name="saturation",
    summary="the amplifier's limit",
    places=("command",),
    parameters=(Parameter("limit", "u_max", "N m", 1e-12, math.inf, math.inf),),
    hook="command",
    code=0,
    reference="ideal saturation",
    in_interface="command_limit",
)


@part
def limit_command(command, limit):
    """Return the command held between -limit and limit; NaN stays NaN, so that the run stops."""
    return least(greatest(command, -limit), limit)

"""The digital-to-analogue converter knows only steps; its home is `Interface.command_step`."""

from zwidth.sim.jit import part
from zwidth.sim.lane_type import any_lane, select
from zwidth.sim.physics.effect import Effect, Parameter
from zwidth.sim.physics.rounding import to_nearest

command_step = Effect(
    name="command_step",
    summary="the command is converted in steps",
    places=("command",),
    parameters=(Parameter("step", "Delta_u", "N m", 0.0, 1e6, 0.0),),
    hook="command",
    code=0,
    reference="uniform mid-tread quantiser",
    in_interface="command_step",
)


@part
def quantise_command(command, step):
    """Return the command rounded to the nearest step, ties away from zero."""
    stepped = step != 0.0
    if not any_lane(stepped):
        return command
    return select(stepped, to_nearest(command, select(stepped, step, 1.0)), command)

"""The encoder counts in steps; its home is `Interface.encoder_step`."""

from zwidth.sim.jit import part
from zwidth.sim.lane_type import any_lane, floor, select
from zwidth.sim.physics.effect import Effect, Parameter
from zwidth.sim.physics.rounding import to_nearest

encoder_step = Effect(
    name="encoder_step",
    summary="the encoder counts in steps",
    places=("sensor",),
    parameters=(Parameter("step", "Delta", "rad", 0.0, 1e3, 0.0),),
    hook="sensor",
    code=0,
    reference="Abbott & Okamura, IEEE T. Robotics 21(5), 2005",
    in_interface="encoder_step",
)


@part
def read_encoder(position, step, downwards):
    """Return the position as counted: nearest step (ties away from zero), or the step below."""
    stepped = step != 0.0
    if not any_lane(stepped):
        return position
    size = select(stepped, step, 1.0)
    counted = size * floor(position / size) if downwards else to_nearest(position, size)
    return select(stepped, counted, position)

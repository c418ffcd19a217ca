"""The command takes effect later than the encoder was read; its home is `Interface.delay`."""

from zwidth.sim.physics.effect import Effect, Parameter

loop_delay = Effect(
    name="loop_delay",
    summary="time from encoder reading to command taking effect",
    places=("clock",),
    parameters=(Parameter("delay", "t_d", "s", 0.0, 10.0, 0.0),),
    hook="clock",
    code=0,
    reference="Gil et al., J. Comput. Inf. Sci. Eng. 9, 011005, 2009",
    in_interface="delay",
)

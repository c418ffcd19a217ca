"""First-order lag of the amplifier: tau a' = u - a, exact in the propagator (`sim/plant.py`)."""

from zwidth.sim.physics.effect import Effect, Parameter

actuator_lag = Effect(
    name="actuator_lag",
    summary="first-order lag between command and force",
    places=("command",),
    parameters=(Parameter("time_constant", "tau_a", "s", 0.0, 10.0, 0.0),),
    hook="structure",
    code=0,
    reference="first-order model of the current loop; a lag counts as delay at low frequency",
)

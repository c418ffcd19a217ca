"""A spring to ground, exact in the propagator; at m1 its home is the chain's own k0."""

from zwidth.sim.physics.effect import Effect, Parameter

ground_spring = Effect(
    name="ground_spring",
    summary="a spring from a mass to ground",
    places=("m1", "m3"),
    parameters=(Parameter("stiffness", "k_0", "N m/rad", 0.0, 1e12, 0.0),),
    hook="structure",
    code=0,
    reference="Hooke's law",
)

"""A further mass on a spring and damper: an unmodelled mode, or a hand; exact in the propagator.

It is one more mass of the device, after those of the chain (`sim/plant.py`), and starts at rest or
as `Start` says. Without mass there is nothing to hold the spring, and nothing is added.
"""

from zwidth.sim.physics.effect import Effect, Parameter

extra_mode = Effect(
    name="extra_mode",
    summary="a further mass on a spring and damper",
    places=("m1", "m3"),
    parameters=(
        Parameter("mass", "m_x", "kg m2", 0.0, 1e6, 0.0, "kg"),
        Parameter("stiffness", "k_x", "N m/rad", 0.0, 1e12, None),
        Parameter("damping", "b_x", "N m s/rad", 0.0, 1e9, None),
    ),
    hook="structure",
    code=0,
    reference="a hand as mass, spring and damper: Hogan, Proc. ICRA 1989",
)

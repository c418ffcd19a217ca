"""Spring that is met on one side only: f = -stiffness (q - place) where side (q - place) > 0.

This is not an effect of the library but a stop, soft or hard, which a recording meets at its ends.
The diagnosis uses it to test whether a spring that was named is really a stop (`forces/probes.py`).
side: 1 or -1.
"""

from zwidth.sim.jit import part
from zwidth.sim.lane_type import select
from zwidth.sim.physics.effect import Effect, Parameter

one_sided_spring = Effect(
    name="one_sided_spring",
    summary="spring that is met on one side only",
    places=("m1",),
    parameters=(
        Parameter("place", "q_s", "rad", -1e6, 1e6, None),
        Parameter("stiffness", "k_s", "N m/rad", 0.0, 1e12, 0.0),
        Parameter("side", "s", "", -1.0, 1.0, None),
    ),
    hook="force",
    code=10,
    reference="unilateral contact, Kelvin",
)


@part
def stop_force(q, p):
    """Force at position q."""
    inside = q - p[0]
    return select(inside * p[2] > 0.0, -p[1] * inside, 0.0)

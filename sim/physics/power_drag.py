"""Drag that grows with a power of speed: f = -level sign(v) |v / speed|^power.

This is not an effect of the library, which has the square alone. The diagnosis uses it to test
whether a named `quadratic_drag` is drag by another power (`diagnosis/forces/probes.py`). speed is
the one at which the level holds, and is not free beside level and power. For a power below one the
slope at v = 0 has no bound, and no substep would be short enough.
"""

from zwidth.sim.elementary import power
from zwidth.sim.jit import part
from zwidth.sim.lane_type import signed
from zwidth.sim.physics.effect import Effect, Parameter
from zwidth.sim.place import MASSES

power_drag = Effect(
    name="power_drag",
    summary="drag that grows with a power of speed",
    places=MASSES,
    parameters=(
        Parameter("level", "f_p", "N m", 0.0, 1e6, 0.0),
        Parameter("power", "p", "", 1.0, 8.0, None),
        Parameter("speed", "v_p", "rad/s", 1e-12, 1e6, None),
    ),
    hook="force",
    code=9,
    reference="H. Schlichting, Boundary-Layer Theory, for powers from 1 (Stokes) to 2 (Rayleigh)",
)


@part
def power_force(v, p):
    """Force at velocity v."""
    return -signed(p[0] * power(abs(v) / p[2], p[1]), v)

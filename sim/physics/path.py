"""The path of a substep, for forces that depend on the path and not on time."""

from zwidth.sim.jit import part
from zwidth.sim.lane_type import select


@part
def out_and_back(q0, q1, v0, v1, h):
    """Return the way to the turning point and the way after it (0 where the motion does not turn).

    With the velocity straight from v0 to v1 it turns at t = h v0 / (v0 - v1), after v0 t / 2.
    """
    whole = q1 - q0
    turns = v0 * v1 < 0.0
    out = select(turns, 0.5 * h * v0 * v0 / select(turns, v0 - v1, 1.0), whole)
    return out, select(turns, whole - out, 0.0)

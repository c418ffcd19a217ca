"""The kernel's way into every effect: one line an effect, under the hook at which it enters.

A new effect adds its file, its line here, and its line in the registry (`sim/physics/__init__.py`).
Codes are the `Effect.code` of its declaration; parameters arrive in the declaration's order.
"""

from sim.jit import part
from sim.physics.coulomb_friction import coulomb_bounds
from sim.physics.constant_force import constant_level
from sim.physics.cubic_stiffness import cubic_force
from sim.physics.quadratic_drag import drag_force


@part
def smooth_force(code, q, v, z, p):
    """Force on the first place from relative position q, velocity v, internal state z."""
    if code == 1:
        return cubic_force(q, p)
    if code == 2:
        return drag_force(v, p)
    if code == 3:
        return constant_level(p)
    return 0.0


@part
def next_internal(code, z, q0, q1, v0, v1, h, p):
    """Internal state after a substep of length h that went from (q0, v0) to (q1, v1)."""
    return z


@part
def friction_bounds(code, v, p):
    """Bounds of a dry force at velocity v: (lower, upper) sliding, (lower, upper) sticking."""
    if code == 1:
        return coulomb_bounds(p)
    return 0.0, 0.0, 0.0, 0.0


@part
def sensed(code, position, p):
    """Position as the sensor reports it, before its step."""
    return position


@part
def amplified(code, command, p):
    """Command as the amplifier passes it on, between its step and its limit."""
    return command


@part
def delivered(code, tick, p):
    """Whether the command of this tick is delivered at all."""
    return True

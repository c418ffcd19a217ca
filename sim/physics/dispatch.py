"""How the kernel calls every effect: one line for each, at the hook where it enters.

A new effect adds its file, its line here, and its line in the registry (`sim/physics/__init__.py`).
Codes are the `Effect.code` of its declaration; parameters arrive in the declaration's order, what
the effect borrows after them. Codes from 100 on are effects of the user's own (`own.py`).
"""

from zwidth.sim.jit import part
from zwidth.sim.physics.backlash import backlash_force, within_gap
from zwidth.sim.physics.constant_force import constant_level
from zwidth.sim.physics.coulomb_friction import coulomb_bounds
from zwidth.sim.physics.cubic_stiffness import cubic_force
from zwidth.sim.physics.dead_band import beyond_band
from zwidth.sim.physics.directional_friction import directional_bounds
from zwidth.sim.physics.dropped_samples import is_delivered
from zwidth.sim.physics.encoder_eccentricity import off_centre
from zwidth.sim.physics.falling_limit import beyond_falling_limit
from zwidth.sim.physics.force_ripple import ripple_force
from zwidth.sim.physics.free_amplifier import amplified_freely
from zwidth.sim.physics.free_force import grid_law
from zwidth.sim.physics.free_law import table_law
from zwidth.sim.physics.free_product import product_law
from zwidth.sim.physics.free_sensor import read_freely
from zwidth.sim.physics.free_shift import shifted_law
from zwidth.sim.physics.gain_asymmetry import two_gains
from zwidth.sim.physics.gravity_pendulum import pendulum_force
from zwidth.sim.physics.hysteresis import bouc_wen_force, next_yield
from zwidth.sim.physics.load_friction import load_bounds
from zwidth.sim.physics.one_sided_spring import stop_force
from zwidth.sim.physics.open_winding import lost_damping
from zwidth.sim.physics.own import own_command, own_force, own_sensor
from zwidth.sim.physics.periodic_force import periodic
from zwidth.sim.physics.power_drag import power_force
from zwidth.sim.physics.presliding_friction import dahl_force, next_bristle
from zwidth.sim.physics.quadratic_drag import drag_force
from zwidth.sim.physics.rectified_sensor import magnitude
from zwidth.sim.physics.rising_friction import rising_bounds
from zwidth.sim.physics.servo_dead_zone import within_zone
from zwidth.sim.physics.servo_integral import next_integral
from zwidth.sim.physics.servo_limit import beyond_limit
from zwidth.sim.physics.stribeck_friction import stribeck_bounds

INTEGRAL = 18  # the force whose state is the integral part of a servo


@part
def smooth_force(code, q, v, z, u, w, s, p):
    """Force on the first place: relative position q and velocity v, internal z, held command u.

    w: the command plus the integral action of a loop; s: the share of the drive's force that acts,
    0 if it is off. Laws over states are excluded; they are in `force_over_states`.
    """
    if code == 1:
        return cubic_force(q, p)
    if code == 2:
        return drag_force(v, p)
    if code == 3:
        return constant_level(p)
    if code == 4:
        return dahl_force(z, p)
    if code == 5:
        return bouc_wen_force(z, p)
    if code == 6:
        return pendulum_force(q, p)
    if code == 7:
        return ripple_force(q, p)
    if code == 8:
        return backlash_force(q, v, z, p)
    if code == 9:
        return power_force(v, p)
    if code == 10:
        return stop_force(q, p)
    if code == 11:
        return periodic(q, p)
    if code == 12:
        return beyond_limit(w, q, v, s, p)
    if code == 13:
        return within_zone(u, q, s, p)
    if code == 14 or code == 15:  # one place, so that the law is compiled once
        return table_law(q if code == 14 else v, p)
    if code == 16:
        return lost_damping(v, s, p)
    if code == 17:
        return beyond_falling_limit(w, q, v, s, p)
    if code == INTEGRAL:
        return z
    if is_over_states(code):
        return 0.0
    return own_force(code, q, v, u, p)


@part
def is_over_states(code):
    """Whether a force is one of `force_over_states`."""
    return code == 19 or code == 20 or code == 21


@part
def force_over_states(code, q, v, u, t, p):
    """Force of a law over any of its states; t: time since the run or the recording began."""
    if code == 19:
        return grid_law(q, v, u, t, p)
    if code == 20:
        return product_law(q, v, u, t, p)
    return shifted_law(q, v, u, t, p)


@part
def first_internal(code, q, p):
    """Internal state at the start, of a force that has been at rest at relative position q."""
    if code == 8:
        return within_gap(q, p)
    return 0.0


@part
def next_internal(code, z, q0, q1, v0, v1, h, u, s, p):
    """Internal state after a substep of length h that went from (q0, v0) to (q1, v1)."""
    if code == 4:
        return next_bristle(z, q0, q1, v0, v1, h, p)
    if code == 5:
        return next_yield(z, q0, q1, v0, v1, h, p)
    if code == INTEGRAL:
        return next_integral(z, q0, q1, h, u, s, p)
    return z


@part
def friction_bounds(code, q, v, w, s, p):
    """Bounds of a dry force at position q, velocity v and under the held command w.

    w, s as in `smooth_force`. Returns (lower, upper) sliding, (lower, upper) sticking.
    """
    if code == 1:
        return coulomb_bounds(p)
    if code == 2:
        return stribeck_bounds(v, p)
    if code == 3:
        return directional_bounds(v, p)
    if code == 4:
        return load_bounds(q, v, w, s, p)
    if code == 5:
        return rising_bounds(v, p)
    return 0.0, 0.0, 0.0, 0.0


@part
def sensed(code, position, p):
    """Position as the sensor reports it, before its step."""
    if code == 1:
        return off_centre(position, p)
    if code == 2:
        return magnitude(position)
    if code == 3:
        return read_freely(position, p)
    return position + own_sensor(code, position, p)


@part
def amplified(code, command, p):
    """Command as the amplifier passes it on, between its step and its limit.

    Limits of its rate (4, 5) come after that, in `amplify`.
    """
    if code == 1:
        return beyond_band(command, p)
    if code == 2:
        return two_gains(command, p)
    if code == 3:
        return amplified_freely(command, p)
    if code == 4:
        return command
    if code == 5:
        return command
    return command + own_command(code, command, p)


@part
def delivered(code, tick, p):
    """Whether the command of this tick is delivered at all."""
    if code == 1:
        return is_delivered(tick, p)
    return True

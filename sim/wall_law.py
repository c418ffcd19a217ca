"""The laws of built-in walls, written once for one run and for many side by side.

push is the force with which a wall presses back at a reading y and a velocity estimate v; the
command is -push. With depth = y - x_w, and p the numbers of a wall (K, B, x_w, one-sided) and two
more:

    plain       K depth + B v
    texture     K ((1 - s) depth + s sin(k depth)/k) + B v, a grating of wave number k and share s
                on a wall; K is the slope where it is steepest, and s = 1 the grating alone
    region      K depth + B v from x_w to x_w + width only, pressing and pulling; K = 0 is a region
                of damping, and width 0 means everywhere
    guarded     the plain wall, watched by a passivity observer and held by a passivity controller
                (B. Hannaford, J.-H. Ryu, IEEE T. Robotics and Automation 18, 1, 2002)

The observer of the guarded wall sums the energy that the wall takes in, E += push_{k-1} (y_k -
y_{k-1}), which for a held command without delay is exact (S. Stramigioli, C. Secchi, A. van der
Schaft, C. Fantuzzi, IEEE T. Robotics 21, 574, 2005), from what it holds at the start on. Where the
push of the coming tick would take E below zero, at the velocity estimated now, the controller adds
damping a v, a = -(E + push v T)/(v^2 T), up to `most`: sampled damping drives what it is to damp
when there is too much of it.

A one-sided wall acts at depth > 0 only, and never pulls.
"""

# pyright: reportMissingParameterType=false, reportUnknownParameterType=false

from zwidth.sim.elementary import sin
from zwidth.sim.jit import part
from zwidth.sim.lane_type import greatest, least, select

PLAIN, TEXTURE, REGION, GUARDED = 0, 1, 2, 3
STIFFNESS, DAMPING, POSITION, ONE_SIDED, FIRST, SECOND = 0, 1, 2, 3, 4, 5  # of a wall's numbers
CONTACT, ENERGY, EARLIER, PUSHED = 0, 1, 2, 3  # of a wall's memory
NUMBERS, MEMORY = 6, 4


@part
def one_side(p, depth, push):
    """Limit a push to positive values if the wall is one-sided."""
    inside = select(depth > 0.0, greatest(0.0, push), 0.0)
    return select(p[ONE_SIDED] == 0.0, push, inside)


@part
def plain_push(p, y, v):
    """Push of a spring and a damper."""
    depth = y - p[POSITION]
    return one_side(p, depth, p[STIFFNESS] * depth + p[DAMPING] * v)


@part
def texture_push(p, y, v):
    """Push of a grating on a spring, and of a damper."""
    depth = y - p[POSITION]
    share = p[SECOND]
    grating = sin(p[FIRST] * depth) / p[FIRST]
    return one_side(
        p, depth, p[STIFFNESS] * ((1.0 - share) * depth + share * grating) + p[DAMPING] * v
    )


@part
def region_push(p, y, v):
    """Push of a spring and a damper between two places."""
    depth = y - p[POSITION]
    inside = ((depth > 0.0) & (depth < p[FIRST])) | (p[FIRST] == 0.0)
    return select(inside, p[STIFFNESS] * depth + p[DAMPING] * v, 0.0)


@part
def guarded_push(p, k, t, y, v, m):
    """Push of a plain wall with a passivity observer and controller; m keeps its account."""
    depth = y - p[POSITION]
    push = plain_push(p, y, v)
    there = select((p[ONE_SIDED] == 0.0) | (depth > 0.0), 1.0, 0.0)
    if k == 0:
        energy = there * (0.5 * p[STIFFNESS] * (depth * depth))
        period = 0.0
    else:
        energy = m[ENERGY] + m[PUSHED] * (y - m[EARLIER])
        period = t / k
    lacking = greatest(0.0, -(energy + push * v * period))
    square = v * v * period
    damping = select(square > 0.0, lacking / select(square > 0.0, square, 1.0), 0.0)
    damping = least(damping, p[FIRST])
    push = one_side(p, depth, push + there * (damping * v))
    m[CONTACT], m[ENERGY], m[EARLIER], m[PUSHED] = there, energy, y, push
    return push


@part
def wall_push(law, p, k, t, y, v, m):
    """Push of a wall under a law, one of PLAIN to GUARDED."""
    if law == PLAIN:
        return plain_push(p, y, v)
    if law == TEXTURE:
        return texture_push(p, y, v)
    if law == REGION:
        return region_push(p, y, v)
    return guarded_push(p, k, t, y, v, m)

"""Free play in a link: within the gap it carries no force, beyond it the link's own k and c.

gap: the whole free play, +-a with a = gap / 2. The link is a spring and damper in series with a pin
that may move within +-a (z, the internal state); with q the relative position, s = q - z is what
the link is deformed by, and it carries T = k s + c s':

    pin against the upper side, z = a:  T = max(0, k (q - a) + c q')    (it pushes, never pulls)
    pin free:                           T = 0, so s' = -(k / c) s: the link springs back
    pin against the lower side:         mirrored

The pin moves freely until a side stops it: z_1 = q_1 - s_0 exp(-k h / c), held within +-a, which is
exact while the pin does not hit a side inside the substep. c <= 0 is a link without memory, z = q
within +-a.

The propagator holds the whole link, k q + c q'; this effect gives back what the gap takes,
k q + c q' - T: the constant k a in contact (exact), all of the link's force inside the gap (second
order; stable for h < 2 sqrt(m / k) and h < 2 m / c, m the reduced mass of the two neighbours). At
an impact the damper's force jumps by c q', and a jump inside a substep is worth half a substep of
that force at most: with c > 0 first order, and small as c h / m; with c = 0 second order. In the
ledger, what the link's damper books inside the gap this effect books back: read the two together.
Other effects in the same link act beside it, between its two masses.
"""

from zwidth.sim.elementary import exp
from zwidth.sim.jit import part
from zwidth.sim.lane_type import greatest, least, select
from zwidth.sim.physics.effect import Effect, Parameter

backlash = Effect(
    name="backlash",
    summary="free play in a link",
    places=("link12", "link23"),
    parameters=(Parameter("gap", "2 alpha", "rad", 0.0, 1e3, 0.0),),
    hook="force",
    code=8,
    reference="Nordin, Galic & Gutman, Int. J. Adaptive Control Signal Proc. 11(1), 1997",
    borrows=("link_spring", "link_damper"),
)


@part
def backlash_force(q, v, z, p):
    """What the gap takes from the link at (q, v) with the pin at z."""
    half = 0.5 * p[0]
    whole = p[1] * q + p[2] * v
    lower = select(z <= -half, greatest(-p[1] * half, whole), whole)
    taken = select(z >= half, least(p[1] * half, whole), lower)
    return select(half == 0.0, 0.0, taken)


@part
def within_gap(q, p):
    """Return q held within the gap."""
    half = 0.5 * p[0]
    return greatest(-half, least(half, q))


@part
def next_pin(z, q0, q1, h, p):
    """Pin after a substep."""
    damped = p[2] > 0.0
    left = select(damped, exp(-p[1] * h / select(damped, p[2], 1.0)), 0.0)
    return within_gap(q1 - (q0 - z) * left, p)

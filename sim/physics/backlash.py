"""Free play in a link: within the gap it carries no force, beyond it the link's own k and c.

gap: the whole free play, +-a with a = gap / 2. The link is a spring and damper in series with a pin
that may move within +-a (z, the internal state); with q the relative position, s = q - z is what
the link is deformed by, and it carries T = k s + c s':

    pin against the upper side, z = a:  T = max(0, k (q - a) + c q')    (it pushes, never pulls)
    pin free:                           T = 0, so s' = -(k / c) s: the link springs back
    pin against the lower side:         mirrored

c <= 0 is a link without memory, z = q within +-a.

Between its events a link is linear, and a substep exact: while it pushes on a side the propagator
holds the whole of it, k q + c q', and this effect gives back the constant k a; while it carries
nothing the propagator is that of the chain without it (`sim/kernel.py`), and the pin is at

    z(t) = q(t) - s_0 exp(-k t / c).

Inside a substep it lets go where T falls through zero, and hits a side where z does (`taken_over`),
which leaves an error of third order. In the energy ledger, the amount that is booked for the link's
spring while the link carries nothing is booked for this effect. Other effects in the same link act
beside it, between its two masses.
"""

import math
from collections.abc import Iterator

import numpy as np

from zwidth.sim.elementary import exp
from zwidth.sim.jit import part
from zwidth.sim.lane_type import greatest, least, root, select
from zwidth.sim.physics.effect import Bounds, Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import SMALLEST, Sizes, up_to
from zwidth.sim.place import LINKS, Place

APART = 3.0  # times as wide is the next start: its valley is no wider


def _starts(z: Sizes, place: Place) -> Iterator[Scaled]:
    """From a part of the spring's deflection up to a good part of the travel, as in a worn gear."""
    least, most = 0.003 * z.reach(place), 0.3 * max(z.reach(place), z.position)
    count = math.ceil(math.log(most / least) / math.log(APART)) + 1
    for gap in np.geomspace(least, most, count).tolist():
        yield {"gap": gap}, {"gap": gap}


def _sweep(z: Sizes, place: Place) -> Iterator[Scaled]:
    for gap in up_to(z.span, min(SMALLEST * z.span, 0.03 * z.reach(place))):
        yield {"gap": gap}, {"gap": gap}


def _bounds(z: Sizes, _: Place) -> Bounds:
    """In a wider gap the first mass would never have met the second."""
    return {"gap": (0.0, z.span)}


def _natural(z: Sizes, place: Place) -> float:
    return z.reach(place)


def _drawn(_: np.random.Generator, z: Sizes, place: Place) -> Values:
    return {"gap": 0.1 * z.reach(place)}


def _at_share(_: np.random.Generator, z: Sizes, __: Place, share: float) -> Values:
    """Of the rms travel."""
    return {"gap": share * z.position}


backlash = Effect(
    name="backlash",
    summary="free play in a link",
    formula=(
        "force of the link: 0 within gap,  "
        "k (|q| - gap / 2) sign(q) beyond it, and the link's damper while in contact"
    ),
    places=LINKS,
    parameters=(
        Parameter(
            "gap",
            "2 alpha",
            "rad",
            0.0,
            1e3,
            0.0,
            role="magnitude",
            valleys=True,
            meaning="all of the play, from one side to the other: twice the half gap",
        ),
    ),
    hook="force",
    code=8,
    mistaken_for=("cubic_stiffness", "hysteresis"),
    reference="Nordin, Galic & Gutman, Int. J. Adaptive Control Signal Proc. 11(1), 1997",
    borrows=("link_spring", "link_damper"),
    prior=0.1,  # of links, those with gears or couplings; cables and belts have none
    creased=True,
    starts=_starts,
    sweep=_sweep,
    bounds=_bounds,
    natural=_natural,
    drawn=_drawn,
    odds=3.0,
    at_share=_at_share,
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
def at_a_side(z, p):
    """Whether a pin stands at a side."""
    return abs(z) >= 0.5 * p[0]


@part
def pushed_side(q, v, z, h, p):
    """Side that the link pushes on, 1 or -1; 0 while it carries nothing. Without a gap it is 1.

    A pin at a side that the link pulls at (after a correction) leaves it with z' = T / c. Where
    that crosses the gap within h, the link counts as pushing still, for `lets_go` to cross it.
    """
    half, whole = 0.5 * p[0], p[1] * q + p[2] * v
    above, below = whole - p[1] * half, -whole - p[1] * half
    damped = p[2] > 0.0
    time, wide = select(damped, h, 1.0), 2.0 * half * select(damped, p[2], p[1])
    upper = (z >= half) & ((above >= 0.0) | (-above * time > wide))
    lower = (z <= -half) & ((below >= 0.0) | (-below * time > wide))
    return select(upper | (half == 0.0), 1.0, select(lower, -1.0, 0.0))


@part
def springs_back(t, p):
    """Share of its deformation that a link keeps after carrying nothing for a time t."""
    damped = p[2] > 0.0
    return select(damped, exp(-p[1] * t / select(damped, p[2], 1.0)), 0.0)


@part
def lets_go(q0, v0, q1, v1, h, side, p):
    """For a link that pushes on a side as a substep begins: the force to subtract, and its pin.

    q, v at both ends as if it went on to push, and then to pull. T = side (k q + c v) - k a is t_0
    >= 0 at first; if it ends at t_1 < 0, the link lets go at s = t_0 / (t_0 - t_1) of the substep,
    and the pull that it would have from there on is subtracted, too,

        mean of what is taken = side (k a + (1 - s) t_1 / 2).

    A pin that crosses the gap by then does so in a part g of (1 - s), by a line; on the other side
    -k a is taken:

        side (s k a + (1 - s) [g (k a + g t_1 / 2) - (1 - g) k a]).

    s is a line's, off by O(h), and so is what hangs on it, t_1: the impulse is off by O(h^3). The
    pin is where the deformation at s, of the cubic through both ends, has sprung back to, or where
    z' = T / c brings it, if that is farther from the side. T may begin below zero (`pushed_side`):
    then s = 0, and the mean holds with t_0 besides.
    """
    half = 0.5 * p[0]
    push = p[1] * half
    t0 = side * (p[1] * q0 + p[2] * v0) - push
    t1 = side * (p[1] * q1 + p[2] * v1) - push
    gone = (half > 0.0) & (t1 < 0.0)
    held, pulled = greatest(0.0, t0), least(0.0, t0)
    s = select(gone, held / select(gone, held - t1, 1.0), 1.0)
    rest = 1.0 - s
    there = rest * rest * ((1.0 + 2.0 * s) * q0 + s * h * v0)
    there += s * s * ((3.0 - 2.0 * s) * q1 - rest * h * v1)
    pin = q1 - (there - side * half) * springs_back(rest * h, p)
    damped = p[2] > 0.0
    leaves = select(damped, 0.5 * rest * h * t1 / select(damped, p[2], 1.0), 0.0)  # z' = T / c
    pin = select(damped & gone, side * least(side * pin, half + leaves), pin)
    beyond = gone & (side * pin < -half)
    across = select(beyond, 2.0 * half / select(beyond, half - side * pin, 1.0), 1.0)
    crossing = push + pulled + 0.5 * across * (t1 - pulled)
    mean = push * s + rest * select(gone, across * crossing - (1.0 - across) * push, 0.0)
    # Pulled at first and pushing at the end: on the other side until then.
    back = (half > 0.0) & (t0 < 0.0) & (t1 >= 0.0)
    mean -= select(back, 2.0 * push * t0 / select(back, t0 - t1, 1.0), 0.0)
    return side * mean, select(gone, within_gap(pin, p), side * half)


@part
def is_hit(q0, v0, z0, q1, v1, h, yields, p):
    """For a link that carries nothing as a substep begins: force on the first mass, shift, pin.

    q, v at both ends as if it went on so; yields [1/kg]: what both masses give way to a force
    between them. The pin goes from z_0 to z_1, by a parabola with its speed z_0' = v_0 + k s_0 / c
    at first, and hits a side a at the share s where

        z_0 + s h z_0' + s^2 (z_1 - z_0 - h z_0') = a,

    off by O(h^2). From there on the link pushes with T = k (q - a) + c q', for tau = (1 - s) h,
    in which the force itself slows what drives it: with the mean of T as it would be without
    itself, r the deformation and v the speed at s,

        T = (k (r + tau (2 v + v_1) / 6) + c (v + v_1) / 2)
            / (1 + (k tau^2 / 6 + c tau / 2) yields).

    Held over the substep it counts 1 - s. That moves masses too far, since it acts late: from
    impulses, by h^2 / (2 m) s (1 - s) T, which is what `shift` returns, times h^2 / (2 m).
    """
    half = 0.5 * p[0]
    damped = p[2] > 0.0
    deformed = select(damped, q0 - z0, 0.0)
    rate = p[1] / select(damped, p[2], 1.0)
    end = q1 - deformed * springs_back(h, p)
    hit = (half > 0.0) & (abs(end) >= half)
    side = select(end > 0.0, 1.0, -1.0)
    far = greatest(0.0, half - side * (q0 - deformed))
    first = side * h * (v0 + rate * deformed)
    bend = side * (end - (q0 - deformed)) - first
    wide = root(greatest(0.0, first * first + 4.0 * bend * far))
    forth = first + wide
    ahead = hit & (first > 0.0) & (forth > 0.0)
    back = hit & (first <= 0.0) & (bend > 0.0)
    s = select(ahead, 2.0 * far / select(ahead, forth, 1.0), 0.0)
    s = select(back, 0.5 * (wide - first) / select(back, bend, 1.0), s)
    s = least(1.0, greatest(0.0, s))
    rest = 1.0 - s
    tau = rest * h
    v = v0 + s * (v1 - v0)
    r = deformed * springs_back(s * h, p)
    force = p[1] * (r + tau * (2.0 * v + v1) / 6.0) + 0.5 * p[2] * (v + v1)
    force = force / (1.0 + (p[1] * tau / 6.0 + 0.5 * p[2]) * tau * yields)
    force = select(hit, greatest(0.0, side * force), 0.0)
    pin = select(hit, side * half, within_gap(end, p))
    return -side * rest * force, side * s * rest * force, pin

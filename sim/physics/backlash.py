"""Free play in a link: within the gap it carries no force, beyond it the link's own k and c.

gap: the whole play, from one side to the other. The link is a spring and a damper in series with a
pin that is free to move within the gap. With q the deflection of the link, z the place of the pin,
s = q - z and a = gap / 2, the link's force is T = k s + c s':

    pin at the upper side, z = a:  T = max(0, k (q - a) + c q')    (it pushes, never pulls)
    pin free:                      T = 0, so s' = -(k / c) s: the link springs back
    pin at the lower side:         mirrored

Without a damper the link springs back at once. Other effects in the same link act directly between
its two masses, also within the gap.
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


# Between its events a link is linear, and a substep exact: while it pushes on a side the propagator
# holds the whole of it, k q + c q', and this effect gives back the constant k a; while it carries
# nothing the propagator is that of the chain without it (`sim/kernel.py`), and the pin z, which is
# the internal state, is at
#
#     z(t) = q(t) - s_0 exp(-k t / c);
#
# c <= 0 is a link without memory, z = q within +-a. Inside a substep it lets go where T falls
# through zero, and hits a side where z does (`taken_over`), which leaves an error of third order.
# In the energy ledger, the amount that is booked for the link's spring while the link carries
# nothing is booked for this effect.


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
    """Return the side that the link pushes on, 1 or -1; 0 while it carries no force; 1 without gap.

    After a correction, the link may pull on the side where the pin is: the pin then leaves the side
    (`leaves`). If it would cross the gap within h, the link still counts as pushing, so that
    `lets_go` computes the crossing.
    """
    half, whole = 0.5 * p[0], p[1] * q + p[2] * v
    above, below = whole - p[1] * half, -whole - p[1] * half
    upper = (z >= half) & ((above >= 0.0) | (-leaves(above, h, p) > 2.0 * half))
    lower = (z <= -half) & ((below >= 0.0) | (-leaves(below, h, p) > 2.0 * half))
    return select(upper | (half == 0.0), 1.0, select(lower, -1.0, 0.0))


@part
def leaves(t, h, p):
    """Return how far a pin leaves its side in a time h if the link would pull on it with t < 0.

    z' = T / c at first; the deformation that causes T decays with c / k, so the pin goes no farther
    than T / k, and by (1 - exp(-k h / c)) T / k for a constant q.
    """
    stiff = p[1] > 0.0
    far = t * select(stiff, (1.0 - springs_back(h, p)) / select(stiff, p[1], 1.0), 0.0)
    return select(stiff, far, t * h / select(p[2] > 0.0, p[2], 1.0))


@part
def springs_back(t, p):
    """Share of its deformation that a link keeps after carrying nothing for a time t."""
    damped = p[2] > 0.0
    return select(damped, exp(-p[1] * t / select(damped, p[2], 1.0)), 0.0)


@part
def lets_go(q0, v0, q1, v1, h, side, p):
    """Return the mean force to subtract over a substep, and where the pin is at its end.

    For a link that pushes on a side when the substep begins. q0, v0, q1, v1: state at both ends,
    computed as if the link could also pull; a: half the gap. T = side (k q + c v) - k a is the
    link's force, t_0 >= 0 at first. If T ends at t_1 < 0, the link lets go at the fraction s = t_0
    / (t_0 - t_1) of the substep. From then on it cannot pull, so the pull is subtracted, too:

        mean force to subtract = side (k a + (1 - s) t_1 / 2).

    If the pin crosses the gap within the substep, it does so in a fraction g of (1 - s), on a
    straight line; on the other side, -k a is subtracted:

        side (s k a + (1 - s) [g (k a + g t_1 / 2) - (1 - g) k a]).

    s is interpolated linearly, with an error of O(h); it multiplies t_1, which is O(h), too. So the
    impulse has an error of O(h^3). The pin is where the deformation at s (by the cubic through both
    ends) has relaxed to, or where the mean pull brings it (`leaves`), if that is farther. If T is
    below zero from the start (`pushed_side`), s = 0, and the mean includes t_0.
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
    away = half + leaves(0.5 * t1, rest * h, p)
    pin = select(damped & gone, side * least(side * pin, away), pin)
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
    """Return the force on the first mass, its shift, and the pin, when the pin may hit a side.

    For a link that carries no force when the substep begins. q0, v0, q1, v1: state at both ends,
    computed as if this continued; yields [1/kg]: the acceleration between both masses per force.
    The pin goes from z_0 to z_1 on a parabola with the initial speed z_0' = v_0 + k s_0 / c, and
    hits the side a at the fraction s of the substep where

        z_0 + s h z_0' + s^2 (z_1 - z_0 - h z_0') = a,

    with an error of O(h^2). From then on, for tau = (1 - s) h, the link pushes with T = k (q - a) +
    c q'. This force slows the motion that causes it. With r the deformation and v the speed at s,

        T = (k (r + tau (2 v + v_1) / 6) + c (v + v_1) / 2)
            / (1 + (k tau^2 / 6 + c tau / 2) yields).

    is its mean over tau, so (1 - s) T over the substep. A force held over the whole substep moves
    the masses too far, by h^2 / (2 m) s (1 - s) T, since the real one acts late. The shift that is
    returned is this distance, without the factor h^2 / (2 m).
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

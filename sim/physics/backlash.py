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

import math
from collections.abc import Iterator

import numpy as np

from zwidth.sim.elementary import exp
from zwidth.sim.jit import part
from zwidth.sim.lane_type import greatest, least, select
from zwidth.sim.physics.effect import Bounds, Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import SMALLEST, Sizes, up_to
from zwidth.sim.place import LINKS, Place

APART = 3.0  # times as wide is the next start: its valley is no wider


def _starts(z: Sizes, place: Place) -> Iterator[Scaled]:
    """From a part of what the spring gives way to a good part of the travel, as a worn gear has."""
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
    said="play of {gap}",
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
            vanishing=1e-15,
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
def next_pin(z, q0, q1, h, p):
    """Pin after a substep."""
    damped = p[2] > 0.0
    left = select(damped, exp(-p[1] * h / select(damped, p[2], 1.0)), 0.0)
    return within_gap(q1 - (q0 - z) * left, p)

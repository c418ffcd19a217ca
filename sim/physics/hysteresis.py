"""A hysteretic spring after Bouc and Wen.

With z the force over its ultimate value (level),

    f = -level z,    dz/dq = (stiffness / level) (1 - |z|^shape (1 + sign(z dq)) / 2).

stiffness: slope at z = 0 and wherever the spring unloads; shape: how sharply it yields (1 gently;
a large number makes it elastic and then ideally plastic). The general law has two more numbers,
beta and gamma. Here they are equal: the spring unloads along a straight line, and dissipates energy
on every path (Ikhouane & Rodellar, Systems with Hysteresis, Wiley 2007).

Limits: a substep must be shorter than 2 sqrt(m / stiffness).
"""

from collections.abc import Iterator

import numpy as np

from zwidth.sim.elementary import power, tanh
from zwidth.sim.jit import part
from zwidth.sim.lane_type import any_lane, greatest, least, select, signed
from zwidth.sim.physics.effect import Bounds, Effect, Parameter, Scaled, Values
from zwidth.sim.physics.path import out_and_back
from zwidth.sim.physics.sizes import Sizes, spread, up_to
from zwidth.sim.place import Place


def _starts(z: Sizes, place: Place) -> Iterator[Scaled]:
    reach, held = z.reach(place), z.held(place)
    for share in (0.03, 0.15):
        for yields in (0.1, 0.5):
            stiffness = share * held / (yields * reach)
            yield (
                {"stiffness": stiffness, "level": share * held, "shape": 1.5},
                {"stiffness": 0.5 * stiffness, "level": 0.5 * share * held, "shape": 0.5},
            )


def _sweep(z: Sizes, place: Place) -> Iterator[Scaled]:
    reach = z.reach(place)
    for level in up_to(z.peak if place.kind == "ground" else z.held(place)):
        for yields in (0.1, 0.5):
            stiffness = level / (yields * reach)
            yield (
                {"stiffness": stiffness, "level": level, "shape": 1.5},
                {"stiffness": 0.5 * stiffness, "level": 0.5 * level, "shape": 0.5},
            )


def _bounds(_: Sizes, __: Place) -> Bounds:
    """A sharper one is elastic and ideally plastic all the same."""
    return {"shape": (1.0, 10.0)}


def _drawn(random: np.random.Generator, z: Sizes, place: Place) -> Values:
    level = 0.01 * z.force
    return {"stiffness": level / (z.reach(place) * spread(random, 0.03, 0.5)), "level": level,
            "shape": float(random.uniform(1.0, 3.0))}  # fmt: skip


hysteresis = Effect(
    name="hysteresis",
    summary="a spring that yields and dissipates, Bouc-Wen",
    formula="f = -level z,  dz/dq = (stiffness / level) (1 - |z|^shape (1 + sign(z dq)) / 2)",
    places=("ground", "link12"),
    parameters=(
        Parameter(
            "stiffness",
            "k_h",
            "N m/rad",
            0.0,
            1e12,
            None,
            role="magnitude",
            meaning="slope where it unloads",
        ),
        Parameter(
            "level",
            "f_h",
            "N m",
            0.0,
            1e6,
            0.0,
            role="magnitude",
            meaning="force that it never exceeds",
        ),
        Parameter(
            "shape",
            "n",
            "",
            1.0,
            100.0,
            None,
            open_ended=True,
            meaning="how sharply it yields: 1 gently, large abruptly",
        ),
    ),
    hook="force",
    code=5,
    mistaken_for=("presliding_friction", "coulomb_friction", "backlash"),
    reference="Y.-K. Wen, J. Eng. Mechanics Div. ASCE 102(2), 1976; R. Bouc, 1967",
    prior=0.02,  # rubber, tendons, piezo stacks
    contains=("coulomb_friction", "ground_spring", "presliding_friction"),
    creased=True,
    starts=_starts,
    sweep=_sweep,
    bounds=_bounds,
    drawn=_drawn,
    odds=1.0,
)


# z depends on the path alone. Let x be the way in units of level / stiffness. Unloading, z moves by
# x, exactly. Loading, in y = artanh z,
#
#     dy/dx = r(z) = (1 - z^shape) / (1 - z^2),    r between 1/2 and the larger of 1 and shape / 2.
#
# This rate is never stiff: the midpoint rule in y is second order, exact for shape = 2, and keeps
# z < 1 for any step. tanh(y + d) = (z + t) / (1 + z t) with t = tanh d avoids the artanh. The force
# is held over the substep at the mean of both ends: second order, stable for
# h < 2 sqrt(m / stiffness).


@part
def bouc_wen_force(z, p):
    """Force at z."""
    return -p[1] * z


@part
def yielding_rate(z, shape):
    """Return dy/dx at 0 <= z <= 1."""
    below = 1.0 - z * z
    inside = below > 0.0
    rate = (1.0 - power(z, shape)) / select(inside, below, 1.0)
    return select(inside, rate, 0.5 * shape)


@part
def farther(z, d):
    """Return tanh(artanh z + d)."""
    t = tanh(d)
    return (z + t) / (1.0 + z * t)


@part
def bouc_wen_along(z, way, p):
    """Return z after a way in one direction."""
    side = signed(1.0, way)
    x = abs(way) * p[0] / select(p[1] == 0.0, 1.0, p[1])
    unloading = greatest(0.0, least(x, -side * z))
    x -= unloading
    bent = side * z + unloading
    loaded = greatest(0.0, bent)  # what follows is of no account where all of the way unloads
    middle = farther(loaded, 0.5 * x * yielding_rate(loaded, p[2]))
    end = farther(loaded, x * yielding_rate(middle, p[2]))
    return side * select(x > 0.0, end, bent)


@part
def next_yield(z, q0, q1, v0, v1, h, p):
    """Return z after a substep."""
    out, back = out_and_back(q0, q1, v0, v1, h)
    after = select(out != 0.0, bouc_wen_along(z, out, p), z)
    if any_lane(back != 0.0):
        after = select(back != 0.0, bouc_wen_along(after, back, p), after)
    return select(p[1] == 0.0, z, after)

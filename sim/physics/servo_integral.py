"""Integral action of a servo, with its clip: z' = rate k (goal - q), held within +-limit.

z is a force beside that of the proportional part: f = clip(k (goal - q) - d v + z, -f_max, f_max),
f_max of the `servo_limit`. rate is the integral gain over the proportional one, k_i / k_p; where z
is at its limit it stays until the error turns (clamped, so that it does not wind up). While a
drive is off it is kept at zero.

Limits: the servo integrates its error at every substep, by the trapezium over it; the goal is the
command held, ahead of a `servo_dead_zone`, which takes nothing from it.
"""

import math
from collections.abc import Iterator

import numpy as np

from zwidth.sim.jit import part
from zwidth.sim.lane_type import greatest, least
from zwidth.sim.physics.effect import Bounds, Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import Sizes, up_to
from zwidth.sim.place import Place


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    for rate in (0.3, 1.0, 5.0):
        yield {"rate": rate, "limit": z.peak}, {"rate": 0.5 * rate, "limit": 0.5 * z.peak}


def _sweep(z: Sizes, _: Place) -> Iterator[Scaled]:
    for rate in up_to(0.1 / z.period):
        yield {"rate": rate, "limit": z.peak}, {"rate": 0.5 * rate, "limit": 0.5 * z.peak}


def _bounds(z: Sizes, _: Place) -> Bounds:
    """A loop that integrates faster than this would be no integral at this sampling."""
    return {"rate": (0.0, 1.0 / z.period), "limit": (0.0, 5.0 * z.peak)}


def _natural(_: Sizes, __: Place) -> float:
    return 1.0


def _drawn(_: np.random.Generator, z: Sizes, __: Place) -> Values:
    return {"rate": 0.1, "limit": z.peak}


servo_integral = Effect(
    name="servo_integral",
    summary="integral action of a servo, with its clip",
    formula="f = z,  z' = rate stiffness (goal - q) within -limit and limit",
    places=("m1",),
    parameters=(
        Parameter(
            "rate",
            "k_i/k_p",
            "1/s",
            0.0,
            1e6,
            0.0,
            role="magnitude",
            meaning="integral gain over the proportional one",
        ),
        Parameter(
            "limit",
            "z_max",
            "N m",
            0.0,
            math.inf,
            None,
            open_ended=True,
            meaning="largest force of the integral part",
        ),
    ),
    hook="force",
    code=18,
    mistaken_for=("constant_force",),
    reference="K. J. Astrom, T. Hagglund, PID Controllers, 1995: clamped integrator",
    borrows=("servo",),
    needs="position_servo",
    prior=0.05,  # most hobby servos have one that is set to zero
    creased=True,
    starts=_starts,
    sweep=_sweep,
    bounds=_bounds,
    natural=_natural,
    drawn=_drawn,
)


@part
def next_integral(z, q0, q1, h, u, s, p):
    """The integral's force after a substep under the held goal u, which counts as force."""
    grown = z + h * p[0] * (u - 0.5 * p[2] * (q0 + q1))
    kept = least(greatest(grown, -p[1]), p[1])
    return kept if s > 0.0 else 0.0 * kept

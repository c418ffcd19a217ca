"""The encoder counts in steps; the parameter is `Interface.encoder_step`."""

from collections.abc import Iterator

import numpy as np

from zwidth.sim.jit import part
from zwidth.sim.lane_type import any_lane, floor, select
from zwidth.sim.physics.effect import Bounds, Effect, Parameter, Scaled, Values
from zwidth.sim.physics.rounding import to_nearest
from zwidth.sim.physics.sizes import Sizes, up_to
from zwidth.sim.place import Place


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    for share in (1e-5, 1e-4, 1e-3):
        yield {"step": share * z.span}, {"step": 0.1 * share * z.span}


def _sweep(z: Sizes, _: Place) -> Iterator[Scaled]:
    for step in up_to(0.1 * z.span, 1e-6 * z.span):
        yield {"step": step}, {"step": 0.1 * step}


def _bounds(z: Sizes, _: Place) -> Bounds:
    return {"step": (0.0, z.span)}


def _natural(z: Sizes, _: Place) -> float:
    return z.span


def _drawn(_: np.random.Generator, z: Sizes, __: Place) -> Values:
    return {"step": 1e-5 * z.span}


encoder_step = Effect(
    name="encoder_step",
    summary="the encoder counts in steps",
    formula="reading = step round(q / step)",
    places=("sensor",),
    parameters=(
        Parameter(
            "step",
            "Delta",
            "rad",
            0.0,
            1e3,
            0.0,
            role="strength",
            meaning="of the position, between one reading and the next",
        ),
    ),
    hook="sensor",
    code=0,
    mistaken_for=("command_step",),
    reference="Abbott & Okamura, IEEE T. Robotics 21(5), 2005",
    in_interface="encoder_step",
    prior=0.1,  # every encoder counts; the device file mostly says in which steps
    creased=True,
    sought="lattice",
    starts=_starts,
    sweep=_sweep,
    bounds=_bounds,
    natural=_natural,
    drawn=_drawn,
)


@part
def read_encoder(position, step, downwards):
    """Return the position as counted: nearest step (ties away from zero), or the step below."""
    stepped = step != 0.0
    if not any_lane(stepped):
        return position
    size = select(stepped, step, 1.0)
    counted = size * floor(position / size) if downwards else to_nearest(position, size)
    return select(stepped, counted, position)

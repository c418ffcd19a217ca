"""The digital-to-analogue converter has steps; the parameter is `Interface.command_step`."""

from collections.abc import Iterator

import numpy as np

from zwidth.sim.jit import part
from zwidth.sim.lane_type import any_lane, select
from zwidth.sim.physics.effect import Bounds, Effect, Parameter, Scaled, Values
from zwidth.sim.physics.rounding import to_nearest
from zwidth.sim.physics.sizes import Sizes, up_to
from zwidth.sim.place import Place


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    for share in (0.003, 0.01, 0.03, 0.1):
        yield {"step": share * z.force}, {"step": 0.1 * share * z.force}


def _sweep(z: Sizes, _: Place) -> Iterator[Scaled]:
    for step in up_to(z.peak):
        yield {"step": step}, {"step": 0.1 * step}


def _bounds(z: Sizes, _: Place) -> Bounds:
    """Commands below half a step act as zero."""
    return {"step": (0.0, 2.0 * z.peak)}


def _drawn(_: np.random.Generator, z: Sizes, __: Place) -> Values:
    return {"step": 0.01 * z.force}


command_step = Effect(
    name="command_step",
    summary="the command is rounded to steps",
    formula="force = step round(u / step)",
    places=("command",),
    parameters=(
        Parameter(
            "step",
            "Delta_u",
            "N m",
            0.0,
            1e6,
            0.0,
            role="strength",
            meaning="between one value that the converter knows and the next",
        ),
    ),
    hook="command",
    code=0,
    mistaken_for=("encoder_step",),
    reference="uniform mid-tread quantiser",
    in_interface="command_step",
    prior=0.03,  # converters of few bits, and commands sent as small whole numbers
    creased=True,
    sought="lattice",
    starts=_starts,
    sweep=_sweep,
    bounds=_bounds,
    drawn=_drawn,
    odds=0.7,
)


@part
def quantise_command(command, step):
    """Return the command rounded to the nearest step, ties away from zero."""
    stepped = step != 0.0
    if not any_lane(stepped):
        return command
    return select(stepped, to_nearest(command, select(stepped, step, 1.0)), command)

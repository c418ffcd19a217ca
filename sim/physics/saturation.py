"""The amplifier has a largest force; the parameter is `Interface.command_limit`."""

import math
from collections.abc import Iterator

import numpy as np

from zwidth.sim.jit import part
from zwidth.sim.lane_type import greatest, least
from zwidth.sim.physics.effect import Bounds, Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import Sizes, up_to
from zwidth.sim.place import Place


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    for share in (0.97, 0.85, 0.7, 0.5, 0.3):
        yield {"limit": share * z.peak}, {"limit": 0.05 * z.peak}
    for share in (0.5, 0.2):  # of a command that bursts, far below its peak
        if share * z.force < 0.2 * z.peak:
            yield {"limit": share * z.force}, {"limit": 0.2 * share * z.force}


def sweep_of_limit(z: Sizes, _: Place) -> Iterator[Scaled]:
    """Yield limits that cut more and more of the largest command off."""
    for cut in up_to(0.95):
        limit = (1.0 - cut) * z.peak
        yield {"limit": limit}, {"limit": 0.5 * cut * limit}


def bounds_of_limit(z: Sizes, _: Place) -> Bounds:
    """Return the bounds: a limit above the largest command does nothing."""
    return {"limit": (0.0, z.peak)}


def natural_of_limit(z: Sizes, _: Place) -> float:
    """Return the largest command."""
    return z.peak


def drawn_of_limit(_: np.random.Generator, z: Sizes, __: Place) -> Values:
    """Return a limit that is reached at times."""
    return {"limit": 0.95 * z.peak}


def _at_share(_: np.random.Generator, z: Sizes, __: Place, share: float) -> Values:
    """The amount of the largest command that is cut off."""
    return {"limit": (1.0 - share) * z.peak}


saturation = Effect(
    name="saturation",
    summary="the amplifier's limit",
    formula="force = u within -limit and limit,  limit sign(u) beyond",
    places=("command",),
    parameters=(
        # A sine cut flat is another mechanism: a fit goes no further down at once.
        Parameter(
            "limit",
            "u_max",
            "N m",
            1e-12,
            math.inf,
            math.inf,
            role="strength",
            least=0.3,
            meaning="largest force, of either sign",
        ),
    ),
    hook="command",
    code=0,
    mistaken_for=("gain_asymmetry",),
    reference="ideal saturation",
    in_interface="command_limit",
    prior=0.1,  # every amplifier has a limit; few recordings go there
    creased=True,
    weakens=True,
    starts=_starts,
    sweep=sweep_of_limit,
    bounds=bounds_of_limit,
    natural=natural_of_limit,
    drawn=drawn_of_limit,
    odds=2.0,
    at_share=_at_share,
)


@part
def limit_command(command, limit):
    """Return the command held between -limit and limit; NaN stays NaN, so that the run stops."""
    return least(greatest(command, -limit), limit)

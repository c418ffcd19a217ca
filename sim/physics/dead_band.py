"""Small commands give no force: 0 within +-width / 2, beyond it u - (width / 2) sign(u)."""

from collections.abc import Iterator

import numpy as np

from zwidth.sim.jit import part
from zwidth.sim.lane_type import select, signed
from zwidth.sim.physics.effect import Bounds, Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import Sizes, up_to
from zwidth.sim.place import Place

SHARES = (0.001, 0.004, 0.015, 0.06, 0.2)  # of the rms command


def _starts(z: Sizes, _: Place) -> Iterator[Scaled]:
    for share in SHARES:
        yield {"width": share * z.force}, {"width": share * z.force}


def _sweep(z: Sizes, _: Place) -> Iterator[Scaled]:
    for width in up_to(1.8 * z.peak):
        yield {"width": width}, {"width": width}


def _bounds(z: Sizes, _: Place) -> Bounds:
    """With half the band as wide as the largest command, nothing would have moved."""
    return {"width": (0.0, 2.0 * z.peak)}


def _drawn(_: np.random.Generator, z: Sizes, __: Place) -> Values:
    return {"width": 0.01 * z.force}


dead_band = Effect(
    name="dead_band",
    summary="small commands give no force",
    formula="force = 0 for |u| <= width / 2,  u - (width / 2) sign(u) beyond",
    places=("command",),
    parameters=(
        Parameter(
            "width",
            "w",
            "N m",
            0.0,
            1e6,
            0.0,
            role="magnitude",
            meaning="all of the band: commands within half of it to either side give nothing",
        ),
    ),
    hook="command",
    code=1,
    mistaken_for=("coulomb_friction",),
    reference="Tao & Kokotovic, Adaptive Control of Systems with Actuator and Sensor"
    " Nonlinearities, Wiley 1996",
    prior=0.03,  # hydraulics and bad bridges; a current amplifier has none
    creased=True,
    weakens=True,
    starts=_starts,
    sweep=_sweep,
    bounds=_bounds,
    drawn=_drawn,
    odds=2.0,
)


@part
def beyond_band(command, p):
    """Return the command after the dead band."""
    half = 0.5 * p[0]
    return select(abs(command) <= half, 0.0, command - signed(half, command))

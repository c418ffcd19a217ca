"""The sensor knows no sign: it reports |q|. Nothing to tune; it changes nothing where q >= 0."""

from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Effect

rectified_sensor = Effect(
    name="rectified_sensor",
    summary="the reading is the absolute value of the position",
    places=("sensor",),
    parameters=(),
    hook="sensor",
    code=2,
    reference="-",
)


@part
def magnitude(position):
    """Return the reading of a position."""
    return abs(position)

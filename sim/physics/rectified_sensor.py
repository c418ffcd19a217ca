"""The sensor has no sign: it reports |q|. It has no parameters; it changes nothing for q >= 0."""

from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Effect

rectified_sensor = Effect(
    name="rectified_sensor",
    summary="the reading is the absolute value of the position",
    formula="reading = |q|",
    places=("sensor",),
    parameters=(),
    hook="sensor",
    code=2,
    reference="-",
    prior=0.003,  # a sensor wired or read without its sign: a mistake, and soon seen
    creased=True,
    sought="folding",
    in_recording=True,
)


@part
def magnitude(position):
    """Return the reading of a position."""
    return abs(position)

"""Small commands give no force: 0 within +-width / 2, beyond it u - (width / 2) sign(u)."""

from zwidth.sim.jit import part
from zwidth.sim.lane_type import select, signed
from zwidth.sim.physics.effect import Effect, Parameter

dead_band = Effect(
    name="dead_band",
    summary="small commands give no force",
    places=("command",),
    parameters=(Parameter("width", "w", "N m", 0.0, 1e6, 0.0),),
    hook="command",
    code=1,
    reference="Tao & Kokotovic, Adaptive Control of Systems with Actuator and Sensor"
    " Nonlinearities, Wiley 1996",
)


@part
def beyond_band(command, p):
    """Return what is left of a command."""
    half = 0.5 * p[0]
    return select(abs(command) <= half, 0.0, command - signed(half, command))

"""A loop at m1 that drives it to a goal: f = stiffness (goal - q) - damping v - back_emf v.

The command of such a device is the goal, converted to a force by its `command_gain` (stiffness per
unit of the goal). The numbers here are therefore the loop's own part, which moves with the mass and
is exact in the propagator. back_emf is also a damper, of a loop that commands a voltage: it is not
limited by `servo_limit`. `[drive]` makes this effect for a servo (`sim/drive.py`); beyond its limit
and within its dead zone act `servo_limit` and `servo_dead_zone`.

A motion that is prescribed at the far end of a spring is the same, with m1 at the spring's other
end.
"""

from zwidth.sim.chain import Matrices
from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Effect, Numbers, Parameter


def _closed(matrices: Matrices, mass: int, values: Numbers) -> Matrices:
    damping, stiffness = matrices.damping.copy(), matrices.stiffness.copy()
    damping[..., mass, mass] += values["damping"] + values["back_emf"]
    stiffness[..., mass, mass] += values["stiffness"]
    return matrices._replace(damping=damping, stiffness=stiffness)


position_servo = Effect(
    name="position_servo",
    summary="a loop that drives m1 to a goal, which is the command",
    formula="f = stiffness (goal - q) - damping v - back_emf v",
    places=("m1",),
    parameters=(
        Parameter(
            "stiffness",
            "k_p",
            "N m/rad",
            0.0,
            1e12,
            0.0,
            role="magnitude",
            meaning="force over the distance to the goal",
        ),
        Parameter(
            "damping",
            "k_d",
            "N m s/rad",
            0.0,
            1e12,
            0.0,
            role="magnitude",
            meaning="force for each unit of speed, of the loop",
        ),
        Parameter(
            "back_emf",
            "b_e",
            "N m s/rad",
            0.0,
            1e12,
            0.0,
            role="magnitude",
            meaning="the same of the motor, beyond the loop's limit",
        ),
    ),
    hook="structure",
    code=0,
    reference="proportional and derivative control",
    of_drive=True,
    alters=_closed,
    sought="given",
)


@part
def asked(u, q, v, p, first):
    """Force that the loop demands under the held command u; its numbers begin at p[first]."""
    return u - p[first] * q - p[first + 1] * v

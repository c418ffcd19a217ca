"""Friction and ripple as a passive `dcmotor` of MuJoCo: written, and read back.

MuJoCo's friction is a bristle of deflection z, its cogging a sine:

    f = -s z - d dz/dt,    dz/dt = v - s |v| z / g(v),    g(v) = Fc + (Fs - Fc) exp(-(v / vs)^2),
    f = a sin(n q + phase).

`presliding_friction` is this law for Fc = Fs and d = 0, and `force_ripple` the sine. The curve g is
that of `stribeck_friction`, in which a body at rest is rigid, so its bristles are as stiff as the
step allows. MuJoCo moves a bristle exactly over a step of constant velocity, which the integrator
`implicitfast` does and RK4 does not; as a spring on a mass it is explicit, stable for a frequency
below 2 / step.

Without inputs and with a motor constant of zero, a dcmotor does nothing else. MuJoCo before 4
refuses zero, so the constant is 1e-9, which damps by 1e-18.
"""

import math
from typing import Any

import numpy as np

from zwidth.export.model import label_of
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics

BRISTLES = ("stribeck_friction", "presliding_friction")
PASSIVE = (*BRISTLES, "force_ripple")
OF_A_RADIAN = 0.3  # largest phase per step of a mass on its bristles
TURN = 2.0 * math.pi


def passive_motor(p: Physics, mass: float, step: float) -> str:
    """Return an effect of PASSIVE at a mass as an element, "" if it makes no force."""
    joint = f"m{p.place.index + 1}"
    if p.effect.name == "force_ripple":
        turns = TURN / p.values["period"]
        law = f'cogging="{p.values["amplitude"]!r} {turns!r} {p.values["phase"]!r}"'
    else:
        level = p.values["level"]
        highest, velocity = _highest(p), p.values.get("velocity", 1.0)
        if highest == 0.0:
            return ""
        stiffness = bristles(p, mass, step)
        law = f'lugre="{stiffness!r} 0 {level!r} {highest!r} {velocity!r}"'
    return (
        f'    <dcmotor name="{p.effect.name}_{joint}" joint="{joint}" input="none"'
        f' motorconst="1e-9" resistance="1" {law}/>'
    )


def bristles(p: Physics, mass: float, step: float) -> float:
    """Return the stiffness of an effect's bristles: its own, if the time step resolves it."""
    return min(p.values.get("stiffness", math.inf), mass * (OF_A_RADIAN / step) ** 2)


def softened(p: Physics, mass: float, step: float, length: str) -> str:
    """Return by how much friction of BRISTLES is softer than the device's, "" if it is not.

    length: unit of a position.
    """
    highest, own = _highest(p), p.values.get("stiffness", math.inf)
    held = bristles(p, mass, step)
    if own == held or highest == 0.0:
        return ""
    return (
        f"{label_of(p)}: before it slips it gives by up to {highest / held:.2g} {length}"
        f" ({highest / own:.2g} in the device)"
    )


def _highest(p: Physics) -> float:
    return p.values.get("static_level", p.values["level"])


def effects_of_motor(
    model: Any, i: int, gear: float, origin: float, left_out: list[str]
) -> list[Physics]:
    """Return friction and cogging of the dcmotor i as effects at m1, seen from its joint.

    origin: the joint's position at which the device is at zero. What no effect can represent is
    appended to left_out, in words.
    """
    name = model.actuator(i).name
    amplitude, poles, phase, coulomb, static, velocity = model.actuator_biasprm[i, :6].tolist()
    stiffness, damping = model.actuator_dynprm[i, 5:7].tolist()
    found: list[Physics] = []
    if amplitude != 0.0 and poles != 0.0:
        found.append(_ripple(gear * amplitude, gear * poles, phase, origin))
    elif force := gear * amplitude * math.sin(phase):
        left_out.append(f"the constant force {force:.3g} that is the cogging of {name!r}")
    if stiffness > 0.0 and max(coulomb, static) > 0.0:
        size = abs(gear)
        level = size * coulomb
        if static > coulomb and velocity > 0.0:
            values = {
                "level": level, "static_level": size * static, "velocity": velocity / size,
            }  # fmt: skip
            found.append(make_physics("stribeck_friction", "m1", **values))
            left_out.append(
                f"the bristles of {name!r}, which give by up to"
                f" {static / (stiffness * size):.2g} before they slip"
            )
        elif level > 0.0:
            found.append(
                make_physics(
                    "presliding_friction", "m1", level=level, stiffness=size**2 * stiffness
                )
            )
            if static < coulomb:
                left_out.append(f"that the friction of {name!r} falls to {size * static:g} at rest")
        if damping != 0.0:
            left_out.append(f"the damping of the bristles of {name!r}, {size**2 * damping:g}")
    return found


def _ripple(amplitude: float, poles: float, phase: float, origin: float) -> Physics:
    """Return a sin(n q + phase) as the effect, whose amplitude and period are positive."""
    phase += poles * origin
    if poles < 0.0:  # sin(-x + phase) = sin(x - phase + pi)
        phase = math.pi - phase
    if amplitude < 0.0:
        phase += math.pi
    return make_physics("force_ripple", "m1", amplitude=abs(amplitude), period=TURN / abs(poles),
                        phase=math.remainder(phase, TURN))  # fmt: skip


def further(model: Any, i: int) -> bool:
    """Whether a dcmotor has more than a winding, friction and cogging."""
    bias, dynamics = model.actuator_biasprm[i].copy(), model.actuator_dynprm[i].copy()
    bias[:6] = 0.0
    dynamics[[0, 5, 6]] = 0.0
    rest = (model.actuator_gainprm[i, 2:], bias, dynamics)
    return any(np.any(numbers != 0.0) for numbers in rest)

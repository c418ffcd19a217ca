"""A device as an actuator of robot simulators: one joint, a loop on it, friction, a limit.

A loop on the position of m1 (`position_servo`) is separate from the joint that it moves; a chain is
one body, as in URDF. Dry friction has two levels, at rest and in motion.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from zwidth.export.mechanics import interface_lost, joints_of
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics


class Actuator(NamedTuple):
    """One joint with its drive, SI.

    stiffness, damping: of the loop on its position, 0 if the command is an effort; gain: from
    command to effort; limit: of the effort; delay_ticks: of the command; then the moving mass,
    viscous damping, and dry friction, sliding and at rest. lost: parts of the device that these
    numbers leave out; held: the device with exactly these numbers, whose friction at rest is at
    most that in sliding.
    """

    stiffness: float
    damping: float
    gain: float
    limit: float
    delay_ticks: int
    mass: float
    viscous: float
    sliding: float
    at_rest: float
    lost: tuple[str, ...]
    held: Device

    @property
    def looped(self) -> bool:
        """Whether the command is a goal for the position."""
        return self.stiffness > 0.0


def actuator_of(device: Device, rises: bool) -> Actuator:
    """Return a device as one actuator; rises: whether the format allows higher friction at rest."""
    loop = {p.effect.name: p for p in device.physics if p.effect.name in ("position_servo",
            "servo_limit")}  # fmt: skip
    servo, rub = loop.get("position_servo"), _rising(device)
    others = [p for p in device.physics if p not in loop.values()]
    joints = joints_of(replace(device, physics=tuple(others)))
    lost = joints.lost
    for (i, j), (spring, damper) in joints.between.items():
        lost.append(
            f"link m{i + 1}-m{j + 1}: its spring {spring:g} and damper {damper:g} are not held, the"
            " masses are one"
        )
    for i in np.flatnonzero(joints.springs).tolist():
        lost.append(f"the spring {joints.springs[i]:g} from m{i + 1} to ground is not held")
    if rises and rub is not None:
        lost[:] = [line for line in lost if not line.startswith("stribeck_friction")]
        lost.append(
            "stribeck_friction@m1: both levels are held, but not the speed over which it falls,"
            f" {rub.values['velocity']:g}"
        )
    face = interface_lost(joints.device, True, True, lost).interface
    ticks = round(face.delay / face.period)
    if abs(ticks * face.period - face.delay) > 1e-6 * face.period:
        lost.append(
            f"the delay of {face.delay:g} s is held as {ticks} samples of {face.period:g} s"
        )
    mass, viscous = float(joints.masses.sum()), float(joints.dampers.sum())
    sliding = float(joints.friction.sum())
    stiffness = damping = 0.0
    limit, parts = face.command_limit, list[Physics]()
    if servo is not None:
        stiffness, damping = servo.values["stiffness"], servo.values["damping"]
        viscous += servo.values["back_emf"]
        parts.append(make_physics("position_servo", "m1", **{**servo.values, "back_emf": 0.0}))
        if (limited := loop.get("servo_limit")) is not None:
            limit = min(limit, limited.values["limit"])
            parts.append(make_physics("servo_limit", "m1", limit=limit))
        lost.append("the loop on the position acts once a step there, and all the time here")
    if sliding > 0.0:
        parts.append(make_physics("coulomb_friction", "m1", level=sliding))
    held = replace(
        device, chain=make_chain([mass], [viscous]), modal=None, physics=(),
        interface=replace(face, delay=ticks * face.period),
    ).with_physics(*parts)  # fmt: skip
    at_rest = sliding
    if rises and rub is not None:
        at_rest += rub.values["static_level"] - rub.values["level"]
    return Actuator(
        stiffness, damping, face.command_gain, limit, ticks, mass, viscous, sliding, at_rest,
        tuple(lost), held,
    )  # fmt: skip


def _rising(device: Device) -> Physics | None:
    """Return the friction of m1 that is higher at rest."""
    found = (p for p in device.physics if p.effect.name == "stribeck_friction" and p.at == "m1")
    return next(found, None)


def command_in_words(actuator: Actuator, effort: str) -> str:
    """Describe the command in words; effort: the name of the actuator's effort input."""
    if actuator.looped:
        share = actuator.gain / actuator.stiffness
        return "The command is the goal of the position" + (
            "." if abs(share - 1.0) < 1e-9 else f", times {share:.9g}."
        )
    return f"The command, times {actuator.gain:.9g}, is {effort}; the loop on the position is off."

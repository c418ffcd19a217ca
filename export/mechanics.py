"""The mechanism that joint formats can describe: masses, dampers, springs, dry friction.

Each effect is divided here into the part that such a format can describe and the rest.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from zwidth.export.model import label_of
from zwidth.sim.device import Device
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics

Floats = NDArray[np.float64]


@dataclass
class Joints:
    """The part of a device that joints can describe, in SI; masses of extra modes come last.

    dampers, springs: to ground (n,), and between masses (i, j); friction (n,); device: the
    described part, as a device; lost: the rest, in sentences.
    """

    device: Device
    masses: Floats
    dampers: Floats
    springs: Floats
    between: dict[tuple[int, int], tuple[float, float]]
    friction: Floats
    lost: list[str] = field(default_factory=list[str])
    others: list[Physics] = field(default_factory=list[Physics])


def _level(p: Physics) -> list[Physics]:
    return [make_physics("coulomb_friction", p.at, level=p.values["level"])]


def _mean(p: Physics) -> list[Physics]:
    """Return friction of the mean level and a constant force for the difference, which is exact."""
    plus, minus = p.values["level_plus"], p.values["level_minus"]
    level = 0.5 * (plus + minus)
    viscous = 0.5 * (p.values["viscous_plus"] + p.values["viscous_minus"])
    both = make_physics(
        "directional_friction", p.at, level_plus=level, level_minus=level, viscous_plus=viscous,
        viscous_minus=viscous,
    )  # fmt: skip
    bias = make_physics("constant_force", p.at, level=0.5 * (minus - plus))
    return [both] if plus == minus else [both, bias]


SIMPLER: Mapping[str, tuple[Callable[[Physics], list[Physics]], str]] = {
    "stribeck_friction": (
        _level, "only its level in motion, {level:g}, is held, not the rise to {static_level:g} at"
        " rest",
    ),
    "rising_friction": (
        _level, "only its level in motion, {level:g}, is held, not the fall to {static_level:g} at"
        " rest",
    ),
    "presliding_friction": (
        _level, "its level {level:g} is held as dry friction, not its springiness before it slides",
    ),
    "directional_friction": (
        _mean, "its two sides are held as their mean, but for what a constant force does",
    ),
}  # fmt: skip
STRUCTURE = ("ground_spring", "extra_mode", "position_servo")


def joints_of(
    device: Device, also: tuple[str, ...] = (), at_masses: tuple[str, ...] = ()
) -> Joints:
    """Divide a device's mechanism and effects; also: further effects that the format supports.

    at_masses: effects that it supports at masses only. Both kinds are returned in `others`; the
    caller exports the interface.
    """
    lost: list[str] = []
    kept: list[Physics] = []
    constant: list[Physics] = []
    for p in device.physics:
        name = p.effect.name
        if name in at_masses and p.place.kind == "mass":
            kept.append(p)
        elif name in SIMPLER:
            make, sentence = SIMPLER[name]
            simpler = make(p)
            whole = name == "directional_friction" and (
                "constant_force" in also or p.values["level_plus"] == p.values["level_minus"]
            )  # its levels; nothing else is lost if both viscous coefficients are equal
            if not (whole and p.values["viscous_plus"] == p.values["viscous_minus"]):
                lost.append(f"{label_of(p)}: {sentence.format(**p.values)}")
            constant += [s for s in simpler[1:] if "constant_force" in also]
            kept.append(simpler[0])
        elif name == "constant_force" and name in also:
            constant.append(p)
        elif name in ("coulomb_friction", *STRUCTURE, *also):
            kept.append(p)
        else:
            lost.append(f"{label_of(p)} is not exported: the format cannot describe it")
    for at in dict.fromkeys(p.at for p in constant):
        level = sum(p.values["level"] for p in constant if p.at == at)
        kept.append(make_physics("constant_force", at, level=level))
    held = Device(device.name, device.source, device.rotary, device.chain, device.interface)
    held = held.with_physics(*kept)
    mass, damping, stiffness = held.plant().matrices
    n = mass.shape[0]
    friction, viscous = np.zeros(n), np.zeros(n)
    for p in kept:
        if p.effect.name == "coulomb_friction":
            friction[p.place.index] += p.values["level"]
        elif p.effect.name == "directional_friction":
            friction[p.place.index] += p.values["level_plus"]
            viscous[p.place.index] += p.values["viscous_plus"]
    between = {
        (i, j): (float(-stiffness[i, j]), float(-damping[i, j]))
        for i in range(n)
        for j in range(i + 1, n)
        if stiffness[i, j] != 0.0 or damping[i, j] != 0.0
    }
    springs = stiffness.sum(axis=1)
    springs[np.abs(springs) < 1e-12 * np.abs(np.diag(stiffness))] = 0.0
    return Joints(
        held, np.diag(mass).copy(), damping.sum(axis=1) + viscous, springs, between, friction, lost,
        [p for p in kept if p.effect.name in (*also, *at_masses)],
    )  # fmt: skip


def interface_lost(device: Device, delay: bool, limit: bool, lost: list[str]) -> Device:
    """Add the parts of the interface that cannot be exported; return the device with the others.

    delay, limit: whether the format has them.
    """
    face = device.interface
    changes: dict[str, object] = {}
    if face.delay > 0.0 and not delay:
        lost.append(f"the delay of {1e3 * face.delay:g} ms is not exported")
        changes["delay"] = 0.0
    if np.isfinite(face.command_limit) and not limit:
        lost.append(f"the command limit of {face.command_limit:g} is not exported")
        changes["command_limit"] = np.inf
    for name, said, none in (
        ("encoder_step", "the encoder's step", 0.0),
        ("command_step", "the amplifier's step", 0.0),
        ("position_origin", "the origin of the positions", 0.0),
        ("force_gain", "the feedback of the measured force", 0.0),
    ):
        value = getattr(face, name)
        if value != none:
            lost.append(f"{said}, {value:g}, is not exported")
            changes[name] = none
    if face.command_hold == "smooth":
        lost.append(
            "a command that is smooth between samples is not exported: it is constant over each"
        )
        changes["command_hold"] = "zero_order"
    return device.with_interface(**changes)

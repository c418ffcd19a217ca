"""The numbers of a device by name: m1, b1, k12, b12, k0, interface.delay, EFFECT@PLACE.PARAMETER.

Names of the chain are those of a diagnosis; names of the interface are its fields.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from zwidth.sim.device import Device, DeviceError, place_label
from zwidth.sim.nearest import nearest

FORCE, LENGTH = ("N m", "N"), ("rad", "m")
DAMPER, SPRING = ("N m s/rad", "N s/m"), ("N m/rad", "N/m")
CHAIN = {
    r"m(\d)": ("masses", ("kg m2", "kg"), True),
    r"b(\d)": ("ground_dampers", DAMPER, False),
    r"k(\d)\d": ("link_springs", SPRING, True),
    r"b(\d)\d": ("link_dampers", DAMPER, False),
}  # fmt: skip
INTERFACE = {
    "command_gain": (("", ""), True), "command_limit": (FORCE, True), "delay": (("s", "s"), False),
    "encoder_step": (LENGTH, False), "command_step": (FORCE, False),
}  # fmt: skip


class Named(NamedTuple):
    """A number with its SI unit and bounds; factor: its uncertainty is that of its logarithm."""

    value: float
    unit: str
    lower: float
    upper: float
    factor: bool = False


def numbers_of_device(device: Device) -> dict[str, Named]:
    """Return all numbers that a device has, by name."""
    side, chain = 0 if device.rotary else 1, device.chain
    found: dict[str, Named] = {}
    for pattern, (field, unit, factor) in CHAIN.items():
        for i, value in enumerate(getattr(chain, field).tolist()):
            # a negative damper comes from a modal fit, and has no bound
            lower = 0.0 if value >= 0.0 else -math.inf
            name = pattern.replace(r"(\d)", str(i + 1)).replace(r"\d", str(i + 2))
            found[name] = Named(value, unit[side], lower, math.inf, factor)
    if chain.ground_spring != 0.0:
        lower = 0.0 if chain.ground_spring > 0.0 else -math.inf
        found["k0"] = Named(chain.ground_spring, SPRING[side], lower, math.inf, lower == 0.0)
    for field, (unit, factor) in INTERFACE.items():
        value = float(getattr(device.interface, field))
        if math.isfinite(value):
            found[f"interface.{field}"] = Named(value, unit[side], 0.0, math.inf, factor)
    for physics in device.physics:
        for p in physics.effect.parameters:
            if p.name in physics.values:
                found[f"{place_label(physics)}.{p.name}"] = Named(
                    float(physics.values[p.name]), p.unit_for(device.rotary), p.lower, p.upper
                )
    return found


def with_numbers(device: Device, values: Mapping[str, float]) -> Device:
    """Return the device with other numbers, by name.

    Raises DeviceError for a name that it does not have, ValueError for impossible values.
    """
    known = numbers_of_device(device)
    arrays = {key: np.array(value) for key, value in device.chain._asdict().items()}
    interface: dict[str, float] = {}
    effects: dict[str, dict[str, float]] = {}
    for name, value in values.items():
        if name not in known:
            raise DeviceError(f"the device has no parameter {name!r}; {nearest(name, list(known))}")
        if name == "k0":
            arrays["ground_spring"] = np.array(value)
        elif name.startswith("interface."):
            interface[name.removeprefix("interface.")] = value
        elif "@" in name:
            label, _, key = name.rpartition(".")
            effects.setdefault(label, {})[key] = value
        else:
            for pattern, (field, _, _) in CHAIN.items():
                if at := re.fullmatch(pattern, name):
                    arrays[field][int(at[1]) - 1] = value
    chain = device.chain._replace(**arrays | {"ground_spring": float(arrays["ground_spring"])})
    physics = tuple(
        replace(p, values={**p.values, **effects.get(place_label(p), {})}) for p in device.physics
    )
    changed = replace(device, chain=chain, modal=None, physics=physics)
    return changed.with_interface(**interface)

"""Numbers that an exported tick reads from its state, so that a run may set them.

The parameters of laws and the numbers of the interface are not part of any propagator, so a tick
with `s->p[k]` in their place gives the same bits as one with constants. Masses, springs and dampers
are part of the propagators and remain constants.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from zwidth.export.model import label_of
from zwidth.export.translate import Value
from zwidth.sim.device import Device
from zwidth.sim.equations import EffectTable, Equations
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.points import of_points

TABLES = {
    "force": "forces", "friction": "frictions", "sensor": "sensors", "command": "amplifiers",
    "clock": "clocks",
}  # fmt: skip


@dataclass(frozen=True)
class Number:
    """A number of a device: name, SI value, unit, bounds and description."""

    name: str
    value: float
    unit: str
    lower: float = -math.inf
    upper: float = math.inf
    meaning: str = ""


class Rows(list[Any]):
    """Parameters of the effects of one hook, numbers or C expressions, indexed like the array."""


def settable(
    device: Device, eq: Equations, labels: Sequence[str]
) -> tuple[Equations, list[Number]]:
    """Return equations with `s->p[k]` for each settable number, and these numbers by k.

    labels: of the effects whose parameters may be set ("backlash@link12"). Tables of points may not
    be set, since they must rise.
    """
    found: list[Number] = []

    def put(number: Number) -> Value:
        found.append(number)
        return Value(f"s->p[{len(found) - 1}]")

    changes: dict[str, Any] = {}
    for hook, name in TABLES.items():
        mine = [p for p in device.physics if p.effect.hook == hook]
        table: EffectTable = getattr(eq, name)
        rows = Rows(row.tolist() for row in table.parameters)
        for row, p in zip(rows, mine, strict=True):
            if label_of(p) in labels:
                for k, one in enumerate(numbers_of(p, device.rotary)):
                    row[k] = put(one)
        changes[name] = table._replace(parameters=rows)  # pyright: ignore[reportArgumentType]
    for one in _of_interface(device):
        changes[one.name.removeprefix("interface.")] = put(one)
    return eq._replace(**changes), found


def may_be_set(device: Device) -> list[str]:
    """Return the labels of the effects that read their parameters from no propagator or table."""
    return [label_of(p) for p in device.physics if _free(p, device.physics)]


def _free(p: Physics, all_of: Sequence[Physics]) -> bool:
    """Whether no other effect has a copy of an effect's parameters, as of a servo's limit."""
    if p.effect.hook not in TABLES or of_points(p.effect.parameters):
        return False
    copied = any("servo" in other.effect.borrows for other in all_of if other is not p)
    return not (p.effect.name == "servo_limit" and copied)


def numbers_of(p: Physics, rotary: bool) -> list[Number]:
    """Return the parameters of an effect, in the order of their declaration."""
    return [
        Number(
            f"{p.effect.name}_{p.at}.{q.name}", float(p.values[q.name]), q.unit_for(rotary),
            q.lower, q.upper, q.meaning,
        )
        for q in p.effect.parameters
    ]  # fmt: skip


def _of_interface(device: Device) -> list[Number]:
    """Return the interface's numbers that a tick reads: gain, limit and steps."""
    face, (force, length) = device.interface, units(device)
    found = [Number("interface.command_gain", face.command_gain, "", 1e-12, 1e12,
                    "force that a command of one makes")]  # fmt: skip
    if math.isfinite(face.command_limit):
        found.append(Number("interface.command_limit", face.command_limit, force, 1e-12, 1e12,
                            "largest force, of either sign"))  # fmt: skip
    if face.encoder_step > 0.0:
        found.append(Number("interface.encoder_step", face.encoder_step, length, 0.0, 1e3,
                            "of the position, between one reading and the next"))  # fmt: skip
    if face.command_step > 0.0:
        found.append(Number("interface.command_step", face.command_step, force, 0.0, 1e6,
                            "between one value that the converter knows and the next"))  # fmt: skip
    return found


def units(device: Device) -> tuple[str, str]:
    """Return the units of force and position."""
    return ("N m", "rad") if device.rotary else ("N", "m")

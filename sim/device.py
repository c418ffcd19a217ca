"""A device: mechanism, interface and physics, as one value."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from zwidth.sim.chain import Chain, make_chain, matrices, negative_dampers, rigid_body
from zwidth.sim.interface import INTERFACE_FIELDS, Interface
from zwidth.sim.modal import ModalModel, agree, to_chain
from zwidth.sim.nearest import nearest
from zwidth.sim.physics.effect import Physics
from zwidth.sim.plant import Plant, assemble, with_extra_mass, with_ground_spring


class DeviceError(ValueError):
    """A device, or a device file, that cannot be; the message is one sentence."""


@dataclass(frozen=True, eq=False)
class Device:
    """One degree of freedom of a haptic device.

    rotary: N m and rad; else N and m. modal is kept where the device was given in modal form
    (then chain is the same model as a chain). physics: effects whose home is not the interface
    or the chain.

    Raises DeviceError or ValueError with a sentence that names the field and what is allowed:
    for a place that the chain does not have, an effect twice at one place, an effect whose home is
    elsewhere (`with_physics` brings it there), or a modal that is not the chain.
    """

    name: str
    source: str
    rotary: bool
    chain: Chain
    interface: Interface = field(default_factory=Interface)
    physics: tuple[Physics, ...] = ()
    modal: ModalModel | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "chain", make_chain(*self.chain))
        object.__setattr__(self, "physics", tuple(self.physics))
        if not self.name.strip():
            raise DeviceError("name is empty; give the device a name")
        if self.modal is not None and not agree(self.chain, self.modal):
            raise DeviceError(
                "modal and chain describe different mechanisms; change one by with_modal or"
                " with_chain, which keep them the same"
            )
        seen: set[str] = set()
        for physics in self.physics:
            label = place_label(physics)
            if home(physics) is not None:
                raise DeviceError(
                    f"{label} belongs to {home(physics)}, not to physics; add it by with_physics"
                )
            if label in seen:
                raise DeviceError(f"{label} stands twice in physics; give it once")
            seen.add(label)
            if physics.effect.rotary_only and not self.rotary:
                raise DeviceError(f"{label} needs an angle; a device with rotary = false has none")
            if masses_needed(physics.at) > self.chain.masses.size:
                raise DeviceError(
                    f"{label} has no place in a chain of {self.chain.masses.size} mass(es);"
                    " choose a place that the chain has"
                )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Device):
            return NotImplemented
        return self._values() == other._values() and all(
            np.array_equal(a, b) for a, b in zip(self.chain, other.chain, strict=True)
        )

    def __hash__(self) -> int:
        return hash((self.name, self.source, self.rotary, self.interface, self.modal))

    def _values(self) -> tuple[object, ...]:
        return self.name, self.source, self.rotary, self.interface, self.physics, self.modal

    def plant(self) -> Plant:
        """Return the linear equations, delay and steps left out.

        The amplifier's lag is in them, and springs to ground and extra masses, which come after
        those of the chain in the order of physics.
        """
        structure = matrices(self.chain)
        for physics in self.physics:
            place = masses_needed(physics.at) - 1
            if physics.effect.name == "ground_spring":
                structure = with_ground_spring(structure, place, *physics.vector())
            elif physics.effect.name == "extra_mode" and physics.values["mass"] > 0.0:
                structure = with_extra_mass(structure, place, *physics.vector())
        return assemble(structure, self._value("actuator_lag", "time_constant"))

    def with_interface(self, **changes: Any) -> "Device":
        """Return the device with other interface fields: `with_interface(delay=0.004)`."""
        for name in changes:
            if name not in INTERFACE_FIELDS:
                raise DeviceError(
                    f"interface has no field {name!r}; {nearest(name, INTERFACE_FIELDS)}"
                )
        changed = replace(self.interface, **changes)
        return self if changed == self.interface else replace(self, interface=changed)

    def with_physics(self, *added: Physics) -> "Device":
        """Return the device with these effects, each brought to its home.

        Steps and limits replace those of the interface, delays add to its delay, a ground spring
        at m1 adds to that of the chain (which then has no modal form); any other effect replaces
        the same effect at the same place.
        """
        device = self
        for physics in added:
            entry, where = physics.effect.in_interface, home(physics)
            if entry is not None:
                (value,) = physics.values.values()
                earlier = device.interface.delay if entry == "delay" else 0.0
                device = device.with_interface(**{entry: earlier + value})
            elif where is not None:
                spring = device.chain.ground_spring + physics.values["stiffness"]
                device = device.with_chain(device.chain._replace(ground_spring=spring))
            else:
                label = place_label(physics)
                kept = tuple(p for p in device.physics if place_label(p) != label)
                device = replace(device, physics=(*kept, physics))
        return device

    def without_physics(self, *names: str) -> "Device":
        """Return the device without the effects named ("backlash" or "backlash@link12"), or any.

        Raises DeviceError for a name that the device does not have.
        """
        labels = [name for p in self.physics for name in (p.effect.name, place_label(p))]
        for name in names:
            if name not in labels:
                hint = nearest(name, labels) if labels else "it has none"
                raise DeviceError(f"the device has no effect {name!r}; {hint}")
        kept = (p for p in self.physics if not {p.effect.name, place_label(p)} & set(names))
        return replace(self, physics=tuple(kept) if names else ())

    def with_chain(self, chain: Chain) -> "Device":
        """Return the device with another mechanism, given as a chain."""
        return replace(self, chain=chain, modal=None)

    def with_modal(self, modal: ModalModel) -> "Device":
        """Return the device with another mechanism, given in modal form."""
        return replace(self, chain=to_chain(modal), modal=modal)

    def rigid(self) -> "Device":
        """Return the device with all masses collapsed into one (Fig. 7), interface kept.

        What acts inside a link has no part in a rigid body; what acts on m2 or m3 acts on m1.
        """
        kept = (p for p in self.physics if not p.at.startswith("link"))
        moved = [replace(p, at="m1") if masses_needed(p.at) > 1 else p for p in kept]
        stay = tuple(p for p in moved if home(p) is None)
        body = replace(self, chain=rigid_body(self.chain), modal=None, physics=stay)
        return body.with_physics(*(p for p in moved if home(p) is not None))

    def _value(self, effect: str, parameter: str) -> float:
        values = (p.values[parameter] for p in self.physics if p.effect.name == effect)
        return next(values, 0.0)


def place_label(physics: Physics) -> str:
    """Return "effect@place"."""
    return f"{physics.effect.name}@{physics.at}"


def home(physics: Physics) -> str | None:
    """Return where the quantity of this effect stands in a device file, None for [[physics]]."""
    if physics.effect.in_interface is not None:
        return "[interface]"
    if physics.effect.name == "ground_spring" and physics.at == "m1":
        return "[chain]"
    return None


def masses_needed(at: str) -> int:
    """Return how many masses a chain must have for this place: m3 or link23 need 3."""
    return int(at[-1]) if at[-1].isdigit() else 1


def warnings_of(device: Device) -> list[str]:
    """Return what a user should know about the device, a line each."""
    negative = negative_dampers(device.chain)
    if not negative:
        return []
    unit = "N m s/rad" if device.rotary else "N s/m"
    dampers = ", ".join(f"{name} = {value:.3g} {unit}" for name, value in negative.items())
    return [
        f"{dampers}: no passive chain equals this fit; 'zwidth devices DEVICE --passive' shows the"
        " nearest that is"
    ]

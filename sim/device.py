"""A device: mechanism, interface, physics and how well they are known, as one value."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from zwidth.shown import Shown
from zwidth.sim.band import Band
from zwidth.sim.chain import (
    Chain,
    Chains,
    Floats,
    Matrices,
    make_chain,
    matrices,
    negative_dampers,
    rigid_body,
)
from zwidth.sim.interface import INTERFACE_FIELDS, Interface
from zwidth.sim.modal import ModalModel, agree, to_chain
from zwidth.sim.nearest import nearest
from zwidth.sim.physics.effect import Effect, Numbers, Physics
from zwidth.sim.place import Place
from zwidth.sim.plant import Plant, assemble, follow
from zwidth.sim.posterior import Posterior
from zwidth.sim.reading import Reading, reading
from zwidth.sim.uncertainty import Uncertainty

MASSES_IN_ALL = 10  # of the chain, effects and filtered readings: the kernel's limit
MASSLESS = 1e-15  # of m1: mass of a filtered reading, which takes the place of a mass


class DeviceError(ValueError):
    """A device, or a device file, that is not possible; the message is one sentence."""


@dataclass(frozen=True, eq=False, repr=False)
class Device(Shown):
    """One degree of freedom of a haptic device.

    rotary: N m and rad; else N and m. modal is kept if the device was given in modal form (chain is
    then the same model). physics: effects that have no field in the interface or the chain.
    uncertainty: how well these values are known; fits use it, simulations ignore it. band: errors
    of its free runs when it was diagnosed; posterior: joint uncertainty of its parameters from the
    diagnosis. Both are None for a device that was not diagnosed.

    Raises DeviceError or ValueError with a sentence that names the field and what is allowed: for a
    place that the chain does not have, an effect twice at one place, an effect that has a field in
    the interface or chain (`with_physics` sets it there), or a modal form that differs from the
    chain.
    """

    name: str
    source: str
    rotary: bool
    chain: Chain
    interface: Interface = field(default_factory=Interface)
    physics: tuple[Physics, ...] = ()
    modal: ModalModel | None = None
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    band: Band | None = None
    posterior: Posterior | None = None

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
                    f"{label} is set in {home(physics)}, not in physics; add it by with_physics"
                )
            if label in seen:
                raise DeviceError(f"{label} occurs twice in physics; give it once")
            seen.add(label)
            if physics.effect.rotary_only and not self.rotary:
                raise DeviceError(f"{label} needs an angle; a device with rotary = false has none")
            if physics.place.masses_needed > self.chain.masses.size:
                raise DeviceError(
                    f"{label} has no place in a chain of {self.chain.masses.size} mass(es);"
                    " choose a place that the chain has"
                )
        if self.chain.masses.size + len(self.hosts()) > MASSES_IN_ALL:
            raise DeviceError(
                f"the device has {self.chain.masses.size} masses in its chain and"
                f" {len(self.hosts())} added masses or filtered readings; together they must be at"
                f" most {MASSES_IN_ALL}, so leave out an extra_mode or a filter"
            )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Device):
            return NotImplemented
        return self._values() == other._values() and all(
            np.array_equal(a, b) for a, b in zip(self.chain, other.chain, strict=True)
        )

    def __hash__(self) -> int:
        known = self.interface, self.modal, self.uncertainty
        return hash((self.name, self.source, self.rotary, *known))

    def _values(self) -> tuple[object, ...]:
        said = self.name, self.source, self.rotary
        known = self.uncertainty, self.band, self.posterior
        return *said, self.interface, self.physics, self.modal, *known

    def plant(self) -> Plant:
        """Return the linear equations, without delay and quantisation.

        They include the amplifier's lag, springs to ground and extra masses, which follow those of
        the chain in the order of physics.
        """
        return plant_of(self.chain, [(p, p.values) for p in self.physics])

    def hosts(self) -> tuple[int, ...]:
        """Return to which index each further mass and each filter of a reading is attached.

        Indices count from 0: the masses of the chain (0 is m1), then the masses that effects add,
        then the filters. The result has the added masses first (`hung`), then the filters.
        """
        hung = self.hung()
        filters = filters_of([(p, p.values) for p in self.physics])
        if not filters:
            return hung
        n = self.chain.masses.size
        return (*hung, *reading(n, n + len(hung), filters).followers[:, 1].tolist())

    def hung(self) -> tuple[int, ...]:
        """Return, for each mass that an effect adds, the index of the mass that carries it.

        0 is m1. Filters of readings, which `hosts` includes, are left out.
        """
        adding = [p for p in self.physics if p.effect.adds_mass]
        if not adding:
            return ()
        found: list[int] = []
        structure = matrices(self.chain)
        for physics in adding:
            before, host = structure.mass.shape[0], physics.place.index
            structure = physics.effect.alters(structure, host, physics.values)
            found += [host] * (structure.mass.shape[0] - before)
        return tuple(found)

    def reading(self) -> Reading:
        """Return the states that its sensors read."""
        n = self.chain.masses.size
        filters = filters_of([(p, p.values) for p in self.physics])
        return reading(n, n + len(self.hung()), filters)

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
        """Return the device with these effects added.

        Steps and limits replace those of the interface, delays add to its delay, a ground spring
        at m1 adds to that of the chain (which then has no modal form); any other effect replaces
        the same effect at the same place.
        """
        interface: dict[str, float] = {}
        chain, kept = self.chain, list(self.physics)
        for physics in added:
            entry, field = physics.effect.in_interface, physics.effect.in_chain
            if entry is not None:
                earlier = interface.get(entry, float(getattr(self.interface, entry)))
                (value,) = physics.values.values()
                interface[entry] = earlier + value if physics.effect.adds else value
            elif home(physics) is not None and field is not None:
                (value,) = physics.values.values()
                chain = chain._replace(**{field: getattr(chain, field) + value})
            else:
                label = place_label(physics)
                kept = [*(p for p in kept if place_label(p) != label), physics]
        device = self.with_interface(**interface) if interface else self
        if chain is not self.chain:
            device = device.with_chain(chain)
        return device if kept == list(self.physics) else replace(device, physics=tuple(kept))

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

    def bare(self) -> "Device":
        """Return the device without effects, except its linear drive and filters of readings.

        A linear drive here is one whose command is a goal.
        """
        kept = tuple(p for p in self.physics if p.effect.sought == "given" or p.effect.follows)
        return self if len(kept) == len(self.physics) else replace(self, physics=kept)

    def with_chain(self, chain: Chain) -> "Device":
        """Return the device with another mechanism, given as a chain."""
        return replace(self, chain=chain, modal=None)

    def with_modal(self, modal: ModalModel) -> "Device":
        """Return the device with another mechanism, given in modal form."""
        return replace(self, chain=to_chain(modal), modal=modal)

    def rigid(self) -> "Device":
        """Return the device with all masses collapsed into one (Fig. 7), interface kept.

        Effects inside links are dropped; effects on m2 or m3 act on m1 instead.
        """
        kept = (p for p in self.physics if p.place.kind != "link")
        moved = [replace(p, at="m1") if p.place.index > 0 else p for p in kept]
        stay = tuple(p for p in moved if home(p) is None)
        body = replace(self, chain=rigid_body(self.chain), modal=None, physics=stay)
        return body.with_physics(*(p for p in moved if home(p) is not None))


def plant_of(chain: Chain | Chains, effects: Iterable[tuple[Physics, Numbers]]) -> Plant:
    """Return the linear equations of a chain with effects, each with its values (`Device.plant`).

    Also for many chains with values (...) if all have the same further masses, and all or none lag.
    """
    structure: Matrices = matrices(chain)
    lag: float | Floats = 0.0
    known = list(effects)
    for physics, values in known:
        structure = physics.effect.alters(structure, physics.place.index, values)
        if physics.effect.lags:
            (lag,) = values.values()
    if not (filters := filters_of(known)):
        return assemble(structure, lag)
    found = reading(chain.masses.shape[-1], structure.mass.shape[-1], filters)
    plant = assemble(_with_massless(structure, found.followers.shape[0]), lag)
    laws = [p.effect.follows(v) for p, v in known if p.effect.follows and p.effect.acts(v)]
    first = 0
    for count, law in zip(found.filters, laws, strict=True):
        follow(plant, found.followers[first : first + count].tolist(), law)
        first += count
    return plant


def filters_of(effects: Iterable[tuple[Physics, Numbers]]) -> list[Place]:
    """Return the places where effects with values that are not neutral filter readings."""
    return [p.place for p, values in effects if p.effect.follows and p.effect.acts(values)]


def _with_massless(structure: Matrices, count: int) -> Matrices:
    """M, C, K with room for filtered readings."""
    room = [(0, 0)] * (structure.mass.ndim - 2) + [(0, count)] * 2
    grown = Matrices(*(np.pad(matrix, room) for matrix in structure))
    for place in range(structure.mass.shape[-1], structure.mass.shape[-1] + count):
        grown.mass[..., place, place] = MASSLESS * structure.mass[..., 0, 0]
    return grown


def place_label(physics: Physics) -> str:
    """Return "effect@place"."""
    return f"{physics.effect.name}@{physics.at}"


def home(physics: Physics) -> str | None:
    """Return the table of a device file with this effect's quantity; None for [[physics]]."""
    if physics.effect.in_interface is not None:
        return "[interface]"
    if physics.effect.in_chain is not None and physics.place == Place("mass", 0):
        return "[chain]"
    return None


def has_needed(effect: Effect, device: Device) -> bool:
    """Whether the device has the effect that another one needs."""
    return not effect.needs or any(p.effect.name == effect.needs for p in device.physics)


def known(effect: Effect, place: Place, device: Device, file: Device | None = None) -> bool:
    """Whether an effect need not be sought: the device has its quantity, or cannot use it.

    file: the device file, if the device has effects that it lacks; None if it is the device.
    """
    home = effect.in_interface
    if effect.sought in ("given", "learned") or not has_needed(effect, device):
        return True
    if home is not None and not effect.adds:
        (parameter,) = effect.parameters
        return getattr(device.interface, home) != parameter.neutral
    # With a spring to ground in the file, the recording's origin is fitted. This is the same as a
    # constant force if that spring is linear; a force on a nonlinear spring also changes its
    # stiffness.
    sprung, told = (file or device).chain.ground_spring > 0.0, effect.known_if_sprung
    if told == "straight" and any(p.effect.name == "cubic_stiffness" and p.at == "ground"
                                  for p in device.physics):  # fmt: skip
        return False
    return sprung and told != "no" and place == Place("mass", 0)


def has_room(effect: Effect, masses: int) -> bool:
    """Whether a device with this many masses, its effects' included, may have another effect.

    For filtered readings: if there is a reading for each filter.
    """
    return masses * (2 if effect.follows else 1) + effect.adds_mass <= MASSES_IN_ALL


def warnings_of(device: Device) -> list[str]:
    """Return the warnings about the device, one per line."""
    negative = negative_dampers(device.chain)
    if not negative:
        return []
    unit = "N m s/rad" if device.rotary else "N s/m"
    dampers = " and ".join(f"{name} ({value:.3g} {unit})" for name, value in negative.items())
    are = "is" if len(negative) == 1 else "are"
    return [
        f"{dampers} {are} negative: no passive chain fits exactly; 'zwidth devices DEVICE"
        " --passive' shows the nearest"
    ]

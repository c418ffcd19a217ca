"""Devices of one structure with different numbers, as arrays from which populations are made.

A search evaluates thousands of devices that differ only in numbers. Here these numbers are arrays
with a first axis of members, changed as those of a `Device` are (`with_physics`, `with_interface`),
and arranged for the lanes of the kernel without a `Device` for each. Everything computed from a
member's numbers equals the result for its `device` bit for bit.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.chain import Chain, Chains
from zwidth.sim.device import Device, home, place_label, plant_of
from zwidth.sim.equations import (
    Equations,
    command_rate,
    dry_masses,
    effect_table,
    enough_of,
    frame,
    reaction,
    segments,
    sure,
    too_few_substeps,
)
from zwidth.sim.group import NUMBERS, TABLES, Stack, Structure
from zwidth.sim.physics.effect import Physics
from zwidth.sim.plant import Plant, behind

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
VARIES = ("delay", "encoder_step", "command_step", "command_limit")  # fields of the interface
HOOK_OF = dict(zip(TABLES, ("force", "friction", "sensor", "command", "clock"), strict=True))


@dataclass(frozen=True, eq=False)
class Members:
    """Devices with the same masses, links, effects and places; rows of the arrays are members.

    like: their common values. chains: (members, n). interface: (members,) for each field of the
    interface, among `VARIES`, that differs from it. physics: effects and places, whose own values
    are ignored; values (members, parameters) of each, in the order of its declaration.
    """

    like: Device
    chains: Chains
    interface: Mapping[str, Floats] = field(default_factory=dict[str, Floats])
    physics: tuple[Physics, ...] = ()
    values: tuple[Floats, ...] = ()

    @property
    def size(self) -> int:
        """How many there are."""
        return self.chains.masses.shape[0]

    def device(self, i: int) -> Device:
        """Return a member; raises ValueError or DeviceError if it is not a possible device."""
        return self._device(lambda numbers: numbers[i])

    def _device(self, of: Callable[[Floats], Floats]) -> Device:
        changes = {name: float(of(numbers)) for name, numbers in self.interface.items()}
        physics = tuple(
            replace(
                p,
                values=dict(
                    zip([q.name for q in p.effect.parameters], of(own).tolist(), strict=True)
                ),
            )
            for p, own in zip(self.physics, self.values, strict=True)
        )
        masses, dampers, spring, links, link_dampers = (of(numbers) for numbers in self.chains)
        return Device(  # Device validates the chain
            self.like.name, self.like.source, self.like.rotary,
            Chain(masses, dampers, float(spring), links, link_dampers),
            replace(self.like.interface, **changes), physics, uncertainty=self.like.uncertainty,
        )  # fmt: skip

    @cached_property
    def first(self) -> Device:
        """The first member's device."""
        return self.device(0)

    def check(self) -> None:
        """Raise the error of `device` if any member is not a possible device.

        The allowed range of a number is an interval that does not depend on the others, so all
        members are within it if the smallest and the largest number are.
        """
        if self._plainly_sound():
            return
        for extreme in (np.min, np.max):
            self._device(lambda numbers, of=extreme: of(numbers, axis=0, keepdims=False))

    def _plainly_sound(self) -> bool:
        """Whether every chain is valid and every number within the bounds of its effect."""
        c = self.chains
        chained = (
            bool(np.all(c.masses > 0.0) and np.all(c.link_springs > 0.0))
            and bool(np.all(c.ground_dampers >= 0.0) and np.all(c.link_dampers >= 0.0))
            and bool(np.all(c.ground_spring >= 0.0))
        )
        if not chained or not all(np.all(np.isfinite(numbers)) for numbers in c):
            return False
        if not all(np.all(numbers >= 0.0) for numbers in self.interface.values()):
            return False
        if not np.all(self.of_interface("command_limit") > 0.0):
            return False
        for p, own in zip(self.physics, self.values, strict=True):
            bounds = [(q.lower, q.upper) for q in p.effect.parameters]
            low, high = np.array(bounds, dtype=np.float64).reshape(-1, 2).T
            if not (np.all(own >= low) and np.all(own <= high)):
                return False
        return True

    def taken(self, which: Ints | list[int]) -> "Members":
        """Return some of the members, in this order; the same object if these are all of them."""
        if np.array_equal(which, np.arange(self.size)):
            return self
        return replace(
            self,
            chains=Chains(*(numbers[which] for numbers in self.chains)),
            interface={name: numbers[which] for name, numbers in self.interface.items()},
            values=tuple(own[which] for own in self.values),
        )

    def with_interface(self, **changes: float | Floats) -> "Members":
        """Return the members with other fields of the interface, (members,) or one for all.

        Raises ValueError for a field in which members cannot differ.
        """
        for name in changes:
            if name not in VARIES:
                raise ValueError(
                    f"members cannot differ in interface.{name}; they can differ only in"
                    f" {', '.join(VARIES)}"
                )
        wide = {n: np.broadcast_to(np.float64(v), self.size) for n, v in changes.items()}
        return replace(self, interface={**self.interface, **wide})

    def of_interface(self, name: str) -> Floats:
        """Return a number of the interface, (members,)."""
        if name in self.interface:
            return self.interface[name]
        return np.full(self.size, float(getattr(self.like.interface, name)))

    def with_physics(self, physics: Physics, values: Floats) -> "Members":
        """Return the members with an effect; values (members, parameters).

        It is stored as by `Device.with_physics`.
        """
        entry, chain = physics.effect.in_interface, physics.effect.in_chain
        if entry is not None:
            earlier = self.of_interface(entry) if physics.effect.adds else 0.0
            return self.with_interface(**{entry: earlier + values[:, 0]})
        if home(physics) is not None and chain is not None:
            changed = getattr(self.chains, chain) + values[:, 0]
            return replace(self, chains=self.chains._replace(**{chain: changed}))
        label = place_label(physics)
        kept = [i for i, p in enumerate(self.physics) if place_label(p) != label]
        return replace(
            self,
            physics=(*(self.physics[i] for i in kept), physics),
            values=(*(self.values[i] for i in kept), values),
        )

    def without_physics(self, left_out: Callable[[Physics], bool]) -> "Members":
        """Return the members without the effects for which the condition is true."""
        kept = [i for i, p in enumerate(self.physics) if not left_out(p)]
        return replace(
            self,
            physics=tuple(self.physics[i] for i in kept),
            values=tuple(self.values[i] for i in kept),
        )

    def kinds(self) -> list[Ints]:
        """Return members with the same states together.

        An effect of zero strength adds no mass and no reading, an amplifier without lag no state.
        """
        present = np.zeros((self.size, len(self.physics)), dtype=bool)
        for j, (p, own) in enumerate(zip(self.physics, self.values, strict=True)):
            if p.effect.adds_mass or p.effect.follows:
                names = [q.name for q in p.effect.parameters]
                strength = p.effect.parameter(p.effect.strength or names[0])
                present[:, j] = own[:, names.index(strength.name)] != strength.neutral
            elif p.effect.lags:
                present[:, j] = own[:, 0] > 0.0
        return together(present)

    @cached_property
    def plant(self) -> Plant:
        """The linear equations of all members, which are of one of the `kinds`."""
        return plant_of(
            self.chains,
            [
                (p, {q.name: own[:, j] for j, q in enumerate(p.effect.parameters)})
                for p, own in zip(self.physics, self.values, strict=True)
            ],
        )

    def plant_at(self, i: int) -> Plant:
        """Return the linear equations of one member."""
        plant = self.plant
        return Plant(
            plant.a[i], plant.b[i], type(plant.matrices)(*(m[i] for m in plant.matrices)), plant.lag
        )

    def delay_ticks(self) -> tuple[Ints, Floats]:
        """Return whole ticks of delay and the remainder [s], as `Interface.delay_ticks`."""
        period, delay = self.like.interface.period, self.of_interface("delay")
        whole = np.floor(delay / period + 1e-9)
        left = delay - whole * period
        return whole.astype(np.int64), np.where(left > 1e-9 * period, left, 0.0)

    def enough_substeps(self) -> Ints:
        """Return the least substeps per tick of each member, as `equations.enough_substeps`.

        All members are of one of the `kinds`.
        """
        found = np.ones(self.size, dtype=np.int64)
        dry = dry_masses(self.physics)
        if not dry:
            return found
        # Slightly more than `enough_of` requires, which makes the final decision.
        close = ~sure(self.plant, 1.02 * self.like.interface.period)
        for i in np.flatnonzero(close).tolist():
            interface = replace(self.like.interface, delay=float(self.of_interface("delay")[i]))
            found[i] = enough_of(self.plant_at(i), dry, interface)
        return found


def alike(device: Device, count: int) -> Members:
    """Return this many members that are the same device."""

    def rows(numbers: Floats | float) -> Floats:
        own = np.asarray(numbers, dtype=np.float64)
        return np.broadcast_to(own, (count, *own.shape))

    return Members(
        device, Chains(*(rows(numbers) for numbers in device.chain)), {}, device.physics,
        tuple(rows(p.vector()) for p in device.physics),
    )  # fmt: skip


def together(rows: NDArray[np.generic]) -> list[Ints]:
    """Return the indices of equal rows together, in the order in which they first occur."""
    found: dict[bytes, list[int]] = {}
    for i, row in enumerate(np.ascontiguousarray(rows)):
        found.setdefault(row.tobytes(), []).append(i)
    return [np.array(which, dtype=np.int64) for which in found.values()]


class Stacked(NamedTuple):
    """Members of one structure, by index, with few and with many substeps per tick."""

    which: Ints
    coarse: Stack
    fine: Stack


def stacks(members: Members, few: int, many: int, seed: int = 0) -> list[Stacked]:
    """Return members of one of the `kinds`, arranged for the kernel by structure.

    Members whose dry friction would need more substeps are left out. Raises ValueError like
    `equations.frame`; members are those that `Members.check` accepts.
    """
    period = members.like.interface.period
    whole, remainder = members.delay_ticks()
    steps = [segments(remainder, period, n) for n in (few, max(few, many))]
    sound = np.flatnonzero(_followed(members, *steps[1]))
    counts = [np.ascontiguousarray(c[sound]) for c, _ in steps]
    found: list[Stacked] = []
    for some in together(np.column_stack([whole[sound], *counts])):
        which = sound[some]
        own = members.taken(which)
        coarse = _stack(own, members.plant, which, few, steps[0], seed)
        fine = coarse
        if many > few:
            fine_counts, durations = steps[1]
            eq = coarse.eq._replace(
                substeps=fine_counts[which[0]], durations=np.ascontiguousarray(durations[which].T)
            )
            fine = coarse._replace(eq=eq)
        found.append(Stacked(which, coarse, fine))
    return found


def _followed(members: Members, counts: Ints, durations: Floats) -> NDArray[np.bool_]:
    """Whether substeps are short enough for dry friction, as `Member.complaint` says it."""
    dry = sorted(dry_masses(members.physics))
    found = np.ones(members.size, dtype=bool)
    if not dry:
        return found
    longest = np.max(np.where(counts > 0, durations, 0.0), axis=1)
    close = ~sure(members.plant, 1.01 * longest)
    for i in np.flatnonzero(close).tolist():
        found[i] = not too_few_substeps(
            members.plant_at(i), dry, members.like.interface.period, counts[i].tolist(),
            durations[i].tolist(),
        )  # fmt: skip
    return found


def _stack(
    members: Members, plants: Plant, which: Ints, few: int, steps: tuple[Ints, Floats], seed: int
) -> Stack:
    """Lay out members of one structure; plants: of more, these among them."""
    first = _framed(members, int(members.delay_ticks()[0][0]), few, seed)
    counts, durations = steps
    plant = Plant(
        plants.a[which], plants.b[which],
        type(plants.matrices)(*(m[which] for m in plants.matrices)), plants.lag,
    )  # fmt: skip
    each = {
        "durations": durations[which],
        "reaction": reaction(plant),
        "masses": np.diagonal(plant.matrices.mass, axis1=-2, axis2=-1),
        "estimating": _rows(first.estimating, members.size),
        "smoothing": np.full(members.size, first.smoothing),
        "force_row": _rows(first.force_row, members.size),
        "behind": behind(plant, first.followers),
        "filter": _rows(first.filter, members.size),
        "command_rate": command_rate(
            members.physics, members.values, members.like.interface.period, members.size
        ),
    }  # the others are fields of the interface
    numbers = {
        name: _last(each[name] if name in each else members.of_interface(name)) for name in NUMBERS
    }
    tables = {
        name: getattr(first, name)._replace(
            parameters=_last(
                effect_table(
                    HOOK_OF[name], members.physics, members.values, members.chains, seed
                ).parameters
            )
        )
        for name in TABLES
    }
    eq: Equations = first._replace(substeps=counts[which[0]], **numbers, **tables)
    return Stack(eq, _last(plant.a), _last(plant.b))


def _rows(values: Floats, count: int) -> Floats:
    return np.tile(values, (count, 1))


def _last(values: Floats) -> Floats:
    """Return values (members, ...) with the members last."""
    axes = (*range(1, values.ndim), 0)
    return np.ascontiguousarray(values.transpose(axes))


# Frames by structure: a few hundred in a search.
_FRAMES: dict[Structure, Equations] = {}


def _framed(members: Members, whole: int, few: int, seed: int) -> Equations:
    """The frame of a structure, made once: all that is a member's own is put in later.

    members: of one of the `kinds`, with equal whole ticks of delay.
    """
    interface, plant = members.like.interface, members.plant
    if interface.force_sensor:  # its row depends on the links' own numbers
        return frame(members.first, few, seed)[0]
    still = tuple(getattr(interface, f.name) for f in fields(interface) if f.name not in VARIES)
    effects = tuple((p.effect.name, p.effect.code, p.at) for p in members.physics)
    masses = members.chains.masses.shape[1]
    key = (still, effects, masses, plant.size, plant.dof, whole, few, seed)
    if key not in _FRAMES:
        _FRAMES[key] = frame(members.first, few, seed)[0]
    return _FRAMES[key]

"""Known differences of a device in one run: a payload, another spring, a lower limit.

A recording states what was different about its device, with the keys of a device file (`[device]`
of the recording TOML). The difference from the device's file is known, and is added to the values
of any fit: a payload of 0.493 kg adds 0.493 kg to a fitted mass,

    m = m_fitted + (m_run - m_file),

Masses, springs, dampers, delay and numbers of physics are added in this way; a limit replaces the
device's own. For an effect that is not in the file because it is still to be found, a run may state
how much more of it there was: `more = { level = 0.93 }` for a payload that adds this weight times
lever, a known force that determines the scale of all others; or `times = { level = 2.18 }` if only
the ratio is known. None of this is fitted. A fit may try values at which a mass would be negative
without its payload: at least the share `LEAST` of the stated mass or spring remains.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from zwidth.shown import Valued
from zwidth.sim.chain import Chain, Chains, make_chain
from zwidth.sim.device import Device, DeviceError, place_label
from zwidth.sim.members import Members
from zwidth.sim.nearest import nearest
from zwidth.sim.physics import EFFECTS
from zwidth.sim.physics.effect import Physics
from zwidth.sim.table import Table

Floats = NDArray[np.float64]
ARRAYS = ("masses", "ground_dampers", "link_springs", "link_dampers")
POSITIVE = ("masses", "ground_spring", "link_springs")
LIMITS = ("delay_s", "command_limit", "command_gain")
KEYS = (*ARRAYS, "ground_spring", *LIMITS, "physics")
LEAST = 0.01
SOUGHT = {"times", "more"}  # keys for differences of an effect that is still to be found


@dataclass(frozen=True)
class Changes(Valued):
    """What a run adds to a device.

    chain: the difference, field by field. least: least remaining values of the chain's fields in
    `POSITIVE`. delay [s] is added, command_limit replaces the device's, None: unchanged.
    command_gain: multiplies the device's; the user of the command applies it. physics: values to be
    added, by effect@place; factors: multipliers, for numbers that belong to the drive
    (`Effect.of_drive`) or that a run gives as a ratio.
    """

    chain: Chain
    least: Chain
    delay: float = 0.0
    command_limit: float | None = None
    command_gain: float = 1.0
    physics: tuple[tuple[str, Mapping[str, float]], ...] = ()
    factors: tuple[tuple[str, Mapping[str, float]], ...] = ()

    def of(self, device: Device) -> Device:
        """Return a device as it was in the run."""
        changed = device.with_chain(_chain(self._chain(device.chain)))
        changed = changed.with_interface(**self._interface(device.interface.delay))
        more, times = dict(self.physics), dict(self.factors)
        own = tuple(_changed(p, times.get(place_label(p), {}), more.get(place_label(p), {}))
                    for p in device.physics)  # fmt: skip
        return replace(changed, physics=own)

    def of_members(self, members: Members) -> Members:
        """Return members as they were in the run; bit for bit the result of `of` for each."""
        changed = replace(members, chains=Chains(*self._chain(members.chains)))
        changed = changed.with_interface(**self._interface(members.of_interface("delay")))
        more, times, values = dict(self.physics), dict(self.factors), list(changed.values)
        for i, p in enumerate(changed.physics):
            names = [q.name for q in p.effect.parameters]
            for name, factor in times.get(place_label(p), {}).items():
                values[i] = values[i].copy()
                values[i][:, names.index(name)] *= factor
            for name, added in more.get(place_label(p), {}).items():
                values[i] = values[i].copy()
                values[i][:, names.index(name)] += added
        return replace(changed, values=tuple(values))

    def _chain(self, chain: Chain | Chains) -> list[Floats]:
        changed: list[Floats] = []
        for field in Chain._fields:
            own = getattr(chain, field) + getattr(self.chain, field)
            positive = field in POSITIVE and np.any(getattr(self.chain, field))
            changed.append(np.maximum(own, getattr(self.least, field)) if positive else own)
        return changed

    def _interface(self, delay: float | Floats) -> dict[str, float | Floats]:
        changed: dict[str, float | Floats] = {}
        if self.delay != 0.0:
            changed["delay"] = np.maximum(0.0, delay + self.delay)
        if self.command_limit is not None:
            changed["command_limit"] = self.command_limit
        return changed


def _changed(physics: Physics, factors: Mapping[str, float], added: Mapping[str, float]) -> Physics:
    if not factors and not added:
        return physics
    values = {
        name: value * factors.get(name, 1.0) + added.get(name, 0.0)
        for name, value in physics.values.items()
    }
    return replace(physics, values=values)


def difference(before: Device, after: Device) -> Changes:
    """Return the change from one device to another with the same masses and effects."""
    added = [np.subtract(b, a) for a, b in zip(before.chain, after.chain, strict=True)]
    least = [LEAST * np.asarray(numbers) for numbers in after.chain]
    other = {place_label(p): p.values for p in after.physics}
    more = tuple(
        (label, {name: other[label][name] - value for name, value in p.values.items()
                 if other[label][name] != value})
        for p in before.physics if (label := place_label(p)) in other
    )  # fmt: skip
    limit = after.interface.command_limit
    return Changes(
        _chain(added), _chain(least), after.interface.delay - before.interface.delay,
        limit if limit != before.interface.command_limit else None,
        physics=tuple((label, values) for label, values in more if values),
    )  # fmt: skip


def beside(known: Changes | None, more: Changes) -> Changes:
    """Return the known differences together with further ones."""
    if known is None:
        return more
    values: dict[str, dict[str, float]] = {}
    for label, added in (*known.physics, *more.physics):
        own = values.setdefault(label, {})
        for name, value in added.items():
            own[name] = own.get(name, 0.0) + value
    chain = [np.add(a, b) for a, b in zip(known.chain, more.chain, strict=True)]
    limit = known.command_limit if more.command_limit is None else more.command_limit
    return replace(known, chain=_chain(chain), delay=known.delay + more.delay,
                   command_limit=limit, physics=tuple(values.items()))  # fmt: skip


def known_changes(table: Table) -> Table:
    """Return the table `[device]` of a recording; raises for keys that it may not have."""
    return table.only(KEYS)


def changes_of(table: Mapping[str, object], device: Device) -> Changes | None:
    """Return what a run adds to a device, from the table that describes it.

    Raises DeviceError with one sentence: a mechanism given as modes, another number of masses or
    links, a value that is not allowed, an effect that the device's file does not have.
    """
    own = known_changes(Table(table, "device"))
    if not own.keys():
        return None
    if device.modal is not None and any(key in own for key in (*ARRAYS, "ground_spring")):
        raise DeviceError(
            "[device] of a recording changes masses or springs, but the device file describes"
            " modes; describe its mechanism by [chain]"
        )
    said = {key: own.numbers(key) for key in ARRAYS if key in own}
    for key, values in said.items():
        if len(values) != (expected := getattr(device.chain, key).size):
            raise DeviceError(
                f"device.{key} of the recording has {len(values)} entries; the device has"
                f" {expected}"
            )
    there = device.chain._asdict() | said
    masses, dampers, springs, links = (np.array(there[key]) for key in ARRAYS)
    spring = own.number("ground_spring", device.chain.ground_spring)
    try:
        chain = make_chain(masses, dampers, spring, springs, links)
        limits = {key: own.number(key) for key in LIMITS if key in own}
        interface = {key.removesuffix("_s"): value for key, value in limits.items()}
        clock = device.with_interface(**interface).interface
    except ValueError as error:
        raise DeviceError(f"[device] of the recording: {error}") from None
    added = [np.subtract(a, b) for a, b in zip(chain, device.chain, strict=True)]
    least = [LEAST * np.asarray(numbers) for numbers in chain]
    return Changes(
        _chain(added),
        _chain(least),
        clock.delay - device.interface.delay,
        clock.command_limit if "command_limit" in own else None,
        clock.command_gain / device.interface.command_gain,
        *_of_physics(own.tables("physics"), device),
    )


def _chain(fields: Sequence[Floats]) -> Chain:
    masses, dampers, spring, links, link_dampers = fields
    return Chain(masses, dampers, float(spring), links, link_dampers)


Labelled = tuple[tuple[str, Mapping[str, float]], ...]


def _of_physics(tables: Sequence[Table], device: Device) -> tuple[Labelled, Labelled]:
    """Return what to add to the numbers of effects, and by what to multiply them, by label.

    Numbers that scale with the effect of the command, and are not zero, are multiplied: a loop of
    four times the gain has four times each of them, whatever a fit makes of the drive.
    """
    added: dict[str, dict[str, float]] = {}
    factors: dict[str, dict[str, float]] = {}
    known = {place_label(p): p for p in device.physics}
    for table in tables:
        label = f"{table.text('effect')}@{table.text('at')}"
        if SOUGHT & set(table.keys()):
            factors[label], added[label] = _sought(table, label)
            continue
        if label not in known:
            hint = nearest(label, known) if known else "it has none"
            raise DeviceError(
                f"{table.path} of the recording is {label}, which the device file does not have;"
                f" {hint}; for an effect that is still to be found, give more = {{...}}"
            )
        values, scales = known[label].values, known[label].effect.of_drive
        table.only(("effect", "at", *SOUGHT, *values))
        for name in values:
            if name not in table:
                continue
            if scales and 0.0 < values[name] < math.inf:
                factors.setdefault(label, {})[name] = table.number(name) / values[name]
            else:
                added.setdefault(label, {})[name] = table.number(name) - values[name]
    return tuple(added.items()), tuple(factors.items())


def _sought(table: Table, label: str) -> tuple[dict[str, float], dict[str, float]]:
    """Return the factors and the additions of an effect's numbers.

    These apply to whatever value is found. Only magnitudes are changed, since an effect of
    magnitude zero has no other numbers.
    """
    name, at = table.only(("effect", "at", *SOUGHT)).text("effect"), table.text("at")
    if name not in EFFECTS or at not in EFFECTS[name].places:
        hint = nearest(at, EFFECTS[name].places) if name in EFFECTS else nearest(name, EFFECTS)
        raise DeviceError(f"{table.path} of the recording is {label}, which is unknown; {hint}")
    allowed = [p.name for p in EFFECTS[name].parameters if p.role == "magnitude"]
    found: list[dict[str, float]] = []
    for key in ("times", "more"):
        own = table.table(key).only(allowed)
        found.append({name: own.number(name) for name in own.values})
        least = 0.0 if key == "times" else -math.inf
        for name, value in found[-1].items():
            if not least < value < math.inf:
                kind = "number above 0" if key == "times" else "finite number"
                raise DeviceError(
                    f"{own.path}.{name} of the recording is {value:g}; it must be a {kind}"
                )
    if both := found[0].keys() & found[1].keys():
        raise DeviceError(
            f"{table.path} of the recording has {min(both)} in both `times` and `more`; keep one"
        )
    return found[0], found[1]

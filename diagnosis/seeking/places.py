"""Effects that may still be added to a device: each at every place and magnitude."""

from collections.abc import Sequence

from zwidth.diagnosis.seeking.candidates import Start
from zwidth.diagnosis.seeking.magnitude import within_bounds
from zwidth.sim.device import Device, has_room, known
from zwidth.sim.physics import EFFECTS
from zwidth.sim.physics.effect import Effect, Physics
from zwidth.sim.physics.sizes import Sizes
from zwidth.sim.place import Place, place_at

ELSEWHERE = ("lattice", "folding")  # effects that are not sought by starts


def open_places(device: Device, file: Device | None = None) -> list[tuple[Effect, Place]]:
    """Return effects and places that a device does not have yet.

    A place has at most one effect of a family. Effects in the device file are not sought. file: as
    in `known`.
    """
    present = {(p.effect.name, p.place.acts_on) for p in device.physics}
    families = {(p.effect.family, p.place.acts_on) for p in device.physics if p.effect.family}
    masses = device.chain.masses.size + len(device.hosts())
    found: list[tuple[Effect, Place]] = []
    for effect in EFFECTS.values():
        if effect.sought in ELSEWHERE or (effect.rotary_only and not device.rotary):
            continue
        if not has_room(effect, masses):
            continue
        for place in map(place_at, effect.places):
            there = place.masses_needed <= device.chain.masses.size
            taken = (effect.name, place.acts_on) in present
            akin = (effect.family, place.acts_on) in families
            if there and not taken and not akin and not known(effect, place, device, file):
                found.append((effect, place))
    return found


def starts_at(
    effects: Sequence[tuple[Effect, Place]], sizes: Sizes, far: bool
) -> dict[str, list[Start]]:
    """Return starts by label; far: over all plausible magnitudes, else near the limit."""
    found: dict[str, list[Start]] = {}
    for effect, place in effects:
        if not sizes.driven and effect.of_command:
            continue
        bounds = effect.within(sizes, place)
        way = effect.sweep if far else effect.starts
        starts = [
            Start(Physics(effect, str(place), values), scales, bounds)
            for values, scales in way(sizes, place)
            if within_bounds(effect, values)
        ]
        if starts:
            found[starts[0].label] = starts
    return found

"""Names, in a fit, of parameters that a recording declares as its own (`[free]`).

    [free]
    ground_spring = "stiff"               # or masses, ground_dampers ...: all in the chain
    position = "stiff"                    # the origin of positions
    "coulomb_friction@m1.level" = "dry"   # a parameter of an effect, in the file or found

An encoder counts from where it was switched on, and a carriage that was taken off its pinion may be
put back elsewhere. `position` frees the parameters of effects that depend on the origin of
positions (the phase of a ripple, the angle of a pendulum).
"""

from collections.abc import Mapping

from zwidth.sim.device import Device, DeviceError
from zwidth.sim.nearest import nearest
from zwidth.sim.physics import LIBRARY
from zwidth.sim.place import label_of, place_at

POSITION = "position"
CHAIN = ("masses", "ground_dampers", "ground_spring", "link_springs", "link_dampers")


def own_of(table: Mapping[str, str], device: Device) -> tuple[tuple[str, str], ...]:
    """Return (parameter, word) of each entry; raises DeviceError for an unknown parameter."""
    found: list[tuple[str, str]] = []
    for key, word in table.items():
        if not word.strip():
            raise DeviceError(
                f"free.{key} of the recording is empty; give a word: recordings with the same word"
                " share the value"
            )
        found += [(name, word) for name in _names(key, device)]
    return tuple(found)


def _names(key: str, device: Device) -> list[str]:
    n = device.chain.masses.size
    masses, links = range(1, n + 1), range(1, n)
    named = {
        "masses": [f"m{i}" for i in masses],
        "ground_dampers": [f"b{i}" for i in masses],
        "link_springs": [f"k{i}{i + 1}" for i in links],
        "link_dampers": [f"b{i}{i + 1}" for i in links],
        "ground_spring": ["k0"] if device.chain.ground_spring > 0.0 else [],
    }
    if key in named and not named[key]:
        raise DeviceError(f"free.{key} of the recording: the device has no {key}; remove this key")
    if key in named:
        return named[key]
    return _anchored(n) if key == POSITION else [_of_effect(key)]


def _anchored(masses: int) -> list[str]:
    """The angles of effects that depend on the origin of positions."""
    return [
        f"{label_of(name, place)}.{p.name}"
        for name, effect in LIBRARY.items()
        for p in effect.parameters
        if p.role == "turning" and effect.hook in ("force", "sensor")
        for place in map(place_at, effect.places)
        if place.masses_needed <= masses
    ]


def _of_effect(key: str) -> str:
    label, _, parameter = key.rpartition(".")
    name, _, at = label.partition("@")
    if name not in LIBRARY:
        known = [*CHAIN, POSITION, "EFFECT@PLACE.PARAMETER"]
        hint = nearest(name, LIBRARY) if "@" in key else nearest(key, known)
        raise DeviceError(f"unknown key 'free.{key}' of the recording; {hint}")
    effect = LIBRARY[name]
    names = [p.name for p in effect.parameters]
    if parameter not in names:
        raise DeviceError(
            f"free.{key} of the recording: {name} has no parameter {parameter!r};"
            f" {nearest(parameter, names)}"
        )
    try:
        place_at(at)
    except ValueError as error:
        raise DeviceError(f"free.{key} of the recording: {error}") from None
    return key

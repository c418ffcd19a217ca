"""Every effect by name. An effect is one file here that defines the `Effect` of the file's name."""

import copyreg
from collections.abc import Mapping, Sequence
from importlib import import_module
from types import MappingProxyType
from typing import Any

from zwidth.sim.nearest import nearest
from zwidth.sim.own_files import FOLDER, VARIABLE
from zwidth.sim.physics.effect import Effect, Physics
from zwidth.sim.physics.own import OWN, WRONG
from zwidth.sim.place import Place, place_at

NAMES = (
    "coulomb_friction",
    "stribeck_friction",
    "rising_friction",
    "presliding_friction",
    "directional_friction",
    "load_friction",
    "quadratic_drag",
    "constant_force",
    "ground_spring",
    "gravity_pendulum",
    "force_ripple",
    "backlash",
    "cubic_stiffness",
    "hysteresis",
    "extra_mode",
    "position_servo",
    "servo_limit",
    "servo_dead_zone",
    "servo_integral",
    "goal_rate_limit",
    "falling_limit",
    "open_winding",
    "saturation",
    "rate_limit",
    "dead_band",
    "command_step",
    "actuator_lag",
    "gain_asymmetry",
    "loop_delay",
    "dropped_samples",
    "encoder_step",
    "encoder_eccentricity",
    "rectified_sensor",
    "sensor_lag",
    "sensor_filter",
    "moving_average",
    "free_spring",
    "free_damper",
    "free_amplifier",
    "free_sensor",
    "free_force",
    "free_product",
    "free_shift",
)

# Laws outside the library: no device file names them, a diagnosis tests them (`forces.probes`).
PROBE_NAMES = ("power_drag", "one_sided_spring", "periodic_force")


def _declared(names: Sequence[str]) -> Mapping[str, Effect]:
    found = {name: getattr(import_module(f"zwidth.sim.physics.{name}"), name) for name in names}
    return MappingProxyType(found)


LIBRARY = _declared(NAMES)
PROBES = _declared(PROBE_NAMES)


def _with_own() -> tuple[Mapping[str, Effect], tuple[str, ...]]:
    """All effects, and what is wrong with the files of the user's own."""
    every, wrong = dict(LIBRARY), list(WRONG)
    for name, own in OWN.items():
        if name in every or name in PROBES:
            wrong.append(
                f"{own.file}: name is {name!r}, which is an effect of the library; give it another"
                " name"
            )
        else:
            every[name] = own.effect
    return MappingProxyType(every), tuple(wrong)


EFFECTS, WRONG_FILES = _with_own()
"""Every effect by name, the user's own last; errors of the files of the user's own."""
RICHER_FORMS: Mapping[str, tuple[Effect, ...]] = MappingProxyType(
    {name: tuple(e for e in EFFECTS.values() if name in e.contains) for name in EFFECTS}
)
"""Effect -> those that are a richer form of it (`Effect.contains`)."""


def contains(richer: str, there: Place, simple: str, place: Place) -> bool:
    """Whether an effect at a place is a richer form of another at one; no for unknown names."""
    known = richer in EFFECTS and simple in EFFECTS[richer].contains
    return known and _acts(richer, there) == _acts(simple, place)


def _acts(name: str, place: Place) -> Place:
    """Where an effect acts: a law of the drive's force at m1 is one of the command."""
    return place_at("command") if EFFECTS[name].of_drive else place.acts_on


def richer_at(simple: str, place: Place, rotary: bool) -> list[tuple[Effect, Place]]:
    """Return every effect at every place that is a richer form of one at a place."""
    return [
        (effect, there)
        for effect in RICHER_FORMS.get(simple, ())
        if rotary or not effect.rotary_only
        for there in map(place_at, effect.places)
        if contains(effect.name, there, simple, place)
    ]


def effect_named(name: str) -> Effect:
    """Return the effect of that name; raises ValueError that names the nearest known one."""
    if name in EFFECTS:
        return EFFECTS[name]
    raise ValueError(f"there is no effect {name!r}; {unknown_effect(name)}")


def unknown_effect(name: str) -> str:
    """Return a sentence on an unknown effect and what to do."""
    own = f"an effect of your own is declared in a file in the folder {FOLDER!r} or in {VARIABLE}"
    near = nearest(name, EFFECTS)
    return f"{near} ({own})" if near.endswith("?") else f"{near}; {own}"


def make_physics(name: str, at: str, **values: float) -> Physics:
    """Return an effect of a device: `make_physics("coulomb_friction", "m1", level=0.02)`.

    Raises ValueError (field, value, what is allowed), see `Physics`.
    """
    return Physics(effect_named(name), at, values)


def _read_back(effect: Effect) -> str | tuple[Any, ...]:
    """How an effect is pickled or copied: by its name, since laws are compared by identity."""
    name = effect.name
    if EFFECTS.get(name, PROBES.get(name)) is effect:
        return _known, (name,)
    return object.__reduce_ex__(effect, 4)  # it was made in a program, without a declaration


def _known(name: str) -> Effect:
    return EFFECTS[name] if name in EFFECTS else PROBES[name]


copyreg.pickle(Effect, _read_back)

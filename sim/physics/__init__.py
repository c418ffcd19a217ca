"""Every effect by name. An effect is one file here that defines the `Effect` of the file's name."""

from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType

from sim.nearest import nearest
from sim.physics.effect import Effect, Physics

NAMES = (
    "coulomb_friction",
    "stribeck_friction",
    "presliding_friction",
    "directional_friction",
    "quadratic_drag",
    "constant_force",
    "ground_spring",
    "gravity_pendulum",
    "force_ripple",
    "backlash",
    "cubic_stiffness",
    "hysteresis",
    "extra_mode",
    "saturation",
    "dead_band",
    "command_step",
    "actuator_lag",
    "gain_asymmetry",
    "loop_delay",
    "dropped_samples",
    "encoder_step",
    "encoder_eccentricity",
    "rectified_sensor",
)

EFFECTS: Mapping[str, Effect] = MappingProxyType(
    {name: getattr(import_module(f"sim.physics.{name}"), name) for name in NAMES}
)


def effect_named(name: str) -> Effect:
    """Return the effect of that name; raises ValueError that names the nearest known one."""
    if name in EFFECTS:
        return EFFECTS[name]
    raise ValueError(f"there is no effect {name!r}; {nearest(name, EFFECTS)}")


def make_physics(name: str, at: str, **values: float) -> Physics:
    """Return one effect as a device has it: `make_physics("coulomb_friction", "m1", level=0.02)`.

    Raises ValueError (field, value, what is allowed), see `Physics`.
    """
    return Physics(effect_named(name), at, values)

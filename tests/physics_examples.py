"""One example of every effect at every place, sized for the PHANToM of Table I."""

from functools import cache

from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import EFFECTS, make_physics
from zwidth.sim.physics.effect import Effect, Physics
from zwidth.sim.physics.free_force import grid_of, grid_values
from zwidth.sim.physics.free_law import points_of, table_values
from zwidth.sim.physics.two_tables import TABLES, two_tables_of, two_tables_values
from zwidth.sim.place import place_at

EXAMPLES: dict[str, dict[str, float]] = {
    "coulomb_friction": {"level": 2e-3},
    "stribeck_friction": {"level": 1.5e-3, "static_level": 2.5e-3, "velocity": 0.05},
    "rising_friction": {"level": 2.5e-3, "static_level": 1e-3, "velocity": 0.05},
    "presliding_friction": {"level": 2e-3, "stiffness": 20.0},
    "directional_friction": {
        "level_plus": 1e-3,
        "level_minus": 2e-3,
        "viscous_plus": 2e-3,
        "viscous_minus": 1e-3,
    },
    "load_friction": {"ratio": 0.1},
    "quadratic_drag": {"coefficient": 1e-3},
    "constant_force": {"level": 5e-3},
    "ground_spring": {"stiffness": 0.5},
    "gravity_pendulum": {"level": 0.02, "angle": 0.3},
    "force_ripple": {"amplitude": 3e-3, "period": 0.02, "phase": 0.4},
    "backlash": {"gap": 2e-5},
    "cubic_stiffness": {"coefficient": 1e4},
    "hysteresis": {"stiffness": 5.0, "level": 3e-3, "shape": 1.5},
    "extra_mode": {"mass": 1e-4, "stiffness": 5.0, "damping": 2e-3},
    "position_servo": {"stiffness": 3.0, "damping": 2e-3, "back_emf": 1e-3},
    "servo_limit": {"limit": 0.02},
    "servo_dead_zone": {"half": 1e-4},
    "servo_integral": {"rate": 20.0, "limit": 5e-3},
    "goal_rate_limit": {"rate": 0.5},
    "falling_limit": {"limit": 0.02, "slope": 2e-3},
    "open_winding": {"damping": 1e-3},
    "saturation": {"limit": 0.02},
    "rate_limit": {"rate": 1.0},
    "dead_band": {"width": 2e-3},
    "command_step": {"step": 1e-3},
    "actuator_lag": {"time_constant": 5e-4},
    "gain_asymmetry": {"ratio": 1.2},
    "loop_delay": {"delay": 5e-4},
    "dropped_samples": {"rate": 0.05},
    "encoder_step": {"step": 1e-5},
    "encoder_eccentricity": {"amplitude": 1e-4, "period": 0.05, "phase": 1.0},
    "rectified_sensor": {},
    "sensor_lag": {"time_constant": 5e-4},
    "sensor_filter": {"time_constant": 4e-4, "damping": 0.7},
    "moving_average": {"window": 2e-3},
    "free_spring": table_values([(-0.01, 2e-3), (0.0, 0.0), (0.02, -3e-3)]),
    "free_damper": table_values([(0.0, 0.0), (0.2, -1e-3), (1.0, -2e-3)], odd=True),
    "free_amplifier": table_values([(-0.05, 3e-3), (0.0, 0.0), (0.05, 2e-3)]),
    "free_sensor": table_values([(-0.01, 1e-5), (0.0, 0.0), (0.01, 2e-5)]),
    "free_force": grid_values(
        ["velocity", "time"],
        [-0.5, 0.0, 0.3],
        [0.0, 0.02, 0.05, 0.2],
        [[2e-3, 1e-3, 4e-3, 0.0], [0.0, 1e-3, -1e-3, 2e-3], [-3e-3, 0.0, -2e-3, 1e-3]],
    ),
    "free_product": two_tables_values(
        ["velocity", "time"],
        [(-0.5, 2e-3), (0.0, 0.0), (0.3, -3e-3)],
        [(0.0, 1.0), (0.02, 0.4), (0.05, 1.5), (0.2, -0.2)],
    ),
    "free_shift": two_tables_values(
        ["velocity", "time"],
        [(-0.5, 2e-3), (0.0, 0.0), (0.3, -3e-3)],
        [(0.0, 0.1), (0.02, 0.0), (0.05, -0.15), (0.2, 0.2)],
    ),
}

MASSES = 3  # of the PHANToM
EVERYWHERE = [
    (name, place)
    for name, effect in EFFECTS.items()
    for place in effect.places
    if place_at(place).masses_needed <= MASSES
]
"""Every effect at every place that the PHANToM has."""
FARTHER = [
    (name, place)
    for name, effect in EFFECTS.items()
    for place in effect.places
    if place_at(place).masses_needed > MASSES
]
"""Every effect at every place that only a chain of four or five masses has."""


@cache
def phantom() -> Device:
    """Return the device of Table I."""
    return load_device("phantom_1_0")


@cache
def five() -> Device:
    """Return a rotary chain of five masses, free to turn."""
    chain = make_chain(
        [2e-4, 9e-4, 7e-5, 3e-4, 2e-4], [1e-3, 1e-2, 4e-3, 2e-3, 1e-3], 0.0,
        [217.0, 14.5, 60.0, 30.0], [0.06, 1.3e-3, 5e-3, 4e-3],
    )  # fmt: skip
    return Device("five masses", "", True, chain, Interface(delay=0.0013))


def example(name: str, at: str | None = None) -> Physics:
    """Return the example of an effect, at its first place by default."""
    return make_physics(name, at or EFFECTS[name].places[0], **EXAMPLES[name])


def with_needed(physics: Physics) -> tuple[Physics, ...]:
    """Return an effect, after the example of the one without which it has no part in a device."""
    needs = physics.effect.needs
    return (example(needs), physics) if needs else (physics,)


def neutral(effect: Effect, at: str) -> Physics:
    """Return the effect with every parameter that has a neutral value at it."""
    values = {
        p.name: EXAMPLES[effect.name][p.name] if p.neutral is None else p.neutral
        for p in effect.parameters
    }
    return Physics(effect, at, values)


def entry_of(name: str, place: str) -> list[str]:
    """Return the lines of an example in a device file, without their header."""
    values = EXAMPLES[name]
    entry = [f'effect = "{name}"', f'at = "{place}"']
    if EFFECTS[name].sought != "learned":
        return entry + [f"{key} = {value!r}" for key, value in values.items()]
    if name == "free_force":
        grid = grid_of(values)
        return [
            *entry, f"over = {list(grid.over)}", f"rows = {list(grid.rows)}",
            f"columns = {list(grid.columns)}", f"table = {[list(row) for row in grid.table]}",
        ]  # fmt: skip
    if name in ("free_product", "free_shift"):
        over, *tables = two_tables_of(values)
        rows = [[list(point) for point in table] for table in tables]
        return [
            *entry, f"over = {list(over)}",
            *(f"{key} = {points}" for key, points in zip(TABLES, rows, strict=True)),
        ]  # fmt: skip
    rows = [list(point) for point in points_of(values)]
    return [*entry, f"odd = {str(values['odd'] > 0.5).lower()}", f"table = {rows}"]

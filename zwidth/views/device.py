"""A device: its chain, its interface, its physics."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from zwidth.sim.device import Device, place_label
from zwidth.sim.interface import Interface
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_force import grid_of, is_grid
from zwidth.sim.physics.free_law import is_table, points_of
from zwidth.sim.physics.free_product import free_product
from zwidth.sim.physics.two_tables import is_two_tables, two_tables_of
from zwidth.views.table import Table, number
from zwidth.views.units import Units, rows, units

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset


MOST = 8  # most listed parameters of an effect


def table(device: Device) -> Table:
    """Return a row per mass, and the parts of interface and physics that are not plain sampling."""
    unit = units(device.rotary)
    damping = f"[{unit.damping}]"
    headings = ("", f"mass [{unit.mass}]", f"damper to ground {damping}",
                f"spring to next [{unit.stiffness}]", f"damper to next {damping}")  # fmt: skip
    grid = [
        [name, *map(number, values)]
        for name, *values in zip(_masses(device), *_columns(device), strict=True)
    ]
    said = [_interface(device, unit)]
    said += [f"{place_label(p)}: {in_points(p) or _values(p.values)}" for p in device.physics]
    return Table(f"Device {device.name} ({device.source})", said, headings, grid)


def _interface(device: Device, unit: Units) -> str:
    face, usual = device.interface, Interface()
    sampled = f"Sampled every {1e3 * face.period:g} ms, delay {1e3 * face.delay:g} ms"
    more = [
        f"{words} {value:g} {in_unit}".rstrip()
        for words, value, neutral, in_unit in (
            ("encoder step", face.encoder_step, usual.encoder_step, unit.length),
            ("command step", face.command_step, usual.command_step, unit.force),
            ("command limit", face.command_limit, usual.command_limit, unit.force),
            ("command gain", face.command_gain, usual.command_gain, ""),
            ("velocity cutoff", face.velocity_cutoff_hz, usual.velocity_cutoff_hz, "Hz"),
            ("velocity step", face.velocity_step, usual.velocity_step, f"{unit.length}/s"),
            ("velocity filter of order", face.velocity_order, usual.velocity_order, ""),
            ("velocity every", face.velocity_ticks, usual.velocity_ticks, "samples"),
            ("position every", face.position_ticks, usual.position_ticks, "samples"),
            ("gain of the force feedback", face.force_gain, usual.force_gain, ""),
            ("spring to ground", device.chain.ground_spring, 0.0, unit.stiffness),
        )
        if value != neutral
    ]
    return ", ".join([sampled, *more, *said_of_estimator(face, device.rotary)])


def said_of_estimator(face: Interface, rotary: bool) -> list[str]:
    """Say which estimator computes the velocity, with its settings, if it is not the difference."""
    if face.velocity_estimator == Interface().velocity_estimator:
        return []
    length = units(rotary).length
    own = {"window": "samples", "acceleration": f"{length}/s2"}
    set_to = (
        f"{name} {getattr(face, f'velocity_{name}'):g} {own.get(name, length)}"
        for name in face.estimator.settings
    )
    return [f"velocity by {face.velocity_estimator} ({', '.join(set_to)})"]


def in_points(physics: Physics) -> str:
    """The description of a law without a formula; "" for all other effects."""
    if is_table(physics.effect.parameters):
        return f"a table of {len(points_of(physics.values))} points"
    if is_two_tables(physics.effect.parameters):
        (a, b), first, second = two_tables_of(physics.values)
        does = "times" if physics.effect is free_product else "shifted by"
        return f"{len(first)} points over {a} {does} {len(second)} over {b}"
    if not is_grid(physics.effect.parameters):
        return ""
    grid = grid_of(physics.values)
    sizes = (len(grid.rows), len(grid.columns))
    axes = [f"{n} states of {s}" for s, n in zip(grid.over, sizes, strict=False)]
    return f"over {' and '.join(axes)}"


def _values(values: Mapping[str, float]) -> str:
    """The parameters of an effect, as far as they are set; of many the first."""
    known = [f"{key} {value:.4g}" for key, value in values.items() if not math.isnan(value)]
    more = [f"{len(known) - MOST} more"] if len(known) > MOST else []
    return ", ".join([*known[:MOST], *more])


def _masses(device: Device) -> list[str]:
    return [f"m{i + 1}" for i in range(device.chain.masses.size)]


def _columns(device: Device) -> tuple[list[float], ...]:
    """Masses, dampers to ground, springs and dampers to the next, NaN for the last mass."""
    chain = device.chain
    links = ([*v.tolist(), math.nan] for v in (chain.link_springs, chain.link_dampers))
    return chain.masses.tolist(), chain.ground_dampers.tolist(), *links


def dataset(device: Device) -> "Dataset":
    """Return the chain over its masses; interface and physics are attributes."""
    unit = units(device.rotary)
    names = ("mass", "damper_to_ground", "spring_to_next", "damper_to_next")
    of = (unit.mass, unit.damping, unit.stiffness, unit.damping)
    columns = {n: (v, u) for n, v, u in zip(names, _columns(device), of, strict=True)}
    facts = {"name": device.name, "source": device.source, "rotary": int(device.rotary)}
    facts |= {"ground_spring": device.chain.ground_spring, **vars(device.interface)}
    facts |= {
        f"{place_label(p)} {key}": value for p in device.physics for key, value in p.values.items()
    }
    return rows("place", (_masses(device), None), columns, facts)


def _response(device: Device) -> "Figure":
    from zwidth.figures.response import response_figure

    return response_figure(device)


PICTURES = {"response": _response}

"""Members of a population side by side: their numbers laid out for the lanes of the kernel.

`WIDTH` members of one structure (masses, links, effects and their places, whole ticks of delay and
substeps; all numbers their own) make a group. Every array of `Equations` gets a last axis of lanes;
places that are left over in a group repeat its last member.
"""

# pyright: reportMissingParameterType=false, reportUnknownParameterType=false

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from zwidth.sim.device import Device
from zwidth.sim.equations import EffectTable, Equations, frame
from zwidth.sim.jit import INLINED, part
from zwidth.sim.kernel import LOCKED, MAX_COLUMNS, MAX_MASSES, Memory, Scratch
from zwidth.sim.lane_type import WIDTH, as_lanes, lanes_of
from zwidth.sim.plant import Plant
from zwidth.sim.propagation import Choice, lane_choice

Floats = NDArray[np.float64]
Structure = tuple[Any, ...]


class Member(NamedTuple):
    """One device as a group takes it: its equations without propagators, and its plant."""

    eq: Equations
    plant: Plant

    @property
    def structure(self) -> Structure:
        """What all members of a group have in common."""
        eq = self.eq
        tables = (eq.forces, eq.frictions, eq.sensors, eq.amplifiers, eq.clocks)
        shapes = [
            (t.codes.tobytes(), t.first.tobytes(), t.second.tobytes(), t.parameters.shape)
            for t in tables
        ]
        seeds = eq.clocks.parameters[:, 1:].tobytes()
        return (
            eq.states, eq.dof, eq.substeps.tobytes(), *shapes, seeds, eq.bounds_vary,
            eq.whole_delay, eq.period, eq.encoder_floor,
        )  # fmt: skip


def member(device: Device, substeps: int, seed: int = 0) -> Member:
    """Return a device as a group takes it; raises ValueError as `equations` does."""
    return Member(*frame(device, substeps, seed))


def side_by_side(arrays: Sequence[Floats | float]) -> Floats:
    """Return arrays of one shape with a last axis of lanes, the last of them repeated."""
    filled = [*arrays, *[arrays[-1]] * (WIDTH - len(arrays))]
    return np.ascontiguousarray(np.stack([np.asarray(a, np.float64) for a in filled], axis=-1))


class Group(NamedTuple):
    """Equations whose arrays have a last axis of lanes, and their working space."""

    eq: Equations
    scratch: Scratch


def group(members: Sequence[Member]) -> Group:
    """Lay out up to `WIDTH` members of one structure."""
    first = members[0].eq
    a = side_by_side([m.plant.a for m in members])
    b = side_by_side([m.plant.b for m in members])
    dry = first.frictions.first
    room, now = lane_choice(a, b, 2 ** (1 + int(dry.max())) if dry.size else 1)

    def every(field: str) -> Floats:
        return side_by_side([getattr(m.eq, field) for m in members])

    def table(field: str) -> EffectTable:
        own: EffectTable = getattr(first, field)
        return own._replace(
            parameters=side_by_side([getattr(m.eq, field).parameters for m in members])
        )

    numbers = ("smoothing", "encoder_step", "command_step", "command_limit")
    tables = ("forces", "frictions", "sensors", "amplifiers", "clocks")
    eq = first._replace(
        durations=every("durations"), reaction=every("reaction"), masses=every("masses"),
        propagators=now, **{n: every(n) for n in numbers}, **{n: table(n) for n in tables},
    )  # fmt: skip
    return Group(eq, _scratch(eq, room))


def _scratch(eq: Equations, room: Choice) -> Scratch:
    forces, frictions = eq.forces.codes.size, eq.frictions.codes.size

    def zeros(*shape: int) -> Floats:
        return np.zeros((*shape, WIDTH))

    return Scratch(
        zeros(MAX_COLUMNS), zeros(forces), zeros(forces), zeros(forces), zeros(MAX_MASSES),
        zeros(LOCKED + 1, MAX_MASSES), zeros(LOCKED + 1, MAX_MASSES), zeros(MAX_MASSES),
        zeros(frictions, 2), room,
    )  # fmt: skip


# What compiled code sees of it. VIEWS: named tuple -> (a field, how many axes it has in a group,
# and the function that views the tuple in lanes).
VIEWS: dict[type, tuple[str, int, Any]] = {}


def seen(value: Any) -> Any:
    """Return a named tuple as compiled code sees it: in lanes where it is that of a group."""
    return value


@overload(seen, strict=False, jit_options=INLINED)
def _seen_of(value: Any) -> Any:
    field, axes, view = VIEWS[value.instance_class]
    if value.types[value.fields.index(field)].ndim == axes:
        return lambda value: view(value)
    return lambda value: value


@part
def lane_table(table):
    """View an effect table in lanes."""
    return EffectTable(table.codes, table.first, table.second, as_lanes(table.parameters))


@part
def lane_equations(eq):
    """View equations in lanes."""
    return Equations(
        eq.dof, eq.states, eq.columns, eq.lagging, eq.substeps, as_lanes(eq.durations),
        as_lanes(eq.propagators), eq.quadratics, as_lanes(eq.reaction), as_lanes(eq.masses),
        eq.springs, eq.spring_stiffness, lane_table(eq.forces), lane_table(eq.frictions),
        eq.bounds_vary, lane_table(eq.sensors), lane_table(eq.amplifiers), lane_table(eq.clocks),
        eq.whole_delay, eq.period, eq.rate, lanes_of(eq.smoothing), lanes_of(eq.encoder_step),
        eq.encoder_floor, lanes_of(eq.command_step), lanes_of(eq.command_limit),
    )  # fmt: skip


@part
def lane_memory(memory):
    """View a memory in lanes."""
    return Memory(
        as_lanes(memory.x), as_lanes(memory.line), as_lanes(memory.controller),
        as_lanes(memory.internal), as_lanes(memory.scalars), memory.counters,
        as_lanes(memory.totals),
    )  # fmt: skip


@part
def lane_scratch(scratch):
    """View working space in lanes."""
    room = scratch.choice
    return Scratch(
        as_lanes(scratch.before), as_lanes(scratch.values), as_lanes(scratch.ahead),
        as_lanes(scratch.after), as_lanes(scratch.friction), as_lanes(scratch.limits),
        as_lanes(scratch.own), as_lanes(scratch.more), as_lanes(scratch.shares),
        Choice(
            as_lanes(room.every), room.made, as_lanes(room.sets), as_lanes(room.a),
            as_lanes(room.b), as_lanes(room.locked_a), as_lanes(room.locked_b),
            as_lanes(room.scale), as_lanes(room.work),
        ),
    )  # fmt: skip


VIEWS[Equations] = ("masses", 2, lane_equations)
VIEWS[Memory] = ("x", 2, lane_memory)
VIEWS[Scratch] = ("before", 2, lane_scratch)

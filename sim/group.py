"""Members of a population side by side: their numbers laid out for the lanes of the kernel.

`WIDTH` members of one structure make a group: they have the same masses, links, effects and places,
whole ticks of delay and substeps, and numbers of their own. Every array of `Equations` gets a last
axis of lanes; unused places of a group repeat its last member.
"""

# pyright: reportMissingParameterType=false, reportUnknownParameterType=false

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from zwidth.sim.device import Device
from zwidth.sim.equations import EffectTable, Equations, frame, too_few_substeps
from zwidth.sim.jit import INLINED, part
from zwidth.sim.kernel import LOCKED, MAX_COLUMNS, MAX_MASSES, PLAYED, Memory, Scratch
from zwidth.sim.lane_type import WIDTH, as_lanes, lanes_of
from zwidth.sim.plant import Plant
from zwidth.sim.propagation import Choice, lane_choice

Floats = NDArray[np.float64]
Structure = tuple[Any, ...]
NUMBERS = (
    "durations", "reaction", "masses", "estimating", "smoothing", "filter", "force_row",
    "force_gain", "encoder_step", "velocity_step", "command_step", "command_gain",
    "command_limit", "command_rate", "position_origin", "behind",
)  # fmt: skip
TABLES = ("forces", "frictions", "sensors", "amplifiers", "clocks")


class Member(NamedTuple):
    """One device as a group takes it: its equations without propagators, and its plant."""

    eq: Equations
    plant: Plant

    @property
    def complaint(self) -> str | None:
        """What is wrong with its substeps, if anything."""
        eq = self.eq
        if not eq.frictions.codes.size:
            return None
        return too_few_substeps(
            self.plant, np.unique(eq.frictions.first).tolist(), eq.period, eq.substeps.tolist(),
            eq.durations.tolist(),
        )  # fmt: skip

    @property
    def kind(self) -> Structure:
        """What all members of a population have in common: effects and their places."""
        eq = self.eq
        tables = [getattr(eq, name) for name in TABLES]
        shapes = [
            (*(a.tobytes() for a in (t.codes, t.first, t.second, t.origin)), t.parameters.shape)
            for t in tables
        ]
        seeds = eq.clocks.parameters[:, 1:].tobytes()
        reads = eq.reads.tobytes(), eq.followers.tobytes()
        estimates = eq.estimator, eq.window
        rates = eq.second_order, eq.velocity_ticks, eq.position_ticks, eq.force_row.size, eq.looped
        return (
            eq.states,
            eq.dof,
            *shapes,
            seeds,
            eq.period,
            eq.encoder_floor,
            *estimates,
            *rates,
            *reads,
        )

    @property
    def structure(self) -> Structure:
        """What all members of a group have in common: whole ticks of delay and substeps besides."""
        return *self.kind, self.eq.whole_delay, self.eq.substeps.tobytes()


def member(device: Device, substeps: int, seed: int = 0) -> Member:
    """Return a device as a member of a group; raises ValueError as `equations` does."""
    return Member(*frame(device, substeps, seed))


class Stack(NamedTuple):
    """Members of one structure: equations and plants whose arrays have a last axis of members."""

    eq: Equations
    a: Floats
    b: Floats

    @property
    def size(self) -> int:
        """How many members there are."""
        return self.a.shape[-1]


def stacked(arrays: Sequence[Floats | float]) -> Floats:
    """Return arrays of one shape with a last axis that counts them."""
    return np.stack([np.asarray(a, np.float64) for a in arrays], axis=-1)


def stack(members: Sequence[Member]) -> Stack:
    """Put members of one structure together; raises ValueError where they differ in it."""
    first = members[0].eq
    if any(m.structure != members[0].structure for m in members[1:]):
        raise ValueError("members of a stack differ in structure; make a stack for each structure")

    def table(field: str) -> EffectTable:
        own: EffectTable = getattr(first, field)
        return own._replace(parameters=stacked([getattr(m.eq, field).parameters for m in members]))

    numbers = {name: stacked([getattr(m.eq, name) for m in members]) for name in NUMBERS}
    eq = first._replace(**numbers, **{name: table(name) for name in TABLES})
    return Stack(eq, stacked([m.plant.a for m in members]), stacked([m.plant.b for m in members]))


class Group(NamedTuple):
    """Equations whose arrays have a last axis of lanes, and their working space."""

    eq: Equations
    scratch: Scratch


def lanes_at(values: Floats, chosen: NDArray[np.int64]) -> Floats:
    """Return (..., WIDTH) of values (..., members) for up to WIDTH members, the last repeated."""
    filled = np.minimum(np.arange(WIDTH), chosen.size - 1)
    return np.ascontiguousarray(values[..., chosen[filled]])


def group(members: Stack, chosen: NDArray[np.int64]) -> Group:
    """Lay out up to `WIDTH` of the members."""
    own = members.eq

    def table(field: str) -> EffectTable:
        all_of: EffectTable = getattr(own, field)
        return all_of._replace(parameters=lanes_at(all_of.parameters, chosen))

    dry = own.frictions.first
    sets = 2 ** (own.gaps.size + (1 + int(dry.max()) if dry.size else 0))
    room, now = lane_choice(lanes_at(members.a, chosen), lanes_at(members.b, chosen), sets)
    numbers = {name: lanes_at(getattr(own, name), chosen) for name in NUMBERS}
    eq = own._replace(propagators=now, **numbers, **{name: table(name) for name in TABLES})
    return Group(eq, _scratch(eq, room))


def _scratch(eq: Equations, room: Choice) -> Scratch:
    forces, frictions = eq.forces.codes.size, eq.frictions.codes.size

    def zeros(*shape: int) -> Floats:
        return np.zeros((*shape, WIDTH))

    return Scratch(
        zeros(MAX_COLUMNS), zeros(forces), zeros(forces), zeros(forces), zeros(MAX_MASSES),
        zeros(LOCKED + 1, MAX_MASSES), zeros(PLAYED + 1, MAX_MASSES), zeros(MAX_MASSES),
        zeros(frictions, 2), zeros(eq.gaps.size, 2), room,
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
    return EffectTable(
        table.codes, table.first, table.second, table.origin, as_lanes(table.parameters)
    )


@part
def lane_equations(eq):
    """View equations in lanes."""
    return Equations(
        eq.dof, eq.states, eq.columns, eq.lagging, eq.substeps, as_lanes(eq.durations),
        as_lanes(eq.propagators), eq.quadratics, as_lanes(eq.reaction), as_lanes(eq.masses),
        eq.springs, eq.spring_stiffness, lane_table(eq.forces), eq.gaps, lane_table(eq.frictions),
        eq.bounds_vary, lane_table(eq.sensors), lane_table(eq.amplifiers), lane_table(eq.clocks),
        eq.whole_delay, eq.period, eq.estimator, eq.window, as_lanes(eq.estimating), eq.rate,
        lanes_of(eq.smoothing), as_lanes(eq.filter),
        eq.second_order, eq.velocity_ticks, eq.position_ticks, as_lanes(eq.force_row),
        lanes_of(eq.force_gain), lanes_of(eq.encoder_step),
        eq.encoder_floor, lanes_of(eq.velocity_step), lanes_of(eq.command_step),
        lanes_of(eq.command_gain), lanes_of(eq.command_limit), lanes_of(eq.command_rate), eq.looped,
        lanes_of(eq.position_origin), eq.read, eq.reads, eq.followers, as_lanes(eq.behind),
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
        as_lanes(scratch.play),
        Choice(
            as_lanes(room.every), room.made, as_lanes(room.sets), as_lanes(room.a),
            as_lanes(room.b), as_lanes(room.locked_a), as_lanes(room.locked_b),
            as_lanes(room.scale), as_lanes(room.work),
        ),
    )  # fmt: skip


VIEWS[Equations] = ("masses", 2, lane_equations)
VIEWS[Memory] = ("x", 2, lane_memory)
VIEWS[Scratch] = ("before", 2, lane_scratch)

"""Many devices of one kind along a recording: their innovations, their costs, or their free runs.

Members have the same masses, links, effects and places, but their own numbers. They run `WIDTH` at
a time in the lanes of the kernel, grouped by whole ticks of delay, and each has the same result as
alone, bit for bit. A failure of one (an overflow, too few substeps for its friction) does not
affect the others: its innovations are infinite from there on.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.account import counted
from zwidth.sim.device import Device
from zwidth.sim.equations import Equations
from zwidth.sim.group import Group, Stack, group, lanes_at, member, stack
from zwidth.sim.kernel import BEGAN, MAX_COLUMNS, SCALARS, Memory, across
from zwidth.sim.lane_type import WIDTH
from zwidth.sim.members import Members, Stacked, stacks
from zwidth.sim.physics.dispatch import first_internal
from zwidth.sim.predict import STEADY, Outputs, Reading, judge_of, predict, saved_room
from zwidth.sim.propagation import lane_choice
from zwidth.sim.run import Start, let_follow

Floats = NDArray[np.float64]
Task = Callable[[], None]
RunAll = Callable[[Sequence[Task]], object]


@dataclass(frozen=True)
class Recorded:
    """A recording that members follow.

    command (ticks,); measured (ticks, o), NaN where nothing was measured; outputs: of the columns.
    external (ticks, n): other forces on the masses, then the base's acceleration if it moves (n +
    1), None for none. strengths (ticks,): factor of the drive's force, None for 1. arriving
    (ticks,): times a member's jitter, is subtracted from what was measured, None for none.
    uncounted (ticks,): do not count, None for none. columns (ticks,): first column of each tick's
    gain among a member's (`sim.predict.Gains`), None for one constant gain.
    """

    command: Floats
    measured: Floats
    outputs: Outputs
    external: Floats | None = None
    arriving: Floats | None = None
    strengths: Floats | None = None
    uncounted: NDArray[np.bool_] | None = None
    columns: NDArray[np.int64] | None = None

    @property
    def ticks(self) -> int:
        """Number of samples."""
        return self.command.size


@dataclass(frozen=True)
class Readings:
    """How each member reads a recording; None is neutral.

    observers: gains L (states, o) of all, or (members, states, o). gains (members,) of the command;
    origins (members, o) are subtracted from the measurement; jitters (members, o): factors of
    `arriving`. lates (members, o) [s]: how much later outputs are read than the recording states.
    """

    observers: Floats
    gains: Floats | None = None
    origins: Floats | None = None
    jitters: Floats | None = None
    lates: Floats | None = None


@dataclass(frozen=True)
class Followed:
    """The results, a row for each member.

    moments (members, o, o): sum of w w' over `counted` ticks, w the whitened innovations; infinite
    if a member overflowed. innovations (members, ticks, o) if they were kept, else (members, 0, o).
    memories: the states at the end.
    """

    moments: Floats
    counted: int
    innovations: Floats
    memories: tuple[Memory, ...]

    def costs(self) -> Floats:
        """Return -2 log likelihood of the whitened innovations, up to a constant: n ln det S."""
        finite = np.isfinite(self.moments).all(axis=(1, 2))
        found = np.full(finite.size, np.inf)
        spread = self.moments[finite] / max(1, self.counted)
        found[finite] = self.counted * np.linalg.slogdet(spread)[1]
        return found


class Population:
    """Devices of one kind, ready to follow recordings.

    Given one by one, or as `Members` of one kind. few, many: substeps per tick, and in ticks in
    which friction or play changes state. seed: of lost samples. Raises ValueError for no devices,
    devices of several kinds, substeps < 1 or a seed out of range.

    size: how many; dof, states: masses and states of each; reads, followers: where their sensors
    read (`sim/reading.py`).
    """

    def __init__(
        self, devices: Sequence[Device] | Members, few: int, many: int, seed: int = 0
    ) -> None:
        if isinstance(devices, Members):
            self.size = devices.size
            self.dof, self.states = devices.plant.dof, devices.plant.size
            like = devices.first
            laid_out = stacks(devices, few, many, seed)
        else:
            self.size = len(devices)
            eq, laid_out = _one_by_one(devices, few, many, seed)
            self.dof, self.states = eq.dof, eq.states
            like = devices[0]
        self.batches = [_Batch(*found) for found in laid_out]
        self.reads, self.followers, _ = like.reading()

    def start(
        self, positions: Floats, velocities: Floats, began: float = 0.0
    ) -> tuple[Memory, ...]:
        """Return each member's memory at tick 0; positions and velocities (members, masses).

        masses: all of them, including those of effects; filtered readings start as after a long
        motion at this speed. began [s]: time since the beginning of the recording.

        The encoder's earlier reading, which only a controller uses, is the true position. Raises
        ValueError for numbers that are not finite.
        """
        finite = np.isfinite(positions).all(axis=1) & np.isfinite(velocities).all(axis=1)
        if not finite.all():
            wrong = int(np.argmin(finite))
            Start(positions[wrong].tolist(), velocities[wrong].tolist()).state(positions.shape[1])
        x = np.zeros((self.size, MAX_COLUMNS))
        own = positions.shape[1]
        x[:, :own], x[:, self.dof : self.dof + own] = positions, velocities
        memories: dict[int, Memory] = {}
        for batch in self.batches:
            eq = batch.coarse.eq
            codes, firsts, _, origins, parameters = eq.forces
            rows = np.ascontiguousarray(np.moveaxis(parameters, -1, 0))
            scalars = np.zeros((batch.members.size, SCALARS))
            scalars[:, BEGAN] = began
            for m, i in enumerate(batch.members.tolist()):
                let_follow(x[i], self.dof, eq.followers, eq.behind[:, m])
                speed = x[i, self.dof + eq.read]
                scalars[m, :2] = x[i, eq.read] - eq.period * speed, speed
                internal = [
                    first_internal(code, across(x[i], 0, first, origin), p)
                    for code, first, origin, p in zip(codes, firsts, origins, rows[m], strict=True)
                ]
                memories[i] = Memory(
                    x[i], np.zeros(eq.whole_delay + 2), np.zeros(1),
                    np.array(internal, dtype=np.float64), scalars[m], np.zeros(2, dtype=np.int64),
                    np.zeros(0),
                )  # fmt: skip
        nothing = np.zeros(0)
        return tuple(
            memories.get(i)
            or Memory(x[i], nothing, nothing, nothing, nothing, np.zeros(2, np.int64), nothing)
            for i in range(self.size)
        )

    def let_follow(self, memories: Sequence[Memory]) -> None:
        """Set filtered readings to their values after a long motion, in place."""
        for batch in self.batches:
            eq = batch.coarse.eq
            for m, i in enumerate(batch.members.tolist()):
                let_follow(memories[i].x, self.dof, eq.followers, eq.behind[:, m])

    def follow(
        self,
        recorded: Recorded,
        starts: Sequence[Memory],
        readings: Readings,
        filters: Floats | None = None,
        skipped: int = 0,
        keep: bool = False,
        run_all: RunAll = lambda tasks: [task() for task in tasks],
    ) -> Followed:
        """Follow a recording from the states given.

        filters (o, o, order + 1), or (members, o, o, order + 1): filters that whiten the
        innovations, None for none; missing samples count as zero, the first `skipped` ticks not at
        all. keep: return the innovations. run_all: runs the tasks, one per group, in any order.
        """
        ticks, o = recorded.measured.shape
        plain = np.eye(o)[:, :, None] if filters is None else filters
        moments = np.full((self.size, o, o), np.inf)
        innovations = np.full((self.size, ticks if keep else 0, o), np.inf)
        memories = list(starts)

        def run(batch: _Batch, first: int) -> None:
            chosen = np.arange(first, min(first + WIDTH, batch.members.size))
            which = batch.members[chosen]
            coarse, fine = batch.groups(chosen)
            memory = in_lanes([starts[i] for i in which])
            judge = judge_of(
                _lanes(plain, which, 3), skipped, ticks if keep else 0, (WIDTH,),
                recorded.uncounted,
            )  # fmt: skip
            external = recorded.external
            reading = reading_of(readings, which, recorded, coarse.eq.states)
            with counted(which.size, ticks):
                predict(
                    coarse.eq, fine.eq, recorded.outputs, recorded.command,
                    np.zeros(0) if recorded.strengths is None else recorded.strengths,
                    recorded.measured, reading,
                    np.zeros((0, coarse.eq.dof)) if external is None else external,
                    memory, (coarse.scratch, fine.scratch), saved_room(coarse.eq, (WIDTH,)), judge,
                )  # fmt: skip
            for lane, i in enumerate(which):
                memories[i] = _alone(memory, lane)
                overflowed = memories[i].scalars[3] != 0.0
                moments[i] = np.inf if overflowed else judge.moments[..., lane]
                if keep:
                    innovations[i] = judge.kept[..., lane]

        tasks = [
            partial(run, batch, first)
            for batch in self.batches
            for first in range(0, batch.members.size, WIDTH)
        ]
        run_all(tasks)
        return Followed(moments, max(0, ticks - skipped), innovations, tuple(memories))

    def simulate(
        self,
        command: Floats,
        outputs: Outputs,
        starts: Sequence[Memory],
        external: Floats | None = None,
        run_all: RunAll = lambda tasks: [task() for task in tasks],
    ) -> tuple[Floats, tuple[Memory, ...]]:
        """Run freely under a command (ticks,): outputs (members, ticks, o), states at the end.

        starts: states from `start`, or from the end of an earlier call. A window of a recording is
        its part of the command, run from the states at the window's beginning. Outputs are infinite
        after an overflow.
        """
        o = outputs.state.size
        still = Recorded(command, np.zeros((command.size, o)), outputs, external)
        blind = Readings(np.zeros((self.states, o)))
        found = self.follow(still, starts, blind, keep=True, run_all=run_all)
        return -found.innovations, found.memories


@dataclass(frozen=True)
class _Batch:
    """Members of one structure, by their places in the population, in few and in many substeps."""

    members: NDArray[np.int64]
    coarse: Stack
    fine: Stack

    def groups(self, chosen: NDArray[np.int64]) -> tuple[Group, Group]:
        """Return members in few and in many substeps, the same where there are no more."""
        coarse = group(self.coarse, chosen)
        if self.fine is self.coarse:
            return coarse, coarse
        own, room = self.fine.eq, coarse.scratch.choice
        choice, now = lane_choice(room.a, room.b, room.every.shape[1])
        eq = coarse.eq._replace(
            substeps=own.substeps, durations=lanes_at(own.durations, chosen), propagators=now
        )
        return coarse, Group(eq, coarse.scratch._replace(choice=choice))


def _one_by_one(
    devices: Sequence[Device], few: int, many: int, seed: int
) -> tuple[Equations, list[Stacked]]:
    """Return devices laid out, and the equations of the first without propagators."""
    if not devices:
        raise ValueError("a population of no devices; give at least one")
    coarse = [member(d, few, seed) for d in devices]
    kinds = {m.kind for m in coarse}
    if len(kinds) > 1:
        raise ValueError(
            "members of a population differ in masses, effects or places; predict each kind by"
            " itself"
        )
    fine = coarse if many <= few else [member(d, many, seed) for d in devices]
    structures: dict[object, list[int]] = {}
    for i in (i for i, m in enumerate(fine) if m.complaint is None):
        structures.setdefault((coarse[i].structure, fine[i].structure), []).append(i)
    found: list[Stacked] = []
    for which in structures.values():
        few_of = stack([coarse[i] for i in which])
        many_of = few_of if fine is coarse else stack([fine[i] for i in which])
        found.append(Stacked(np.array(which), few_of, many_of))
    return coarse[0].eq, found


def _filled(which: NDArray[np.int64]) -> NDArray[np.int64]:
    return which[np.minimum(np.arange(WIDTH), which.size - 1)]


def _lanes(values: Floats, which: NDArray[np.int64], axes: int) -> Floats:
    """Return (..., WIDTH) of one array for all, with so many axes, or of one per member."""
    shared = values.ndim == axes
    rows = np.broadcast_to(values, (WIDTH, *values.shape)) if shared else values[_filled(which)]
    return np.ascontiguousarray(np.moveaxis(rows, 0, -1))


def reading_of(
    readings: Readings, which: NDArray[np.int64], recorded: Recorded, states: int
) -> Reading:
    """Return how up to `WIDTH` members read a recording, in lanes; ValueError for wrong shapes."""
    o = recorded.measured.shape[1]
    size = int(which.max()) + 1
    gains = np.ones(size) if readings.gains is None else readings.gains
    origins = np.zeros((size, o)) if readings.origins is None else readings.origins
    jitters = np.zeros((size, o)) if readings.jitters is None else readings.jitters
    lates = np.zeros((size, o)) if readings.lates is None else readings.lates
    arriving = np.zeros(0) if recorded.arriving is None else recorded.arriving
    observer = _lanes(readings.observers, which, 2)
    columns = STEADY if recorded.columns is None else recorded.columns
    rows, width = observer.shape[:2]
    fits = width >= 2 * (int(columns.max()) + o) if columns.size else width in (o, 2 * o)
    if rows != states or not fits:
        raise ValueError(
            f"observers have shape {readings.observers.shape}; ({states}, {o}) or"
            f" (members, {states}, {o}) is needed, or twice as wide with play"
        )
    return Reading(
        observer, columns, _lanes(gains[:, None], which, 1), _lanes(origins, which, 1),
        _lanes(jitters, which, 1), arriving, _lanes(lates + recorded.outputs.late, which, 1),
    )  # fmt: skip


FLOATING = ("x", "line", "controller", "internal", "scalars", "totals")


def in_lanes(memories: Sequence[Memory]) -> Memory:
    """Return up to `WIDTH` memories as one with a last axis of lanes, the last repeated."""
    filled = [*memories, *[memories[-1]] * (WIDTH - len(memories))]
    rows = {
        name: np.ascontiguousarray(np.stack([getattr(m, name) for m in filled], axis=-1))
        for name in FLOATING
    }
    return Memory(**rows, counters=memories[0].counters.copy())


def _alone(memory: Memory, lane: int) -> Memory:
    rows = {name: getattr(memory, name)[..., lane].copy() for name in FLOATING}
    return Memory(**rows, counters=memory.counters.copy())

"""Many runs of one device under its walls, prolonged as long as their verdicts need.

Linear mechanisms, also with Coulomb friction at m1, go 32 at a time through the lane kernel, all
others run one by one in the scalar kernel; both give the same measures a window. Groups are
independent tasks without shared state, so the result does not depend on the number of threads.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.controller import Controller
from zwidth.sim.equations import Equations
from zwidth.sim.kernel import Memory, advance, scratch
from zwidth.sim.lanes import (
    DAMPING,
    ESTIMATE,
    LANES,
    MEASURES,
    PAST1,
    PAST3,
    POSITION,
    READING,
    SIDED,
    STIFFNESS,
    LaneMemory,
    aligned,
    dense,
    lane_kernel,
    lane_memory,
    signal_row,
)
from zwidth.sim.physics.coulomb_friction import coulomb_friction
from zwidth.sim.run import Start, start_memory

Floats = NDArray[np.float64]
Task = Callable[[], None]
TOGETHER = 4  # scalar runs a task: work for a millisecond, and for every thread


@dataclass(frozen=True)
class Walls:
    """Built-in walls of an ensemble, one value a run (runs,): K, B, position, one-sided."""

    stiffness: Floats
    damping: Floats
    position: Floats
    one_sided: NDArray[np.bool_]

    def parameters(self) -> Floats:
        """Return the parameters of `controllers.wall`, shape (runs, 4)."""
        columns = [self.stiffness, self.damping, self.position, self.one_sided.astype(float)]
        return np.ascontiguousarray(np.column_stack(columns))

    def select(self, runs: NDArray[np.int64]) -> "Walls":
        """Return the walls of some runs."""
        return Walls(
            self.stiffness[runs], self.damping[runs], self.position[runs], self.one_sided[runs]
        )


def walls(
    stiffness: Floats | float,
    damping: Floats | float,
    position: float = 0.0,
    one_sided: bool = False,
) -> Walls:
    """Return walls over arrays of K and B that broadcast together, all at one position."""
    k, b = np.broadcast_arrays(np.atleast_1d(stiffness), np.atleast_1d(damping))
    k, b = k.astype(np.float64).ravel(), b.astype(np.float64).ravel()
    return Walls(k, b, np.full(k.size, position), np.full(k.size, one_sided))


@dataclass(frozen=True)
class LaneRuns:
    """State of an ensemble in the lane kernel: bank (rows, runs), line (d + 2, runs)."""

    eq: Equations
    bank: Floats
    line: Floats
    head: int

    @property
    def size(self) -> int:
        """Number of runs."""
        return self.bank.shape[1]

    def select(self, runs: NDArray[np.int64]) -> "LaneRuns":
        """Return some of the runs, in the state they are in."""
        return replace(self, bank=self.bank[:, runs], line=self.line[:, runs])

    def tasks(self, weights: Floats, windows: int) -> "tuple[Floats, list[Task], LaneRuns]":
        """Return (measures (windows, 7, runs), tasks that fill them, the state afterwards)."""
        measures = np.zeros((windows, MEASURES, self.size))
        after = replace(
            self,
            bank=np.empty_like(self.bank),
            line=np.empty_like(self.line),
            head=(self.head + windows * weights.size) % self.line.shape[0],
        )
        rows, dry = dense(self.eq), self.eq.frictions.codes.size > 0

        def run(first: int) -> None:
            count = min(LANES, self.size - first)
            chosen = np.minimum(np.arange(first, first + LANES), self.size - 1)
            memory = LaneMemory(aligned(self.bank[:, chosen]), aligned(self.line[:, chosen]))
            found = aligned(np.zeros(windows * MEASURES * LANES))
            kernel = lane_kernel(self.eq.states, self.eq.dof, dry)
            kernel(self.eq, rows, memory, self.head, weights, windows, found)
            mine = slice(first, first + count)
            measures[:, :, mine] = found.reshape(windows, MEASURES, LANES)[:, :, :count]
            after.bank[:, mine] = memory.bank.reshape(-1, LANES)[:, :count]
            after.line[:, mine] = memory.line.reshape(-1, LANES)[:, :count]

        return measures, [lambda f=f: run(f) for f in range(0, self.size, LANES)], after


@dataclass(frozen=True)
class ScalarRuns:
    """State of an ensemble in the scalar kernel: one memory and parameter row a run."""

    eq: Equations
    step: Any
    parameters: Floats
    memories: tuple[Memory, ...]
    past: Floats
    bound: float

    @property
    def size(self) -> int:
        """Number of runs."""
        return len(self.memories)

    def select(self, runs: NDArray[np.int64]) -> "ScalarRuns":
        """Return some of the runs, in the state they are in."""
        chosen = tuple(self.memories[i] for i in runs)
        return replace(
            self, parameters=self.parameters[runs], memories=chosen, past=self.past[runs]
        )

    def tasks(self, weights: Floats, windows: int) -> "tuple[Floats, list[Task], ScalarRuns]":
        """Return (measures (windows, 7, runs), tasks that fill them, the state afterwards)."""
        measures = np.zeros((windows, MEASURES, self.size))
        copies = tuple(memory_copy(m) for m in self.memories)
        after = replace(self, memories=copies, past=self.past.copy())

        def run(first: int, last: int) -> None:
            record = np.zeros((weights.size, self.eq.states + 6))
            fine, space = np.zeros((0, self.eq.states)), scratch(self.eq)
            external = np.zeros((0, self.eq.dof))
            for i in range(first, last):
                for window in range(windows):
                    record[:] = np.inf
                    advance(
                        self.eq, self.step, self.parameters[i], copies[i], space, weights.size,
                        external, self.bound, record, fine, False,
                    )  # fmt: skip
                    measures[window, :, i] = _measured(self.eq, record, weights, after.past[i])
                    if not abs(record[-1, 0]) <= self.bound:
                        measures[window:, :, i] = np.inf
                        break

        spans = [(f, min(f + TOGETHER, self.size)) for f in range(0, self.size, TOGETHER)]
        return measures, [lambda s=s: run(*s) for s in spans], after


Runs = LaneRuns | ScalarRuns


def memory_copy(memory: Memory) -> Memory:
    """Return a copy that goes on independently."""
    x, line, controller, internal, scalars, counters, totals = memory
    return Memory(
        x.copy(), line.copy(), controller.copy(), internal.copy(), scalars.copy(),
        counters.copy(), totals.copy(),
    )  # fmt: skip


def _measured(eq: Equations, record: Floats, weights: Floats, past: Floats) -> Floats:
    """Measures of one window from its record; past holds m1's three earlier velocities."""
    with np.errstate(all="ignore"):  # a run that escaped fills its rest with infinities
        speeds = record[:, eq.dof : 2 * eq.dof]
        series = np.concatenate([past, speeds[:, 0]])
        third = series[3:] - 3.0 * (series[2:-1] - series[1:-2]) - series[:-3]
        past[:] = series[-3:]
        kinetic = (0.5 * eq.masses * speeds * speeds).sum(axis=1)
        low, high = record[:, 0].min(), record[:, 0].max()
        command = record[:, eq.states + 2]
        reversals = float(np.count_nonzero(series[3:] * series[2:-1] < 0.0))
        return np.array(
            [
                weights @ kinetic, weights @ (third * third), low, high,
                command.min(), command.max(), reversals,
            ]
        )  # fmt: skip


def fits_lanes(eq: Equations) -> bool:
    """Whether the lane kernel serves this device: its interface, and Coulomb friction at m1."""
    if any(t.codes.size for t in (eq.forces, eq.sensors, eq.amplifiers, eq.clocks)):
        return False
    dry = list(zip(eq.frictions.codes, eq.frictions.first, strict=True))
    return dry in ([], [(coulomb_friction.code, 0)])


def start_runs(
    eq: Equations, wall_controller: Controller, ensemble: Walls, starts: Sequence[Start],
    bound: float = 1e300,
) -> Runs:  # fmt: skip
    """Return the runs of a device at t = 0, one start a run (or one for all).

    eq: from `sim.equations.equations`. wall_controller: `controllers.wall.wall(...)`, whose law the
    walls parametrise. bound: a scalar run stops when |position of m1| exceeds it.
    """
    count = ensemble.stiffness.size
    memories = [start_memory(eq, wall_controller, start, 0) for start in starts]
    if fits_lanes(eq):
        return _in_lanes(eq, ensemble, memories)
    each = memories * count if len(memories) == 1 else memories
    past = np.array([[m.x[eq.dof]] * 3 for m in each])
    parameters = ensemble.parameters()
    return ScalarRuns(eq, wall_controller.step, parameters, tuple(each), past, bound)


def _in_lanes(eq: Equations, ensemble: Walls, memories: Sequence[Memory]) -> LaneRuns:
    n, count = eq.states, ensemble.stiffness.size
    width = lane_memory(eq, 1)
    bank = np.zeros((width.bank.size, count))
    bank[:n] = np.array([m.x[:n] for m in memories]).T
    bank[signal_row(n, READING)] = [m.scalars[0] for m in memories]
    bank[signal_row(n, ESTIMATE)] = [m.scalars[1] for m in memories]
    bank[signal_row(n, PAST1) : signal_row(n, PAST3) + 1] = bank[eq.dof]
    rows = (STIFFNESS, DAMPING, POSITION, SIDED)
    for row, values in zip(rows, ensemble.parameters().T, strict=True):
        bank[signal_row(n, row)] = values
    return LaneRuns(eq, bank, np.zeros((width.line.size, count)), 0)


def one_by_one(tasks: Sequence[Task]) -> None:
    """Run tasks in turn."""
    for task in tasks:
        task()


def advance_runs(
    runs: Runs,
    weights: Floats,
    windows: int,
    run_all: Callable[[Sequence[Task]], object] = one_by_one,
) -> tuple[Floats, Runs]:
    """Run an ensemble for `windows` windows; return (measures (windows, 7, runs), state).

    run_all: runs the tasks, in any order or side by side, as on threads of the caller's.
    """
    measures, tasks, after = runs.tasks(weights, windows)
    run_all(tasks)
    return measures, after

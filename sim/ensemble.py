"""Many runs of devices under walls, prolonged until their verdicts are clear.

Runs are computed `WIDTH` at a time in the lanes of the kernel (`sim/windows.py`), whatever physics
the devices have; each has the same result as alone. Groups are independent tasks without shared
state, so the result does not depend on the number of threads.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.group import Group, Member, Stack, group, stack
from zwidth.sim.lane_type import WIDTH
from zwidth.sim.law import Law
from zwidth.sim.run import Start, start_memory
from zwidth.sim.wall_law import MEMORY
from zwidth.sim.windows import MEASURES, Bank, Kept, run_windows

Floats = NDArray[np.float64]
Task = Callable[[], None]
PIECES = 4  # tasks per thread for the runs of one device, so that no thread waits long
ROWS = (
    "x",
    "line",
    "internal",
    "scalars",
    "walls",
    "past",
    "bounds",
    "escaped",
    "controller",
)  # last axis: runs


@dataclass(frozen=True)
class Walls:
    """Built-in walls of an ensemble, one value per run (runs,): K, B, position, one-sided.

    law: the law of all of them.
    """

    stiffness: Floats
    damping: Floats
    position: Floats
    one_sided: NDArray[np.bool_]
    law: Law = field(default_factory=Law)

    def parameters(self) -> Floats:
        """Return the numbers of `sim/wall_law.py`, shape (runs, 6)."""
        columns = [self.stiffness, self.damping, self.position, self.one_sided.astype(float)]
        columns += [np.full(self.stiffness.size, number) for number in self.law.numbers]
        return np.ascontiguousarray(np.column_stack(columns))

    def select(self, runs: NDArray[np.int64]) -> "Walls":
        """Return the walls of some runs."""
        return Walls(
            self.stiffness[runs], self.damping[runs], self.position[runs], self.one_sided[runs],
            self.law,
        )  # fmt: skip


def walls(
    stiffness: Floats | float,
    damping: Floats | float,
    position: float = 0.0,
    one_sided: bool = False,
    law: Law | None = None,
) -> Walls:
    """Return walls over arrays of K and B that broadcast together, all at one position.

    law: the law of all of them, by default that of spring and damper.
    """
    k, b = np.broadcast_arrays(np.atleast_1d(stiffness), np.atleast_1d(damping))
    k, b = k.astype(np.float64).ravel(), b.astype(np.float64).ravel()
    sides = np.full(k.size, one_sided)
    return Walls(k, b, np.full(k.size, position), sides, law or Law())


@dataclass(frozen=True)
class Runs:
    """An ensemble with its present state.

    members: the devices. device (runs,): index of each run's device. bank: states whose last axis
    counts the runs.
    """

    members: Stack
    device: NDArray[np.int64]
    bank: Bank

    @property
    def size(self) -> int:
        """Number of runs."""
        return self.device.size

    def select(self, runs: NDArray[np.int64]) -> "Runs":
        """Return some of the runs, in their present state."""
        some = {name: getattr(self.bank, name)[..., runs] for name in ROWS}
        return replace(self, device=self.device[runs], bank=self.bank._replace(**some))

    def tasks(
        self, weights: Floats, windows: int, keep: bool = False, workers: int = 1
    ) -> "tuple[Floats, Floats, list[Task], Runs]":
        """Return (measures, velocities, tasks for the workers that fill them, final state).

        measures (windows, 7, runs); velocities (runs, ticks) of m1 if they are to be kept, NaN
        after a run has escaped, else (runs, 0).
        """
        ticks = windows * weights.size
        measures = np.zeros((windows, MEASURES, self.size))
        velocities = np.zeros((self.size, ticks if keep else 0))
        state = {name: np.empty_like(getattr(self.bank, name)) for name in ROWS}
        tick, head = self.bank.counters
        counters = np.array([tick + ticks, (head + ticks) % self.bank.line.shape[0]])
        after = replace(self, bank=self.bank._replace(**state, counters=counters))

        def run(first: int, last: int) -> None:
            runs = np.arange(first, last)
            filled = runs[np.minimum(np.arange(-(-runs.size // WIDTH) * WIDTH), runs.size - 1)]
            some = {name: _grouped(getattr(self.bank, name), filled) for name in ROWS}
            bank = self.bank._replace(**some, counters=self.bank.counters.copy())
            groups = bank.escaped.shape[0]
            kept = Kept(
                np.zeros((windows, MEASURES, groups, WIDTH)),
                np.zeros((velocities.shape[1], groups, WIDTH)),
            )
            own = self._group_of(runs)
            run_windows(own.eq, own.scratch, bank, weights, kept)
            every = groups * WIDTH
            found = kept.measures.reshape(windows, MEASURES, every)
            measures[:, :, runs] = found[:, :, : runs.size]
            speeds = kept.velocities.reshape(velocities.shape[1], every)
            velocities[runs] = speeds[:, : runs.size].T
            for name in ROWS:
                getattr(after.bank, name)[..., runs] = _runs_of(getattr(bank, name))[
                    ..., : runs.size
                ]

        return measures, velocities, [lambda s=s: run(*s) for s in self._spans(workers)], after

    def _spans(self, workers: int) -> list[tuple[int, int]]:
        """Cut the runs into tasks: of one device several groups, of several devices one each."""
        groups = -(-self.size // WIDTH)
        pieces = 1 if workers == 1 else PIECES * workers
        wide = -(-groups // pieces) if self.members.size == 1 else 1
        step = wide * WIDTH
        return [(f, min(f + step, self.size)) for f in range(0, self.size, step)]

    def _group_of(self, runs: NDArray[np.int64]) -> Group:
        return group(self.members, self.device[runs[:WIDTH]])


def _grouped(values: Floats, runs: NDArray[np.int64]) -> Floats:
    """Return (groups, ..., WIDTH) of values (..., runs)."""
    shape, groups = values.shape[:-1], runs.size // WIDTH
    rows = values[..., runs].reshape(math.prod(shape), groups, WIDTH)
    return np.ascontiguousarray(rows.swapaxes(0, 1)).reshape(groups, *shape, WIDTH)


def _runs_of(values: Floats) -> Floats:
    """Return (..., runs) of values (groups, ..., WIDTH)."""
    groups, shape = values.shape[0], values.shape[1:-1]
    rows = values.reshape(groups, math.prod(shape), WIDTH).swapaxes(0, 1)
    return rows.reshape(*shape, groups * WIDTH)


def start_runs(
    devices: Sequence[Member],
    device: NDArray[np.int64],
    ensemble: Walls,
    starts: Sequence[Start],
    bounds: Floats | float = np.inf,
) -> Runs:
    """Return the runs at t = 0, with one start per run (or one for all).

    devices: of one structure (`sim.group.member`); device (runs,): the index of each run's device,
    (1,) for the same in all. bounds (runs,) or one for all: a run has escaped when |position of m1|
    exceeds it. Raises ValueError for devices of several structures.
    """
    count = ensemble.stiffness.size
    which = np.broadcast_to(device, count).astype(np.int64)
    each = list(starts) * count if len(starts) == 1 else list(starts)
    keys = [(d, id(s)) for d, s in zip(which.tolist(), each, strict=True)]
    different = dict(zip(keys, each, strict=True))
    place = {key: i for i, key in enumerate(different)}
    memories = [start_memory(devices[d].eq, start) for (d, _), start in different.items()]
    own = np.array([place[key] for key in keys], dtype=np.int64)

    def each_own(rows: Iterable[Floats]) -> Floats:
        return np.stack(list(rows), axis=-1)[..., own]

    n = devices[0].eq.dof
    bank = Bank(
        *(each_own(getattr(m, name) for m in memories) for name in ROWS[:4]),
        walls=ensemble.parameters().T.copy(),
        past=each_own(np.full(3, m.x[n]) for m in memories),
        bounds=np.broadcast_to(bounds, count).astype(np.float64),
        escaped=np.zeros(count),
        controller=np.zeros((MEMORY, count)),
        counters=np.zeros(2, dtype=np.int64),
        law=ensemble.law.code,
    )
    return Runs(stack(devices), which, bank)


def one_by_one(tasks: Sequence[Task]) -> None:
    """Run tasks in turn."""
    for task in tasks:
        task()


def advance_runs(
    runs: Runs,
    weights: Floats,
    windows: int,
    run_all: Callable[[Sequence[Task]], object] = one_by_one,
    workers: int = 1,
) -> tuple[Floats, Runs]:
    """Run an ensemble for `windows` windows; return (measures (windows, 7, runs), state).

    run_all: runs the tasks, in any order or in parallel, such as on the caller's threads.
    """
    measures, _, tasks, after = runs.tasks(weights, windows, workers=workers)
    run_all(tasks)
    return measures, after

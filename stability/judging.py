"""How walls are judged: many runs at once, each prolonged until its verdict is clear."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from dataclasses import field as with_default
from functools import partial

import numpy as np
from numpy.typing import NDArray

from zwidth.jobs.parallel import in_parallel, threads
from zwidth.scenarios.scenario import usual_substeps
from zwidth.shown import Valued
from zwidth.sim.device import Device
from zwidth.sim.ensemble import Runs, Walls, advance_runs, start_runs
from zwidth.sim.fate import rest_amplitude
from zwidth.sim.group import Member, member
from zwidth.sim.growth import ESCAPE, UNDECIDED, Growth, assess, window_weights
from zwidth.sim.law import Law
from zwidth.sim.perception import Perception
from zwidth.sim.run import Start
from zwidth.sim.windows import MEASURES

Floats = NDArray[np.float64]
STARTS = (
    1e-3,
    1e-4,
)  # [rad | m]; the smaller start finds cycles of play and steps near rest


@dataclass(frozen=True)
class Trial(Valued):
    """How a single (K, B) is judged.

    start: amplitude of the start, all masses displaced by it at rest [rad | m]; with friction the
    boundary depends on it. others: further starts for a boundary; a wall then counts as stable only
    if it is stable from every start. Maps and linear devices do not use these. seconds: length of
    the first run; limit_s: of the longest; window_s: of the energy windows. threshold: largest
    amplitude of a limit cycle that counts as rest; a larger one never counts as dither (None: the
    rules of `sim/fate.py`). substeps: per tick, for devices that need them. law: of the walls.
    perception: the size above which an oscillation is felt.

    Raises ValueError with field, value and what is allowed.
    """

    start: float = 1e-3
    seconds: float = 4.0
    limit_s: float = 64.0
    window_s: float = 0.5
    threshold: float | None = None
    substeps: int = 1
    law: Law = with_default(default_factory=Law)
    perception: Perception = with_default(default_factory=Perception)
    others: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for start in self.starts:
            if not 0.0 < abs(start) < math.inf:
                raise ValueError(f"start is {start}; an amplitude other than 0 is needed")
        if not 0.0 < self.window_s * 6.0 <= self.seconds <= self.limit_s < math.inf:
            raise ValueError(
                f"seconds is {self.seconds}; it must be at least six windows ({6.0 * self.window_s}"
                f" s) and at most limit_s ({self.limit_s} s)"
            )

    @property
    def starts(self) -> tuple[float, ...]:
        """All start amplitudes, without repeats."""
        return tuple(dict.fromkeys((self.start, *self.others)))


def usual_trial(device: Device) -> Trial:
    """Return the default trial of a boundary."""
    return Trial(STARTS[0], others=STARTS, substeps=usual_substeps(device))


def judge(
    device: Device, ensemble: Walls, trial: Trial = Trial(), workers: int | None = None
) -> Growth:
    """Run every wall of a device until its verdict is clear or the time limit is reached."""
    count = ensemble.stiffness.size
    starts, rests = np.full(count, trial.start), np.full(count, threshold(device, trial))
    return judge_each([device], np.zeros(count, np.int64), ensemble, starts, rests, trial, workers)


def judge_each(
    devices: Sequence[Device],
    which: NDArray[np.int64],
    ensemble: Walls,
    starts: Floats,
    rests: Floats,
    trial: Trial,
    workers: int | None = None,
) -> Growth:
    """Run walls of several devices; which, starts, rests (runs,): device, start, rest amplitude.

    Devices of one structure are computed together, whatever their parameters. Raises ValueError for
    too few substeps.
    """
    each = [prepared(device, trial.substeps) for device in devices]
    kinds: dict[object, list[int]] = {}
    for i, (one, device) in enumerate(zip(each, devices, strict=True)):
        kinds.setdefault((one.structure, nonlinear_walls(device)), []).append(i)
    groups = [np.flatnonzero(np.isin(which, some)) for some in kinds.values()]
    workers = workers or threads()
    inner = 1 if len(groups) >= workers else workers
    growth = Growth(np.full(which.size, UNDECIDED), *np.full((6, which.size), np.nan))

    def run(some: list[int], runs: NDArray[np.int64]) -> None:
        place = {device: k for k, device in enumerate(some)}
        own = np.array([place[i] for i in which[runs].tolist()], dtype=np.int64)
        subjects = Subjects(
            [each[i] for i in some],
            own,
            starts[runs],
            rests[runs],
            nonlinear_walls(devices[some[0]]),
        )
        found = judge_subjects(subjects, ensemble.select(runs), trial, inner)
        for field in fields(Growth):
            getattr(growth, field.name)[runs] = getattr(found, field.name)

    tasks = [partial(run, s, r) for s, r in zip(kinds.values(), groups, strict=True) if r.size]
    in_parallel(tasks, workers)
    return growth


def prepared(device: Device, substeps: int) -> Member:
    """Return a device prepared for an ensemble; raises ValueError for too few substeps."""
    one = member(device, substeps)
    if one.complaint is not None:
        raise ValueError(one.complaint)
    return one


def nonlinear_walls(device: Device) -> bool:
    """Whether limit cycles are possible under a two-sided wall."""
    forces = any(p.effect.hook != "structure" for p in device.physics)
    return forces or not device.interface.linear


@dataclass(frozen=True)
class Subjects:
    """The runs to judge: devices of one structure and, per run, its device, start and rest.

    which (runs,): index into members; starts (runs,): amplitude at t = 0; rests (runs,): amplitude
    up to which a limit cycle counts as rest.
    """

    members: Sequence[Member]
    which: NDArray[np.int64]
    starts: Floats
    rests: Floats
    nonlinear: bool

    def started(self, ensemble: Walls) -> Runs:
        """Return the runs at t = 0."""
        different = {a: Start(a) for a in self.starts.tolist()}
        starts = [different[a] for a in self.starts.tolist()]
        bounds = ESCAPE * np.abs(self.starts)
        return start_runs(self.members, self.which, ensemble, starts, bounds)


def judge_subjects(subjects: Subjects, ensemble: Walls, trial: Trial, workers: int) -> Growth:
    """Run each wall until its verdict is clear or the time limit is reached."""
    return judge_for(subjects, ensemble, trial, workers)[0]


def judge_for(
    subjects: Subjects, ensemble: Walls, trial: Trial, workers: int
) -> tuple[Growth, Floats]:
    """Judge as `judge_subjects` does; return also how long each run took [s], (runs,)."""
    runs = subjects.started(ensemble)
    period = subjects.members[0].eq.period
    weights = window_weights(max(8, round(trial.window_s / period)))
    window = weights.size * period
    starts, rests = np.abs(subjects.starts), subjects.rests
    nonlinear = subjects.nonlinear or bool(ensemble.one_sided.any()) or not ensemble.law.linear
    judged = Growth(np.full(runs.size, UNDECIDED), *np.full((6, runs.size), np.nan))
    pending, history = np.arange(runs.size), np.zeros((0, MEASURES, runs.size))
    together = partial(in_parallel, workers=workers)
    done, target = 0.0, trial.seconds
    took = np.zeros(runs.size)
    while True:
        measures, runs = advance_runs(
            runs, weights, round((target - done) / window), together, workers
        )
        history = np.concatenate([history, measures])
        final = target >= trial.limit_s
        growth = assess(history, window, starts[pending], rests[pending], nonlinear, final)
        for field in fields(Growth):
            getattr(judged, field.name)[pending] = getattr(growth, field.name)
        took[pending] = target
        left = np.flatnonzero(growth.verdict == UNDECIDED)
        if left.size == 0 or target >= trial.limit_s:
            return judged, took
        pending, runs, history = pending[left], runs.select(left), history[:, :, left]
        done, target = target, min(2.0 * target, trial.limit_s)


def threshold(device: Device, trial: Trial) -> float:
    """Return the largest amplitude of a limit cycle that counts as rest."""
    return rest_amplitude(device, trial.start) if trial.threshold is None else trial.threshold

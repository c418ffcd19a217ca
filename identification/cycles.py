"""The limit cycles that a relay loop reaches from many starts, and the share of starts for each.

A relay loop may have several limit cycles; the published procedure reports the one that its single
start leads to.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from zwidth.identification.relay import (
    STANDARD,
    RelayResult,
    RelayTest,
    RelayVerdict,
    reference_start,
    run,
)
from zwidth.jobs.parallel import in_parallel, threads
from zwidth.shown import Shown, Valued
from zwidth.sim.device import Device
from zwidth.sim.equations import equations
from zwidth.sim.run import Start

SAME_CYCLE = 5e-3  # relative difference of stiffness and frequency within a cycle
POSITION, VELOCITY = 5e-3, 0.5  # half ranges of the random starts


@dataclass(frozen=True)
class Cycle(Valued):
    """One limit cycle and the share of the starts that ended on it.

    start: position and velocity of a start that led to it, None if that is not stored.
    """

    stiffness: float
    frequency_hz: float
    amplitude: float
    share: float
    start: tuple[float, float] | None = None


@dataclass(frozen=True)
class RelayCondition(Valued):
    """One condition (delay [s], B): the run from the reference start, and results of other starts.

    diverging, undecided: shares of the other starts that diverge, or stay undecided.
    """

    delay: float
    damping: float
    reference: RelayResult
    cycles: tuple[Cycle, ...]
    diverging: float
    undecided: float

    @property
    def likeliest(self) -> Cycle | None:
        """The cycle that most starts reach; None if more diverge or stay undecided, or none ran."""
        if not self.cycles or self.cycles[0].share < max(self.diverging, self.undecided):
            return None
        return self.cycles[0]

    @property
    def verdict(self) -> RelayVerdict:
        """The outcome of most starts, or of the reference start if no others were run."""
        if self.likeliest is not None:
            return "oscillates"
        if not self.cycles and not self.diverging and not self.undecided:
            return self.reference.verdict
        return "diverges" if self.diverging >= self.undecided else "undecided"

    @property
    def read(self) -> Cycle | None:
        """The limit cycle reported: the one that most starts reach; None if none is.

        None also if more starts diverge or stay undecided. If no other starts were run: the cycle
        of the reference start with a share of 0, or None if that run does not oscillate.
        """
        if self.verdict != "oscillates" or self.likeliest is not None:
            return self.likeliest
        r = self.reference
        if r.stiffness is None or r.frequency_hz is None or r.amplitude is None:
            return None
        return Cycle(r.stiffness, r.frequency_hz, r.amplitude, 0.0)


@dataclass(frozen=True, repr=False)
class RelayReadings(Shown):
    """The relay readings of a device, one `RelayCondition` per damping."""

    device: Device
    test: RelayTest
    conditions: tuple[RelayCondition, ...]


def limit_cycles(
    device: Device,
    damping: float,
    starts: int = 60,
    seed: int = 0,
    test: RelayTest = STANDARD,
) -> RelayCondition:
    """Run the reference start and seeded random starts, and return the limit cycles reached.

    The random starts displace and move the device as a rigid body: position uniform within +-5e-3
    [rad | m], velocity within +-0.5 [rad/s | m/s].
    """
    return relay_conditions([device], [damping], starts, seed, test)[0]


def relay_conditions(
    devices: Sequence[Device],
    dampings: Sequence[float],
    starts: int = 60,
    seed: int = 0,
    test: RelayTest = STANDARD,
    progress: Callable[[], None] | None = None,
) -> list[RelayCondition]:
    """Return `limit_cycles` for each device with its damping, all runs spread over the cores.

    progress: called after each condition (from any thread). Raises ValueError for starts < 0.
    """
    if starts < 0:
        raise ValueError(f"starts is {starts}; it must be 0 or more")
    tasks = [
        lambda device=device, damping=damping: _condition(
            device, damping, starts, seed, test, progress
        )
        for device, damping in zip(devices, dampings, strict=True)
    ]
    return in_parallel(tasks, threads())


def _condition(
    device: Device,
    damping: float,
    starts: int,
    seed: int,
    test: RelayTest,
    progress: Callable[[], None] | None,
) -> RelayCondition:
    eq = equations(device, test.substeps)
    rng = np.random.default_rng(seed)
    drawn = rng.uniform(-1.0, 1.0, (starts, 2)) * (POSITION, VELOCITY)
    results = [run(eq, damping, Start(float(x), float(v)), test) for x, v in drawn]
    verdicts = [result.verdict for result in results]
    reference = run(eq, damping, reference_start(device), test)
    if progress is not None:
        progress()
    count = max(1, starts)
    return RelayCondition(
        device.interface.delay,
        damping,
        reference,
        gathered(results, drawn.tolist()),
        verdicts.count("diverges") / count,
        verdicts.count("undecided") / count,
    )


def gathered(
    results: Sequence[RelayResult], starts: Sequence[tuple[float, float]] = ()
) -> tuple[Cycle, ...]:
    """Return the limit cycles of results, the most frequent first; starts: of each result.

    Results are sorted by stiffness and belong to one cycle as long as stiffness and frequency stay
    within half a percent of those of its first result.
    """
    found = [
        (r.stiffness, r.frequency_hz, r.amplitude, i)
        for i, r in enumerate(results)
        if r.stiffness is not None and r.frequency_hz is not None and r.amplitude is not None
    ]
    groups: list[list[tuple[float, float, float, int]]] = []
    for one in sorted(found):
        if groups and _alike(groups[-1][0], one):
            groups[-1].append(one)
        else:
            groups.append([one])
    groups.sort(key=len, reverse=True)
    cycles: list[Cycle] = []
    for group in groups:
        stiffness, frequency, amplitude, _ = np.mean(group, axis=0).tolist()
        position, velocity = starts[group[0][-1]] if starts else (0.0, 0.0)
        start = (position, velocity) if starts else None
        cycles.append(Cycle(stiffness, frequency, amplitude, len(group) / len(results), start))
    return tuple(cycles)


def _alike(a: Sequence[float], b: Sequence[float]) -> bool:
    return all(abs(a[i] / b[i] - 1.0) < SAME_CYCLE for i in range(2))

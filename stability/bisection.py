"""The stability boundary in the time domain: for each B, K is bisected; many B run at once.

K rises from near zero in steps of a constant ratio; the first K that is not stable closes the
bracket. Then the zero of the growth rate is interpolated, or, if that does not help, the geometric
mean of the ends is tried, until the bracket is narrow enough. All dampings of a group are tried in
the same round, as one batch. A run is prolonged, twice as long each time, until its verdict is
clear or the limit is reached; a K that stays undecided is left between the ends of its bracket. A
wall is stable unless its oscillation grows, as in `sim/fate.py`; linear theory is used only to
bound the dither of a quantiser.

A wall is stable only if it is stable from all starts of the trial. On a nonlinear device a wall may
grow although a stiffer one does not: with play, oscillations exist in bands of K. So the fractions
`BELOW` of each closed bracket's K are tried too, and if one of them grows, the boundary is sought
below it.

The boundary of a linear device changes little from one damping to the next. So only every
`LEADING`-th damping of a group is scanned from near zero; the others begin one ratio below the
lower of the two nearest brackets, and start again near zero if that K is not stable.

Limit: a band of instability narrower than the scan's ratio can be stepped over (on a nonlinear
device: one narrower than the gaps between the fractions `BELOW`). On a linear device a band can
also be missed if it lies below the boundary and ends between two leading dampings.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from zwidth.jobs.parallel import in_parallel, threads
from zwidth.shown import Valued
from zwidth.sim.device import Device
from zwidth.sim.ensemble import walls
from zwidth.sim.fate import Conditions, Dither, Fate, dither_of, fates_of
from zwidth.sim.group import Member
from zwidth.sim.growth import DECAYS, GROWS, LIMIT_CYCLE, UNDECIDED, VERDICTS, Growth, Verdict
from zwidth.stability.frequency import largest_frequencies, ultimate_frequencies
from zwidth.stability.judging import (
    Subjects,
    Trial,
    judge_for,
    nonlinear_walls,
    prepared,
    threshold,
)

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]
GROUP = 128  # dampings bisected together, a multiple of the kernel's lanes
LEADING = 4
SETTLED = ("friction", "structure")  # hooks of physics that adds no energy or bands
BELOW = np.array([0.98, 0.95, 0.9, 0.8, 0.65, 0.5])  # of a closed bracket's K: also tried
LOOKS = 3  # most times that BELOW is tried


@dataclass(frozen=True)
class Search(Valued):
    """How far and how finely K is searched.

    tolerance: width of a bracket over its K. lowest, highest: K [N m/rad | N/m]; None stands for
    1e-6 and 1 times 4 m / T^2, above which no sampled wall is stable with the whole mass m. ratio:
    factor between two successive K of the scan. felt: the boundary is where a wall's oscillation
    begins to be felt (`sim/perception.py`), not where it begins to grow.
    """

    tolerance: float = 5e-4
    lowest: float | None = None
    highest: float | None = None
    ratio: float = 2.0
    felt: bool = False

    def __post_init__(self) -> None:
        if not 0.0 < self.tolerance < 1.0:
            raise ValueError(f"tolerance is {self.tolerance}; it must be above 0 and below 1")
        if not self.ratio > 1.0:
            raise ValueError(f"ratio is {self.ratio}; the scan goes up, so it must be > 1")

    def limits(self, device: Device) -> tuple[float, float]:
        """Return (lowest, highest) K for a device; raises ValueError if they are reversed."""
        scale = 4.0 * float(device.chain.masses.sum()) / device.interface.period**2
        lowest = 1e-6 * scale if self.lowest is None else self.lowest
        highest = scale if self.highest is None else self.highest
        if not 0.0 < lowest < highest < math.inf:
            raise ValueError(
                f"K goes from {lowest:g} to {highest:g}; it must start above 0 and rise"
            )
        return lowest, highest


@dataclass(frozen=True)
class Bracket(Valued):
    """The boundary at one damping: stable below, unstable above.

    stable, unstable: K [N m/rad | N/m]; stable is None if the lowest K tried is already unstable,
    unstable is None if the highest is still stable. Each end has a verdict: dither caused by
    quantisation counts as decay, growth that the amplifier's limit stops counts as a limit cycle.
    amplitude and frequency [Hz] are of the run at the unstable end. undecided: (lowest, highest) K
    between the ends that stayed undecided up to the time limit, if any. grows_from: the starts
    [rad | m] from which the unstable end grows; empty if it grows from all that were tried.
    """

    damping: float
    stable: float | None
    unstable: float | None
    stable_verdict: Verdict | None = None
    unstable_verdict: Verdict | None = None
    unstable_amplitude: float | None = None
    frequency: float | None = None
    undecided: tuple[float, float] | None = None
    grows_from: tuple[float, ...] = ()

    @property
    def reason(self) -> str:
        """Why there is no stable K, in words; empty if there is one."""
        if self.stable is not None:
            return ""
        if self.undecided is not None:
            low, high = self.undecided
            above = "" if self.unstable is None else ", and grows above"
            doubt = f"neither settles nor grows for K = {low:.3g} to {high:.3g} in the time allowed"
            return doubt + above
        if self.unstable is None:
            return "no wall was tried"
        does = "cycles on" if self.unstable_verdict is Verdict.LIMIT_CYCLE else "grows"
        return f"the softest wall tried, K = {self.unstable:.3g}, {does} already"


class _Hunt:
    """The brackets of one device while they close; NaN: not known yet."""

    def __init__(
        self, device: Device, one: Member, dampings: Floats, trial: Trial, search: Search
    ) -> None:
        self.device, self.dampings, self.search = device, dampings, search
        self.one, self.trial = one, trial
        self.lowest, self.highest = search.limits(device)
        self.nonlinear = nonlinear_walls(device) or not trial.law.linear
        self.starts = np.array(trial.starts if self.nonlinear else (trial.start,))
        shape = self.open = dampings.size
        self.stable, self.unstable, self.doubt_low, self.doubt_high = np.full((4, shape), np.nan)
        self.verdicts = np.full((2, shape), -1)
        self.rates = np.full((2, shape), np.nan)  # at the stable and unstable ends
        self.widths = np.full((4, shape), np.inf)  # of the bracket: now, one to three trials ago
        self.amplitude, self.seconds = np.full((2, shape), np.nan)  # of the unstable end's run
        self.grows = np.zeros((self.starts.size, shape), dtype=bool)  # starts of the unstable end
        self.good: list[list[float]] = [[] for _ in range(shape)]  # every K that was stable
        self.looks = np.full(shape, LOOKS if self.nonlinear else 0)
        self.first = np.full(shape, self.lowest)  # K at which the scan begins
        self.order = np.argsort(dampings, kind="stable")
        self.waiting = np.zeros(shape, dtype=bool)  # until the leading dampings are done
        if not self.nonlinear and shape > 2:
            self.waiting[self.order] = True
            self.waiting[self.order[[*range(0, shape, LEADING), -1]]] = False

    def run(self, trial: Trial, workers: int, closed: Callable[[], None]) -> list[Bracket]:
        """Try until every bracket is closed."""
        while True:
            tried = self.trials()
            active = np.flatnonzero(~np.isnan(tried))
            self.open = active.size + np.count_nonzero(self.waiting)
            closed()
            if active.size:
                self.learn(active, tried[active], *self.judged(active, tried[active], workers))
            elif self.waiting.any():
                self.follow()
            elif not self.look_below(workers):
                return self.brackets(self.frequencies(trial, workers))

    def judged(self, runs: Indices, tried: Floats, workers: int) -> tuple[Growth, Flags, Floats]:
        """Judge one K per damping: return the worst verdict, the starts that grow and the duration.

        runs, tried (n,). Stable walls count as decay, growth that settles as a cycle. The starts
        that grow are flags (starts, n). The duration [s], (n,), is that of the run from the first
        start that grows.
        """
        count = self.starts.size
        each, k = np.tile(runs, count), np.tile(tried, count)
        starts = np.repeat(self.starts, runs.size)
        dither = self.dither(each, k)
        rests = self.rests(each, k, np.where(dither.holds, dither.steps, 0.0))
        some = walls(k, self.dampings[each], law=self.trial.law)
        growth, took = judge_for(self.subjects(rests, starts), some, self.trial, workers)
        which = np.zeros(each.size, dtype=np.int64)
        conditions = Conditions(
            [self.device], which, k, self.dampings[each], starts, rests, dither=dither
        )
        fate = fates_of(growth, conditions, self.trial.limit_s, self.trial.perception)
        grows = (fate == Fate.GROWS) | (self.search.felt & (fate == Fate.FELT))
        doubt = (fate == Fate.UNDECIDED) & (growth.verdict != DECAYS)  # falling is stable
        verdict = np.where(grows & (growth.verdict != GROWS), LIMIT_CYCLE, growth.verdict)
        verdict = np.where(grows | doubt, np.where(doubt, UNDECIDED, verdict), DECAYS)
        # The worst start: one that grows, else an undecided one, else the one that decays most
        # slowly.
        rate = np.clip(np.nan_to_num(growth.rate), -1e9, 1e9)
        badness = (1e10 * (2.0 * grows + doubt) + rate).reshape(count, runs.size)
        worst = badness.argmax(axis=0) * runs.size + np.arange(runs.size)
        growth, grows = replace(growth, verdict=verdict), grows.reshape(count, runs.size)
        first = grows.argmax(axis=0), np.arange(runs.size)
        return growth.select(worst), grows, took.reshape(count, runs.size)[first]

    def look_below(self, workers: int) -> bool:
        """Try walls below the closed brackets; return True if any grows (the boundary is lower)."""
        some = np.flatnonzero((self.looks > 0) & ~np.isnan(self.stable))
        if some.size == 0:
            return False
        self.looks[some] -= 1
        runs, k = np.repeat(some, BELOW.size), np.outer(self.stable[some], BELOW).ravel()
        there = k > self.lowest
        runs, k = runs[there], k[there]
        if runs.size == 0:
            return False
        growth, grows, took = self.judged(runs, k, workers)
        bad = (growth.verdict == LIMIT_CYCLE) | (growth.verdict == GROWS)
        for i in some.tolist():
            here = np.flatnonzero((runs == i) & bad)
            self.good[i] += k[(runs == i) & (growth.verdict == DECAYS)].tolist()
            if here.size == 0:
                self.looks[i] = 0
                continue
            place = here[k[here].argmin()]
            self.good[i] = [value for value in self.good[i] if value < k[place]]
            self.stable[i] = max(self.good[i], default=math.nan)
            self.rates[0, i], self.widths[:, i] = math.nan, np.inf
            self.doubt_low[i] = self.doubt_high[i] = math.nan
            one = np.array([place])
            self.learn(runs[one], k[one], growth.select(one), grows[:, one], took[one])
        return bool(self.looks[some].any())

    def dither(self, runs: Indices, tried: Floats) -> Dither:
        """The dither sustained by quantisation at each K; zero if the trial has a threshold."""
        if self.trial.threshold is not None:
            return Dither.unknown(runs.size, 0.0)
        return dither_of(self.device, tried, self.dampings[runs])

    def rests(self, runs: Indices, tried: Floats, steps: Floats) -> Floats:
        """Amplitudes that count as rest without waiting: dither whose command reaches no limit.

        steps: the dither in encoder steps, 0 where a small oscillation may grow again. In a device
        with play or other forces between its masses a small oscillation may still grow, and whether
        an oscillation is felt is known only when it has settled: there only the usual threshold
        counts.
        """
        rest = np.full(runs.size, threshold(self.device, self.trial))
        settled = all(physics.effect.hook in SETTLED for physics in self.device.physics)
        if self.search.felt or not settled:
            return rest
        face = self.device.interface
        within = face.command_limit / (tried + 2.0 * np.abs(self.dampings[runs]) / face.period)
        return np.maximum(rest, np.minimum(steps * face.encoder_step, within))

    def subjects(self, rests: Floats, starts: Floats) -> Subjects:
        """Return runs of the device, one per start, with amplitudes that count as rest."""
        which = np.zeros(rests.size, dtype=np.int64)
        return Subjects([self.one], which, starts, rests, nonlinear_walls(self.device))

    def frequencies(self, trial: Trial, workers: int) -> Floats:
        """Ultimate frequency [Hz] of the run at each unstable end.

        On a linear device this is the frequency of the growing mode, which the first seconds show.
        On any other, the run is followed to its verdict: until then the oscillation that steps and
        friction sustain is larger than the growing one and has spectral lines at any frequency.
        """
        found = np.full(self.dampings.size, np.nan)
        known = np.flatnonzero(~np.isnan(self.unstable))
        if known.size == 0:
            return found
        period = self.device.interface.period
        weights = np.zeros(round(trial.seconds / period))
        some = walls(self.unstable[known], self.dampings[known], law=trial.law)
        starts = self.starts[self.grows[:, known].argmax(axis=0)]
        runs = self.subjects(np.zeros(known.size), starts).started(some)
        seconds = self.seconds[known] if self.nonlinear else np.full(known.size, trial.seconds)
        followed = np.full((known.size, 2 * weights.size), np.nan)  # the last two lengths
        left, done = np.arange(known.size), 0.0
        while left.size:
            _, velocities, tasks, runs = runs.tasks(weights, 1, keep=True, workers=workers)
            in_parallel(tasks, workers)
            moving = ~np.isnan(velocities[:, 0])  # false if the run escaped earlier
            followed[left[moving]] = np.hstack(
                [followed[left[moving], weights.size :], velocities[moving]]
            )
            done += trial.seconds
            on = np.flatnonzero(moving & (done + 0.5 * period < seconds[left]))
            left, runs = left[on], runs.select(on)
        if self.nonlinear:
            found[known] = largest_frequencies(followed, weights.size, period)
        else:
            found[known] = ultimate_frequencies(followed[:, weights.size :], period)
        return found

    def trials(self) -> Floats:
        """Next K for each damping; NaN: its bracket is closed, or it waits for the leading ones."""
        near = 1.0 + self.search.tolerance
        with np.errstate(invalid="ignore"):
            scan = np.where(
                np.isnan(self.stable),
                self.first,
                np.minimum(self.stable * self.search.ratio, self.highest),
            )
            scan = np.where(self.stable >= self.highest, np.nan, scan)
            scan = np.where(np.isnan(self.doubt_high), scan, self._beyond_doubt())
            doubt = ~np.isnan(self.doubt_low)
            middle = np.sqrt(self.stable * np.where(doubt, self.doubt_low, self.unstable))
            below = np.where(doubt, middle, self._interpolated(middle))
            above = np.sqrt(self.doubt_high * self.unstable)
            low_open = np.where(doubt, self.doubt_low, self.unstable) > self.stable * near
            high_open = doubt & (self.unstable > self.doubt_high * near)
            closing = np.where(low_open, below, np.where(high_open, above, np.nan))
            tried = np.where(np.isnan(self.unstable), scan, closing)
            return np.where(self.waiting, np.nan, tried)

    def follow(self) -> None:
        """Let the other dampings begin below the brackets of the leading ones."""
        led = np.flatnonzero(~self.waiting[self.order])
        known = np.fmax(self.stable[self.order[led]] / self.search.ratio, self.lowest)
        right = np.searchsorted(led, np.arange(self.dampings.size))
        left = np.maximum(right - 1, 0)
        first = np.minimum(known[left], known[right])
        own = self.waiting[self.order]
        self.first[self.order[own]] = first[own]
        self.waiting[:] = False

    def _interpolated(self, middle: Floats) -> Floats:
        """K of zero growth rate by interpolation, moved a little towards the farther end.

        With this step past the zero the next bracket is as narrow as the tolerance if the
        interpolation is right. If it is not (three trials have not halved the bracket), the middle
        is returned.
        """
        low, high = self.stable, self.unstable
        crossing = np.isfinite(self.rates).all(axis=0) & (self.rates[0] < 0.0) & (self.rates[1] > 0)
        ends = np.where(crossing, self.rates, [[-1.0], [1.0]])
        share = -ends[0] / (ends[1] - ends[0])
        zero = low + share * (high - low)
        step = 0.4 * self.search.tolerance * zero
        guess = np.where(share < 0.5, zero + step, zero - step)
        inside = crossing & (guess > low) & (guess < high)
        return np.where(inside & (self.widths[0] <= 0.5 * self.widths[3]), guess, middle)

    def _beyond_doubt(self) -> Floats:
        """The next K of the scan beyond the ones that stayed undecided; NaN at the highest."""
        ahead = np.minimum(self.doubt_high * self.search.ratio, self.highest)
        return np.where(self.doubt_high >= self.highest, np.nan, ahead)

    def learn(
        self, runs: Indices, tried: Floats, growth: Growth, grows: Flags, took: Floats
    ) -> None:
        """Store the verdicts of one round.

        grows (starts, runs): the starts from which each run grows; took (runs,): its duration [s].
        """
        good = growth.verdict == DECAYS
        doubt = growth.verdict == UNDECIDED
        bad = ~good & ~doubt
        # This scan began above a band of instability: start again near zero. This is done once: if
        # K then stays undecided, the bracket has no stable end.
        early = bad & np.isnan(self.stable[runs]) & (self.first[runs] > self.lowest)
        self.first[runs[early]] = self.lowest
        self.doubt_low[runs[early]] = self.doubt_high[runs[early]] = np.nan
        bad &= ~early
        for i, k in zip(runs[good].tolist(), tried[good].tolist(), strict=True):
            self.good[i].append(k)
        self.grows[:, runs[bad]] = grows[:, bad]
        self.stable[runs[good]] = tried[good]
        self.unstable[runs[bad]] = tried[bad]
        self.verdicts[0, runs[good]] = growth.verdict[good]
        self.verdicts[1, runs[bad]] = growth.verdict[bad]
        self.amplitude[runs[bad]], self.seconds[runs[bad]] = growth.amplitude[bad], took[bad]
        self.rates[0, runs[good]] = growth.rate[good]
        self.rates[1, runs[bad]] = growth.rate[bad]
        width = self.unstable[runs] - self.stable[runs]
        self.widths[1:, runs] = self.widths[:-1, runs]
        self.widths[0, runs] = np.where(np.isnan(width), np.inf, width)
        some = runs[doubt]
        self.doubt_low[some] = np.fmin(self.doubt_low[some], tried[doubt])
        self.doubt_high[some] = np.fmax(self.doubt_high[some], tried[doubt])
        below = self.doubt_high <= self.stable  # below the stable end doubts do not matter
        above = self.doubt_low >= self.unstable
        self.doubt_low[below | above] = self.doubt_high[below | above] = np.nan

    def brackets(self, frequencies: Floats) -> list[Bracket]:
        """Return the closed brackets."""

        def known(value: float) -> float | None:
            return None if math.isnan(value) else float(value)

        return [
            Bracket(
                float(b),
                known(self.stable[i]),
                known(self.unstable[i]),
                None if self.verdicts[0, i] < 0 else VERDICTS[self.verdicts[0, i]],
                None if self.verdicts[1, i] < 0 else VERDICTS[self.verdicts[1, i]],
                known(self.amplitude[i]),
                known(frequencies[i]),
                None
                if math.isnan(self.doubt_low[i])
                else (float(self.doubt_low[i]), float(self.doubt_high[i])),
                () if self.grows[:, i].all() else tuple(self.starts[self.grows[:, i]].tolist()),
            )
            for i, b in enumerate(self.dampings)
        ]


def find_brackets(
    devices: Sequence[Device],
    dampings: Sequence[Floats],
    trial: Trial = Trial(),
    search: Search = Search(),
    progress: Callable[[float], None] | None = None,
) -> list[list[Bracket]]:
    """Return the time-domain boundary of each device over its dampings.

    The dampings are divided into groups of up to `GROUP`, computed independently on all cores.
    progress: called with the share of brackets closed, from 0 to 1 (from any thread). Raises
    ValueError for a damping that is not finite.
    """
    hunts: list[_Hunt] = []
    counts: list[int] = []
    for device, grid in zip(devices, dampings, strict=True):
        values = np.asarray(grid, dtype=np.float64)
        if not np.all(np.isfinite(values)):
            raise ValueError("damping contains a value that is not finite; give numbers only")
        one = prepared(device, trial.substeps)
        groups = np.split(values, range(GROUP, values.size, GROUP))
        hunts += [_Hunt(device, one, group, trial, search) for group in groups]
        counts.append(len(groups))
    total = max(1, sum(h.dampings.size for h in hunts))
    workers = threads()
    inner = 1 if len(hunts) >= workers else workers

    def closed() -> None:
        if progress is not None:
            progress(1.0 - sum(h.open for h in hunts) / total)

    found = in_parallel([lambda h=h: h.run(trial, inner, closed) for h in hunts], workers)
    each = iter(found)
    return [[b for _ in range(count) for b in next(each)] for count in counts]

"""Examines time stamps: period, jitter, gaps, repeats, and a clock that goes back.

The period is the mean of the intervals within half a median of the median, so it is right for
rounded stamps (0.0016, 0.0017, 0.0016 ... at 610.35 Hz), and gaps have no influence. Jitter is the
spread of these intervals; rounding to a multiple of q alone causes up to q/2 of it.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.logs.steps import step_seen

Floats = NDArray[np.float64]

EPOCH = 1e6  # seconds; larger stamps count from an epoch, so times are counted from the first stamp
GAP = 1.5  # periods; in a longer interval a sample is missing
NOTABLE_JITTER = 0.01  # of the period
MOST_GAPS = 16
BESIDE = 11  # samples used before and after a long interval
LONGER, NEARLY = (
    10,
    1.02,
)  # least longer intervals of even samples; scatter of their stamps, in steps


@dataclass(frozen=True)
class Gap:
    """An interval longer than 1.5 periods: start t [s], length [s], number of missing samples."""

    t: float
    seconds: float
    samples: int


@dataclass(frozen=True)
class Timing:
    """The examination of the stamps of one stream.

    period [s]: 0 if fewer than two stamps differ. jitter [s]: standard deviation of the intervals
    that are not gaps. resolution [s]: the step of which all stamps are multiples, 0 if none finer
    than the period is seen. gap_count and missing count all gaps and missing samples; gaps lists
    the first 16. repeats and backwards count stamps equal to, and earlier than, the one before; the
    *_at are the times of the first.
    """

    samples: int
    start: float
    stop: float
    period: float
    jitter: float
    resolution: float
    gap_count: int
    missing: int
    gaps: tuple[Gap, ...]
    repeats: int
    repeats_at: float | None
    backwards: int
    backwards_at: float | None

    @property
    def rate(self) -> float:
        """Samples per second, 0 without a period."""
        return 1.0 / self.period if self.period > 0.0 else 0.0

    def facts(self) -> dict[str, Any]:
        """Return the examination in JSON types, with units in the names."""
        seconds = {"start", "stop", "period", "jitter", "resolution", "repeats_at", "backwards_at"}
        values = {
            f"{k}_s" if k in seconds else k: v for k, v in asdict(self).items() if k != "gaps"
        }
        values["gaps"] = [
            {"t_s": g.t, "length_s": g.seconds, "samples": g.samples} for g in self.gaps
        ]
        return values

    def faults(self) -> list[str]:
        """Return a sentence on each fault of the clock."""
        found: list[str] = []
        if self.backwards:
            found.append(
                f"the clock goes back {times(self.backwards)}, first at {self.backwards_at:.9g} s"
            )
        if self.repeats:
            found.append(
                f"a stamp repeats the one before {times(self.repeats)}, first at"
                f" {self.repeats_at:.9g} s"
            )
        if self.gap_count:
            lacking = "1 sample is" if self.missing == 1 else f"{self.missing} samples are"
            first = "a gap" if self.gap_count == 1 else f"{self.gap_count} gaps, the first"
            found.append(
                f"{lacking} missing in {first} of {self.gaps[0].seconds:.4g} s after"
                f" {self.gaps[0].t:.9g} s"
            )
        if self.jitter > max(NOTABLE_JITTER * self.period, 0.5 * self.resolution):
            found.append(
                f"intervals scatter by {self.jitter:.3g} s about the period of {self.period:.6g} s"
            )
        return found


def times(count: int) -> str:
    """Return "once", "twice" or "n times"."""
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def examine(t: Floats) -> Timing:
    """Examine stamps t [s], finite, shape (samples,) with at least one sample."""
    with np.errstate(over="ignore", invalid="ignore"):
        return _examine(t, np.diff(t))


def _examine(t: Floats, intervals: Floats) -> Timing:
    forward = intervals[intervals > 0.0]
    step = step_seen(t)
    even = _even(t, forward, step or 0.0)
    if forward.size == 0:
        usual, period = forward, 0.0
    elif even > 0.0:
        usual, period = forward, float(f"{even:.12g}")
    else:
        median = float(np.quantile(forward, 0.5, method="lower"))
        usual = forward[np.abs(forward - median) <= 0.5 * median]
        period = float(f"{usual.mean():.12g}")
    gaps = intervals > GAP * period if period and not even else np.zeros(0, dtype=np.bool_)
    gap_at = np.flatnonzero(gaps)
    late = np.array([not _stays(t, int(i) + 1, period) for i in gap_at], dtype=np.bool_)
    if late.any():  # the next interval is shorter: no sample is missing
        scattered = [i for i in gap_at[late] if i == 0 or intervals[i - 1] > 0.0]
        gap_at = gap_at[~late]
        if scattered:  # jitter, unless it follows a stamp that repeats or goes back
            usual = np.delete(intervals, gap_at)
            usual = usual[usual > 0.0]
    lacking = np.maximum(np.rint(intervals[gap_at] / period) - 1.0, 1.0) if period else gap_at
    repeat_at, back_at = np.flatnonzero(intervals == 0.0), np.flatnonzero(intervals < 0.0)
    rounding = 4.0 * float(np.spacing(np.abs(t).max()))
    jitter = float(usual.std()) if usual.size else 0.0
    return Timing(
        samples=t.size,
        start=float(t[0]),
        stop=float(t[-1]),
        period=period,
        jitter=jitter if jitter > rounding else 0.0,
        resolution=step if step is not None and rounding < step < 0.999 * period else 0.0,
        gap_count=gap_at.size,
        missing=int(min(lacking.sum(), 2.0**62)),
        gaps=tuple(
            Gap(float(t[i]), float(intervals[i]), int(min(n, 2.0**62)))
            for i, n in zip(gap_at[:MOST_GAPS], lacking[:MOST_GAPS], strict=True)
        ),
        repeats=repeat_at.size,
        repeats_at=float(t[repeat_at[0] + 1]) if repeat_at.size else None,
        backwards=back_at.size,
        backwards_at=float(t[back_at[0] + 1]) if back_at.size else None,
    )


def _even(t: Floats, forward: Floats, step: float) -> float:
    """Return the period of even samples whose stamps are rounded to a step, 0.0 if they are not.

    At 833 Hz stamps in ms are 1, 1, 1, 1, 2 ms apart. Such stamps are within half a step of a line,
    which samples that are lost by chance are not: their count is off by its own root.
    """
    if step == 0.0 or forward.size != t.size - 1:
        return 0.0
    shorter = float(forward.min())
    if np.count_nonzero(forward > shorter + 0.5 * step) < LONGER:
        return 0.0
    count = np.arange(t.size) - 0.5 * (t.size - 1)
    period = float(count @ t / (count @ count))
    away = t - period * count
    return period if np.ptp(away) <= NEARLY * step and shorter > period - NEARLY * step else 0.0


def _stays(t: Floats, k: int, period: float) -> bool:
    """Whether the clock is still ahead of the count of samples some samples after a long interval.

    Stamps of a busy host come late and catch up again; after a missing sample they do not.
    """
    before, after = np.arange(max(0, k - BESIDE), k), np.arange(k, min(t.size, k + BESIDE))
    ahead = np.median(t[after] / period - after) - np.median(t[before] / period - before)
    return bool(ahead > 0.5)


@dataclass(frozen=True)
class Stamps:
    """The stamps of one stream as written in the file, in units of `unit` seconds.

    shift [s] is added to all of them.
    """

    raw: NDArray[Any]
    unit: float
    shift: float = 0.0

    @property
    def first(self) -> Fraction:
        """The earliest stamp [s], exactly."""
        earliest = self.raw.min() if self.raw.size else 0
        return _exact(earliest) * _decimal(self.unit) + Fraction(self.shift)

    def seconds(self, origin: Fraction) -> Floats:
        """Return the stamps [s] since the origin, shape (samples,).

        The first stamp of a clock that counts from an epoch is subtracted before the conversion to
        doubles, in which 1.7e18 ns has steps of 256 ns.
        """
        if origin == 0 and self.shift == 0.0:
            return np.asarray(self.raw, dtype=np.float64) * self.unit
        earliest = self.raw.min()
        whole = self.raw.dtype.kind in "iu" and int(self.raw.max()) - int(earliest) < 2**63
        raw = self.raw if whole else np.asarray(self.raw, dtype=np.float64)
        since = np.asarray(raw - earliest, dtype=np.float64) * self.unit
        return since + float(self.first - origin)


def _exact(value: Any) -> Fraction:
    return Fraction(value.item() if hasattr(value, "item") else value)


def _decimal(unit: float) -> Fraction:
    """Return the unit as it is meant: 1e-9 is a thousand-millionth, not the double next to it."""
    return Fraction(repr(unit))


def common_origin(streams: Mapping[str, Stamps]) -> Fraction:
    """Return the origin of times: 0, or the earliest of all stamps if it counts from an epoch."""
    earliest = min(stamps.first for stamps in streams.values())
    return earliest if abs(earliest) > EPOCH else Fraction(0)

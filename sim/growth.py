"""Does a run decay, cycle or grow? The sign of the growth rate of a run's oscillation energy.

The energy of an oscillation that grows as exp(sigma t) grows as exp(2 sigma t). With smooth weights
(cos^4) and at least four cycles per window, the mean over a window contains at most 1e-4 of the
ripple at twice the oscillation's frequency. So half the logarithm of the windows' energies is a
line of slope sigma, plus the remainder of modes that decay faster. The line is fitted by least
squares after the first quarter of the run; its standard error is taken from the residuals, widened
by their autocorrelation, so a transient that bends the line makes the run undecided, not wrong, and
the run is prolonged.

Two energies are watched, because a fast mode that has just begun to grow is invisible in the
kinetic energy of a slow one: kinetic energy, and the third difference of m1's velocity, in which
170 Hz stands 3e4 times above 28 Hz. A run decays only if both do, and grows if either does. If
nothing fast is left, the second one is rounding, whose slope means nothing: it counts as decayed,
and not as growing until it exceeds the rounding.

If something is nonlinear, growth or decay may end in a limit cycle, so a slope is the verdict only
when no more time is left. Before that, a run must come to rest, escape, or cycle: its amplitude
hardly changes over the last half, and its slope is not significant. (Slow growth hardly changes it
either, but its slope is significant.)

A window that is shorter than a cycle shows neither the energy nor the amplitude of the cycle. If
limit cycles are possible, windows are joined until one contains a cycle. A run with fewer than
`FEWEST_JOINED` of them is too slow to be judged in its time, unless it rests or escapes.

Limit: two growing modes within one octave are seen as their sum.
"""

import enum
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.windows import (
    FAST_ENERGY,
    HIGHEST,
    HIGHEST_COMMAND,
    LOWEST,
    LOWEST_COMMAND,
    MEASURES,
    REVERSALS,
    SLOW_ENERGY,
)

Floats = NDArray[np.float64]
SIGNIFICANCE = 6.0  # standard errors between a growth rate and zero
SILENCE = 1e-24  # energy over that of the first window, at which a run has come to rest
ROUNDED = 1e-14  # fast energy over that of its largest window, below which it is rounding
ESCAPE = 1e6  # amplitude over the start's at which a run counts as lost
STEADY = 0.02  # change of amplitude over the last half of a run that a limit cycle may show
FLAT = 1e-3  # growth of ln(amplitude) over that half that does not count, however significant
FEWEST_STEADY = 16  # least windows for a limit cycle while there is time left
FEWEST_JOINED = 8  # least windows, of a whole cycle each, for a meaningful slope


class Verdict(enum.Enum):
    """What a run does in the end; the value is the word that files and tables use."""

    DECAYS = "decays"
    LIMIT_CYCLE = "limit_cycle"
    GROWS = "grows"
    UNDECIDED = "undecided"


VERDICTS = tuple(Verdict)
DECAYS, LIMIT_CYCLE, GROWS, UNDECIDED = range(4)


def window_weights(ticks: int) -> Floats:
    """Return cos^4 weights over a window of ticks, with unit sum."""
    phase = (np.arange(ticks) + 0.5) / ticks
    weights = np.sin(np.pi * phase) ** 4
    return weights / weights.sum()


@dataclass(frozen=True)
class Growth:
    """Growth of an ensemble's runs, one value per run (runs,).

    verdict: index into VERDICTS. rate [1/s] and error: of the energy that decided: the one that
    grows, else the one that decays more slowly. amplitude: half the range of m1's position in the
    last window; force: half the range of the command there, peak: its largest absolute value.
    frequency [Hz]: half the reversals of m1's velocity a second over the last half of the run.
    """

    verdict: NDArray[np.int64]
    rate: Floats
    error: Floats
    amplitude: Floats
    force: Floats
    frequency: Floats
    peak: Floats

    def select(self, runs: NDArray[np.int64]) -> "Growth":
        """Return the growth of some of the runs."""
        return Growth(*(getattr(self, field.name)[runs] for field in fields(self)))


def assess(
    measures: Floats,
    window: float,
    start: Floats | float,
    threshold: Floats | float,
    nonlinear: bool,
    final: bool = True,
) -> Growth:
    """Judge runs from their measures.

    measures (windows, 7, runs); window [s]; start: amplitude at t = 0, and threshold: amplitude
    below which an oscillation counts as rest, each (runs,) or one for all; nonlinear: limit cycles
    are possible; final: the runs will not be prolonged.
    """
    windows, _, runs = measures.shape
    starts, rests = np.broadcast_to(start, runs), np.broadcast_to(threshold, runs)
    joined = _joined(measures, window) if nonlinear else np.ones(runs, dtype=np.int64)
    growth = Growth(np.full(runs, UNDECIDED), *np.full((6, runs), np.nan))
    for count in np.unique(joined).tolist():
        some = np.flatnonzero(joined == count)
        fits = windows // FEWEST_JOINED
        size = max(1, min(count, fits))
        longer = measures[:, :, some] if size == 1 else _join(measures[:, :, some], size)
        found = _assess(
            longer, window * size, starts[some], rests[some], nonlinear, final, count > max(1, fits)
        )
        for field in fields(Growth):
            getattr(growth, field.name)[some] = getattr(found, field.name)
    return growth


def _joined(measures: Floats, window: float) -> NDArray[np.int64]:
    """How many windows, a power of two, hold a cycle of each run; 1 where nothing reverses."""
    half = measures[-(measures.shape[0] // 2) :, REVERSALS]
    with np.errstate(divide="ignore", invalid="ignore"):
        windows = 2.0 / half.mean(axis=0)  # windows per cycle: two reversals
    windows = np.where(np.isfinite(windows), np.maximum(windows, 1.0), 1.0)
    return (2.0 ** np.ceil(np.log2(windows))).astype(np.int64)


def _join(measures: Floats, size: int) -> Floats:
    """Return measures of `size` windows each as one, the last of them complete."""
    count = measures.shape[0] // size
    groups = measures[measures.shape[0] - count * size :].reshape(count, size, MEASURES, -1)
    found = groups.mean(axis=1)
    for row in (LOWEST, LOWEST_COMMAND):
        found[:, row] = groups[:, :, row].min(axis=1)
    for row in (HIGHEST, HIGHEST_COMMAND):
        found[:, row] = groups[:, :, row].max(axis=1)
    found[:, REVERSALS] *= size
    return found


def _assess(
    measures: Floats, window: float, start: Floats, threshold: Floats, nonlinear: bool,
    final: bool, slow: bool,
) -> Growth:  # fmt: skip
    """Judge runs whose windows hold a cycle, or that are too slow for that."""
    windows, _, runs = measures.shape
    with np.errstate(all="ignore"):  # infinities and zeros are verdicts, see below
        amplitude = 0.5 * (measures[:, HIGHEST] - measures[:, LOWEST])
        slopes = [
            growth_rate(0.5 * np.log(measures[:, energy]), window)
            for energy in (SLOW_ENERGY, FAST_ENERGY)
        ]
        kinetic = measures[:, SLOW_ENERGY]
        silent = kinetic[-1] <= SILENCE * kinetic[0]
    up = [(rate > SIGNIFICANCE * error) for rate, error in slopes]
    down = [(rate < -SIGNIFICANCE * error) for rate, error in slopes]
    with np.errstate(invalid="ignore"):
        rounding = measures[-1, FAST_ENERGY] <= ROUNDED * measures[:, FAST_ENERGY].max(axis=0)
    # What rises within the rounding may be a mode: decided when it exceeds this, or at the end.
    down[1] |= rounding & (final | ~up[1])
    up[1] &= ~rounding
    escaped = ~(np.isfinite(kinetic) & (amplitude < ESCAPE * start)).all(axis=0)
    verdict = np.full(runs, UNDECIDED)
    verdict[down[0] & down[1]] = DECAYS
    verdict[up[0] | up[1]] = GROWS
    by_fast = np.where(up[0] == up[1], slopes[1][0] > slopes[0][0], up[1])
    rate = np.where(by_fast, slopes[1][0], slopes[0][0])
    error = np.where(by_fast, slopes[1][1], slopes[0][1])
    if slow:
        verdict[:] = UNDECIDED
    if nonlinear:
        last = amplitude[-(windows // 2) :]
        resting = (last.max(axis=0) <= threshold) & (amplitude[-1] <= 0.5 * start)
        if not final:
            verdict[:] = UNDECIDED
        if not slow and (final or windows >= FEWEST_STEADY):
            cycling = _cycling(last, kinetic[-(windows // 2) :], window, final)
            verdict[cycling & ~resting & ~escaped] = LIMIT_CYCLE
        verdict[resting] = DECAYS
    verdict[silent] = DECAYS
    verdict[escaped] = GROWS
    rate = np.where(escaped, np.inf, np.where(silent, -np.inf, rate))
    with np.errstate(invalid="ignore"):
        highest, lowest = measures[-1, HIGHEST_COMMAND], measures[-1, LOWEST_COMMAND]
        force, peak = 0.5 * (highest - lowest), np.maximum(np.abs(highest), np.abs(lowest))
    frequency = measures[-(windows // 2) :, REVERSALS].mean(axis=0) / (2.0 * window)
    error = np.where(escaped | silent, 0.0, error)
    return Growth(verdict, rate, error, amplitude[-1], force, frequency, peak)


def _cycling(amplitude: Floats, kinetic: Floats, window: float, final: bool) -> NDArray[np.bool_]:
    """Whether the last half of each run (windows / 2, runs) neither grows nor decays.

    Cycles under an encoder step may beat forever; at the end the means of its quarters decide.
    """
    with np.errstate(all="ignore"):
        change = (amplitude.max(axis=0) - amplitude.min(axis=0)) / amplitude.max(axis=0)
        if final:
            half = amplitude.shape[0] // 2
            before = amplitude[-2 * half : -half].mean(axis=0)
            after = amplitude[-half:].mean(axis=0)
            change = np.abs(after - before) / np.maximum(before, after)
        rate, error = growth_rate(0.5 * np.log(kinetic), window)
        moving = np.abs(rate) > np.maximum(
            SIGNIFICANCE * error, FLAT / (amplitude.shape[0] * window)
        )
    return (change < STEADY) & ~moving


def _sum(rows: Floats) -> Floats:
    """Return the sum of rows in their order: a run has its bits however many there are."""
    total = np.zeros(rows.shape[1:])
    for row in rows:
        total += row
    return total


def growth_rate(lines: Floats, window: float) -> tuple[Floats, Floats]:
    """Return slope [1/s] and its standard error over the last three quarters, each (runs,).

    lines (windows, runs): half the logarithm of the windows' energies, one per `window` seconds.
    """
    kept = lines[lines.shape[0] // 4 :]
    count = kept.shape[0]
    t = (np.arange(count) - 0.5 * (count - 1)) * window
    spread = t @ t
    centred = kept - _sum(kept) / count
    slope = _sum(t[:, None] * centred) / spread
    residual = centred - t[:, None] * slope
    total = _sum(residual * residual)
    variance = total / (count - 2)
    lag = _sum(residual[1:] * residual[:-1]) / (total + 1e-300)
    correlation = np.clip(lag, 0.0, 0.95)
    error = np.sqrt(variance / spread * (1.0 + correlation) / (1.0 - correlation))
    return slope, error

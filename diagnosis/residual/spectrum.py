"""What repeats over a quantity, a position or a command or time: its period, by a spectrum over it.

A force f_k (or an error of the sensor s_k) moves the weighted innovations r by F f, F the linear
response of observer and device. So with g = F' r, <r, F f> = <g, f>, and for a wave f = a cos(2 pi
q_k / period + phase) over a quantity q the chi-square gained is 2 |G|^2 / n with

    G(1 / period) = sum g_k exp(-2 pi i q_k / period),    n = |F exp(2 pi i q / period)|^2.

Under white r the expectation of |G|^2 is n, so the mean spectrum of drawn noise tells n (that of r
itself would hold what is sought, whose line is broad where q is visited unevenly). All periods at
once by one FFT over bins of q: it finds lattices of steps and waves that no list of starting values
would meet. Limits: r must be nearly white, or the noise drawn of its colour.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.residual.remainder import correlated, response

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


@dataclass(frozen=True)
class Peak:
    """A wave over a quantity: period, and the chi-square that it would gain, about.

    turned: by how much its phase in each group of recordings differs from that in the first.
    """

    period: float
    gained: float
    turned: tuple[float, ...] = (0.0,)


class Pull(NamedTuple):
    """g (ticks,) of the residual, and (draws, ticks) of drawn noise."""

    found: Floats
    chance: Floats


def pulls(
    problem: Problem, fitted: Fitted, place: str, draws: int = 8, onset: int = 500, seed: int = 0
) -> list[Pull]:
    """Return g of every experiment for what enters at a place, and that of white noise.

    An observer begins with what the sensor says, and a slow one would take a wave that sets in at
    once for a jump: g sets in over `onset` ticks.
    """
    random, answer = np.random.default_rng(seed), response(problem, fitted, place)
    noise = [random.standard_normal(fitted.white.size) for _ in range(draws)]
    drawn = [correlated(problem, one, answer) for one in noise]
    found: list[Pull] = []
    for i, g in enumerate(correlated(problem, fitted.white, answer)):
        first = min(onset, g.size // 4)
        rising = np.ones(g.size)
        rising[:first] = np.sin(0.5 * np.pi * np.arange(first) / first) ** 2
        found.append(Pull(rising * g, np.array([rising * d[i] for d in drawn])))
    return found


def peaks(
    pulls: list[Pull],
    over: list[Floats],
    finest: float,
    count: int = 3,
    groups: Sequence[Sequence[int]] = (),
    fewest: float = 2.0,
) -> tuple[list[Peak], int]:
    """Return the strongest waves over a quantity with periods above `finest`, and lines looked at.

    pulls: as `pulls` returns them; over: the quantity at every tick, as long. fewest: periods over
    all of the quantity that a wave has at least. groups: places of recordings in which a wave may
    have a phase of its own; none for one phase in all. What several gain adds up, each at its own
    phase.
    """
    ends = min(float(q.min()) for q in over), max(float(q.max()) for q in over)
    each: list[_Spectrum] = []
    gained, count_of = np.zeros(0), 0
    for group in groups or [range(len(over))]:
        found = _spectrum([pulls[i] for i in group], [over[i] for i in group], finest, ends)
        if found is None:
            return [], 0
        usable = found.lines >= fewest * found.finer
        usable &= (found.lines <= found.finer * found.span / finest) & (found.level > 0.0)
        level = np.where(usable, found.level, 1.0)
        own = np.where(usable, 2.0 * np.abs(found.waves) ** 2 / level, 0.0)
        gained = gained + own if gained.size else own
        count_of = max(count_of, int(np.count_nonzero(usable)) // found.finer)
        each.append(found)
    highest = each[0].highest(gained, count)
    if len(each) > 1:
        highest = [replace(p, turned=_turned(each, each[0].line_of(p))) for p in highest]
    return highest, count_of


def _turned(each: Sequence["_Spectrum"], line: int) -> tuple[float, ...]:
    """Phases of a line in each spectrum less that in the first, within half a turn."""
    first = np.conj(each[0].waves[line])
    return tuple(float(np.angle(one.waves[line] * first)) for one in each)


def step_peaks(
    pulls: list[Pull],
    over: list[Floats],
    finest: float,
    sign: float,
    spread: float = 0.0,
    count: int = 3,
    harmonics: int = 5,
) -> tuple[list[Peak], int]:
    """Return the likeliest steps of a quantity above `finest`, and lines looked at.

    The error of a step is a saw whose `harmonics` all have known size and phase, so

        gained = 2 sign sum c_j S_j - sum c_j^2 n_j / 2,    c_j = (-1)^j step / (pi j),

    S_j the sine part of G at j / step. sign: 1 where the error is in what was recorded, -1 where it
    is to be added to the model. spread: of what the quantity is known by, over the step.
    """
    found = _spectrum(pulls, over, finest / harmonics)
    if found is None:
        return [], 0
    reach = found.finer * found.span
    last = int(min(reach / finest, (found.lines.size - 1) // harmonics))
    k = np.arange(2 * found.finer, last + 1)
    gained = np.zeros(found.lines.size)
    for j in range(1, harmonics + 1):
        blur = np.exp(-2.0 * (np.pi * j * spread) ** 2)
        c = (-1.0) ** j * reach / (k * np.pi * j) * blur
        gained[k] += -2.0 * sign * c * found.waves[j * k].imag - 0.5 * c**2 * found.level[j * k]
    return found.highest(gained, count), k.size // found.finer


@dataclass(frozen=True)
class _Spectrum:
    """G (lines,) and its expected power under noise at lines k / (finer span)."""

    lines: NDArray[np.int64]
    waves: Complexes
    level: Floats
    span: float
    finer: int

    def line_of(self, peak: Peak) -> int:
        return round(self.finer * self.span / peak.period)

    def highest(self, gained: Floats, count: int) -> list[Peak]:
        """Return the strongest lines (lines,), none within one over the span of another."""
        gained, found = gained.copy(), list[Peak]()
        for _ in range(count):
            k = int(np.argmax(gained))
            if gained[k] <= 0.0:
                break
            found.append(Peak(self.finer * self.span / k, float(gained[k])))
            gained[max(0, k - self.finer) : k + self.finer + 1] = 0.0
        return found


def _spectrum(
    pulls: list[Pull],
    over: list[Floats],
    finest: float,
    ends: tuple[float, float] | None = None,
    finer: int = 8,
    most_bins: int = 1 << 20,
) -> _Spectrum | None:
    """Return the spectrum, None where nothing of `finest` fits in.

    ends: of the span, those of the quantity itself where nothing is given. finer: lines a
    reciprocal span. most_bins: beyond which waves are too fine over too long a way to be looked
    for.
    """
    low, high = ends or (min(float(q.min()) for q in over), max(float(q.max()) for q in over))
    span = high - low
    if not span > 4.0 * finest:
        return None
    bins = min(most_bins, 1 << int(np.ceil(np.log2(4.0 * finer * span / finest))))
    total, chance = np.zeros(bins), np.zeros((pulls[0].chance.shape[0], bins))
    width = finer * span / bins
    for pull, q in zip(pulls, over, strict=True):
        index = np.minimum(((q - low) / width).astype(np.int64), bins - 1)
        total += np.bincount(index, pull.found, bins)
        for row, drawn in zip(chance, pull.chance, strict=True):
            row += np.bincount(index, drawn, bins)
    waves = np.fft.rfft(total)
    lines = np.arange(waves.size)
    waves *= np.exp(-2j * np.pi * lines / (finer * span) * (low + 0.5 * width))
    power = np.zeros(waves.size)
    for row in chance:  # one by one: all of them would fill memory
        power += np.abs(np.fft.rfft(row)) ** 2 / chance.shape[0]
    return _Spectrum(lines, waves, _level(power, lines), span, finer)


def _level(power: Floats, lines: NDArray[np.int64]) -> Floats:
    """Smooth the power of noise over lines: over more of them where lines are fine.

    What enters at the sensor counts for little at long periods and much at short ones, so that a
    wide mean would hide a long wave.
    """
    level = power
    for width in (9, 33, 129, 513):
        wide = uniform_filter1d(power, min(width, power.size), mode="reflect")
        level = np.where(lines >= 2 * width, wide, level)
    return level

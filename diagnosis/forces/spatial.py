"""Finds the period of forces periodic in position or command, by a spectrum over that quantity.

A force f_k (or an error of the sensor s_k) changes the weighted innovations r by F f, where F is
the linear response of observer and device. So with g = F' r, <r, F f> = <g, f>, and a wave f = a
cos(2 pi q_k / period + phase) over a quantity q gains a chi-square of 2 |G|^2 / n with

    G(1 / period) = sum g_k exp(-2 pi i q_k / period),    n = |F exp(2 pi i q / period)|^2.

For white r the expectation of |G|^2 is n, so the mean spectrum of drawn white noise gives n (the
spectrum of r itself would contain the sought wave, whose line is broad if q is visited unevenly).
One FFT over bins of q gives all periods at once, and finds lattices of steps and waves that no list
of starting values would contain. An observer starts with the sensor's reading, and a slow one would
show the sudden start of a wave as a jump, so g is faded in over `ONSET` ticks. Limits: the part
that a refit absorbs (long periods) is not removed, and r must be nearly white.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.signal import fftconvolve

from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.noise.gaps import steadily
from zwidth.diagnosis.noise.predictor import SETTLING, innovations, prepared
from zwidth.sim.place import place_at

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
LONGEST = 2000  # ticks of response kept
LEAD = 20  # ticks before a unit enters, since an observer starts from the first samples
HARMONICS = 5  # number of harmonics of a sawtooth
SEED = 0
FINER = 8  # lines for each reciprocal span
MOST_BINS = 20  # power of two: finer waves over a long way are not sought
ONSET = 500
DRAWS = 4  # number of draws of white noise
WIDTHS = (9, 33, 129, 513)  # lines over which their power is smoothed


@dataclass(frozen=True)
class Peak:
    """A wave over a quantity: period, and approximately the chi-square that it would gain.

    turned: phase in each group of recordings, relative to the first group.
    """

    period: float
    gained: float
    turned: tuple[float, ...] = (0.0,)


def response(problem: Problem, fitted: Fitted, place: str, output: int = 0) -> Floats:
    """Return the weighted innovations (ticks, o) after a unit at a place.

    In a link the unit pushes the first mass one way and the second the other; in "sensor" it is
    added to the reading of an output. The device is without its nonlinear physics.
    """
    device = fitted.model.acting(fitted.x)
    device = device.bare()
    first = problem.experiments[0]
    device = first.on(device)
    length = min(LONGEST, first.ticks - LEAD) + LEAD
    command, measured = np.zeros(length), np.zeros((length, len(first.outputs)))
    ready = prepared(device)
    force = np.zeros((length, ready.coarse.dof))
    if place == "command":
        command[LEAD] = 1.0
    elif place == "sensor":
        measured[LEAD, output] = 1.0
    else:
        force[LEAD] = place_at(place).row(ready.coarse.dof)
    still = replace(
        first.unmoved(), command=command, measured=measured, sensor_error=None, dropped=None,
        force=None, before=None, bridged=None, uncounted=None,
    )  # fmt: skip
    answer = innovations(device, still, steadily(problem.observer.gain), force, ready)
    return problem.observer.weigh(answer)[LEAD:]


class Pull(NamedTuple):
    """g (ticks,) of the residual, and (draws, ticks) of white noise."""

    found: Floats
    chance: Floats


def pulls(problem: Problem, fitted: Fitted, place: str) -> list[Pull]:
    """Return g of the residual and of white noise, for a unit input at a place, by experiment."""
    random = np.random.default_rng(SEED)
    size = fitted.residual.size
    noise = [replace(fitted, residual=random.standard_normal(size)) for _ in range(DRAWS)]
    drawn = [matched(problem, one, place) for one in noise]
    found: list[Pull] = []
    for i, g in enumerate(matched(problem, fitted, place)):
        onset = min(ONSET, g.size // 4)
        rising = np.ones(g.size)
        rising[:onset] = np.sin(0.5 * np.pi * np.arange(onset) / onset) ** 2
        found.append(Pull(rising * g, np.array([rising * d[i] for d in drawn])))
    return found


def matched(problem: Problem, fitted: Fitted, place: str) -> list[Floats]:
    """Return g (ticks,) of every experiment for a unit input at a place, as in `response`."""
    answer = response(problem, fitted, place)
    found: list[Floats] = []
    first = 0
    for e in problem.experiments:
        white = np.zeros((e.ticks, len(e.outputs)))
        last = first + (e.ticks - SETTLING) * len(e.outputs)
        white[SETTLING:] = fitted.white[first:last].reshape(-1, len(e.outputs))
        first = last
        g = np.zeros(e.ticks)
        for o in range(white.shape[1]):
            g += fftconvolve(white[::-1, o], answer[:, o])[: e.ticks][::-1]
        found.append(g)
    return found


def peaks(
    pulls: list[Pull],
    over: list[Floats],
    finest: float,
    count: int = 3,
    groups: Sequence[Sequence[int]] = (),
) -> tuple[list[Peak], int]:
    """Return the strongest waves over a quantity with periods above `finest`, and lines tried.

    pulls: as `pulls` returns them; over: the quantity at every tick, of the same length. Only
    periods of which the travel contains two or more are tried. groups: recordings that share a
    phase, by default all. The gains of several groups, each with its own phase, add up.
    """
    ends = min(float(q.min()) for q in over), max(float(q.max()) for q in over)
    each: list[Complexes] = []
    gained, count_of = np.zeros(0), 0
    for group in groups or [range(len(over))]:
        spectrum = _spectrum([pulls[i] for i in group], [over[i] for i in group], finest, ends)
        if spectrum is None:
            return [], 0
        lines, waves, level, span = spectrum
        usable = (lines >= 2 * FINER) & (lines <= FINER * span / finest) & (level > 0.0)
        own = np.where(usable, 2.0 * np.abs(waves) ** 2 / np.where(usable, level, 1.0), 0.0)
        gained = gained + own if gained.size else own
        count_of = max(count_of, int(np.count_nonzero(usable)) // FINER)
        each.append(waves)
    span = ends[1] - ends[0]
    found = _highest(gained, span, count)
    if len(each) > 1:
        found = [replace(p, turned=_turned(each, round(FINER * span / p.period))) for p in found]
    return found, count_of


def _turned(each: Sequence[Complexes], line: int) -> tuple[float, ...]:
    """Phases of a line in each spectrum relative to the first one, within half a turn."""
    return tuple(float(np.angle(waves[line] * np.conj(each[0][line]))) for waves in each)


def step_peaks(
    pulls: list[Pull],
    over: list[Floats],
    finest: float,
    sign: float,
    spread: float = 0.0,
    count: int = 3,
) -> tuple[list[Peak], int]:
    """Return the most likely steps of a quantity above `finest`, and lines tried.

    The error of a step is a sawtooth whose harmonics all have known size and phase, so

        gained = 2 a L - a^2 E,    L = sign sum c_j S_j,    E = sum c_j^2 n_j / 2,

    c_j = (-1)^j step / (pi j), where S_j is the sine part of G at j / step. The amplitude a is 1,
    but E is a mean over lines and over phases of the harmonics: of a command of six levels it was
    2.5 times too large, and the right step explained less than nothing. So the best a up to 1
    counts, and the caller tries what is found. sign: 1 if the error is in the recording, -1 if it
    is added to the model. spread: uncertainty of the quantity, over the step.
    """
    spectrum = _spectrum(pulls, over, finest / HARMONICS)
    if spectrum is None:
        return [], 0
    lines, waves, level, span = spectrum
    last = int(min(FINER * span / finest, (lines.size - 1) // HARMONICS))
    k = np.arange(2 * FINER, last + 1)
    likeness, energy, gained = np.zeros(k.size), np.zeros(k.size), np.zeros(lines.size)
    for j in range(1, HARMONICS + 1):
        blur = np.exp(-2.0 * (np.pi * j * spread) ** 2)
        c = (-1.0) ** j * FINER * span / (k * np.pi * j) * blur
        likeness -= sign * c * waves[j * k].imag
        energy += 0.5 * c**2 * level[j * k]
    share = np.clip(likeness / np.where(energy > 0.0, energy, np.inf), 0.0, 1.0)
    gained[k] = 2.0 * share * likeness - share**2 * energy
    return _highest(gained, span, count), k.size // FINER


def _spectrum(
    pulls: list[Pull], over: list[Floats], finest: float, ends: tuple[float, float] | None = None
) -> tuple[NDArray[np.int64], Complexes, Floats, float] | None:
    """Lines k, G and its expected power for noise at k / (FINER span), and the span.

    ends: of the span, by default of the quantity itself.
    """
    low, high = ends or (min(float(q.min()) for q in over), max(float(q.max()) for q in over))
    span = high - low
    if not span > 4.0 * finest:
        return None
    bins = 1 << min(MOST_BINS, int(np.ceil(np.log2(4.0 * FINER * span / finest))))
    total, chance = np.zeros(bins), np.zeros((DRAWS, bins))
    width = FINER * span / bins
    for pull, q in zip(pulls, over, strict=True):
        index = np.minimum(((q - low) / width).astype(np.int64), bins - 1)
        total += np.bincount(index, pull.found, bins)
        for row, drawn in zip(chance, pull.chance, strict=True):
            row += np.bincount(index, drawn, bins)
    waves = np.fft.rfft(total)
    lines = np.arange(waves.size)
    waves *= np.exp(-2j * np.pi * lines / (FINER * span) * (low + 0.5 * width))
    power = np.mean([np.abs(np.fft.rfft(row)) ** 2 for row in chance], axis=0)
    return lines, waves, _level(power, lines), span


def _level(power: Floats, lines: NDArray[np.int64]) -> Floats:
    """Smooth the power of noise over lines: over more of them at short periods.

    An error at the sensor has little power at long periods and much at short ones, so a wide mean
    would hide a long wave.
    """
    level = power
    for width in WIDTHS:
        wide = uniform_filter1d(power, min(width, power.size), mode="reflect")
        level = np.where(lines >= 2 * width, wide, level)
    return level


def _highest(gained: Floats, span: float, count: int) -> list[Peak]:
    found: list[Peak] = []
    for _ in range(count):
        k = int(np.argmax(gained))
        if gained[k] <= 0.0:
            break
        found.append(Peak(FINER * span / k, float(gained[k])))
        gained[max(0, k - FINER) : k + FINER + 1] = 0.0
    return found

"""What happens once in a recording: a force for a while, a sensor that slips. Found, and when.

A force a at a place from tick t on, for d ticks, that a model does not know leaves in its whitened
innovations

    r = a s(. - t) + e,    s_k = sum over i < d of h_(k-i),    e white,

h the response of observer, device and whitening filter to one tick. With the matched filter g_t =
sum_k h_k r_(t+k) and its running sum G, least squares over a gives for all t and d at once

    a = (G_(t+d) - G_t) / |s|^2,    gain(t, d) = (G_(t+d) - G_t)^2 / |s|^2

in chi-square, the generalised likelihood ratio (Willsky & Jones, IEEE Trans. Autom. Control 21(1),
1976). A sensor that slips is the same with h the response to its reading. Residuals that are
orthogonal to what parameters do gain more than this where the parameters move with it: it is a
lower bound. It is one pass over the residual; only what stands out of chance there is fitted.

Chance. z = sqrt(gain) of every place and duration is measured in its own median over the
recording, so that colour and missing physics, which raise it everywhere, raise no alarm. Of what
is left the highest of each of n stretches is taken, and those over their median u lie beyond it
by an exponential of mean m (peaks over threshold: Davison & Smith, J. R. Stat. Soc. B 52(3), 1990;
m = 2 for Gaussian noise). Of a gain c that chance exceeds somewhere in all that was recorded,

    P = n / 2 exp(-(c - u) / m),

an event is believed where P is less than `Evidence.alpha` at the odds that something happens at
all. m is the largest mean excess over three thresholds, so that a recording in which such peaks are
common has no events but a model that lacks something. That is asked before anything is fitted, too,
with the highest peaks set aside, which may be events and then are no chance.

Limits: of events that last longer than `EVENTS.longest_s`, or than what would be left of the
recording beside the most events there may be, nothing is said. The response h is that of the device
without its nonlinear physics: it finds, and the kernel then fits (`time.force`).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve

from zwidth.diagnosis.fitting.fit import Fitted
from zwidth.diagnosis.forces.spatial import response
from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.hypothesis import Hypothesis, judged, settled
from zwidth.diagnosis.settings import CHANGES, EVENTS, EVIDENCE
from zwidth.diagnosis.time.force import (
    Happened,
    Pulse,
    Source,
    fitted_event,
    sources,
    with_events,
)

Floats = NDArray[np.float64]
FitOn = Callable[[Sequence[Happened]], Sequence[Experiment]]
ONSET = SETTLING * 3  # ticks, until the slowest observer has forgotten how it began


class Peak(NamedTuple):
    """The best of the bank: in which recording, of which source, first tick, duration; gain."""

    recording: int
    source: Source
    first: int
    ticks: int
    gain: float


class Chance(NamedTuple):
    """What noise reaches: n / 2 exp(-(c - u) / m) of all recordings is beyond c."""

    stretches: int
    median: float
    excess: float

    @property
    def most(self) -> float:
        """The gain that an event must have."""
        odds = math.log(max(self.stretches, 2) / 2.0 / EVIDENCE.alpha) + 0.5 * CHANGES.rarity
        return self.median + self.excess * odds


def highest(recordings: Sequence[Experiment], h: Hypothesis) -> Peak | None:
    """Return the highest peak of all, None where chance reaches it: nothing is fitted.

    Raises NoObserver where the recordings cannot be followed.
    """
    peak, chance = _searched(judged(recordings, h.model, h.x), (), CHANGES.most)
    return peak if peak is not None and peak.gain > chance.most else None


def happenings(
    recordings: Sequence[Experiment], h: Hypothesis, fit_on: FitOn
) -> tuple[Happened, ...]:
    """Return what happens once in recordings, as a fitted hypothesis sees them; the first first.

    recordings: whole, without forces of events; fit_on: gives what parameters are fitted to where
    some events are known. They are fitted anew with each, since what happened has bent them, and
    each event then under the noise that is left: noise that knows nothing of an event takes its
    colour for its own. Raises NoObserver where none follows.
    """
    found: list[Happened] = []
    for _ in range(3 * CHANGES.most):  # each may have a few pulses
        seen = judged(with_events(recordings, found), h.model, h.x)
        peak, chance = _searched(seen, found, CHANGES.most - len(found))
        if peak is None or peak.gain <= chance.most:
            break
        near = [one for one in found if _near(one, peak, seen.experiments[0].period)]
        pulses = [pulse for one in near for pulse in one.pulses]
        again = Pulse(peak.first, peak.ticks)
        full = not near and len(found) >= CHANGES.most
        if full or again in pulses:  # all that a force there explains is explained
            break
        rest = [one for one in found if one not in near]
        beside = replace(seen, experiments=with_events(recordings, rest))
        found = [*rest, fitted_event(beside, peak.recording, [*pulses, again])]
        h = settled(judged(fit_on(found), h.model, h.x, h.family), turns=2)
        found = _fitted_again(recordings, found, h)
    kept = _believed(recordings, found, h)
    return tuple(sorted(kept, key=lambda one: (one.recording, one.first)))


def _fitted_again(
    recordings: Sequence[Experiment], found: Sequence[Happened], h: Hypothesis
) -> list[Happened]:
    """Each event beside the others, first anywhere and then where it is, under the noise then."""
    new = list(found)
    for anywhere in (True, False):
        seen = judged(with_events(recordings, new), h.model, h.x)
        for i, one in enumerate(new):
            others = with_events(recordings, [*new[:i], *new[i + 1 :]])
            beside, there = replace(seen, experiments=others), None if anywhere else one.source
            again = fitted_event(beside, one.recording, one.pulses, there)
            new[i] = again if anywhere else replace(again, elsewhere=one.elsewhere)
    return new


def _believed(
    recordings: Sequence[Experiment], found: list[Happened], h: Hypothesis
) -> list[Happened]:
    """Those that stand out of what chance does where none of them is; the weakest is asked first.

    One that goes is part of what chance does for the others. Beside others an event must stand out
    where these alone are known, or it is what they have left.
    """
    while found:
        seen = judged(with_events(recordings, found), h.model, h.x)
        _, chance = _searched(seen, found)
        weakest = min(found, key=lambda one: one.gain)
        rest = [one for one in found if one is not weakest]
        if weakest.gain > chance.most:
            if not rest:
                break
            peak, chance = _searched(judged(with_events(recordings, rest), h.model, h.x), found)
            period = seen.experiments[0].period
            if peak is not None and _near(weakest, peak, period) and peak.gain > chance.most:
                break
        found = rest
    return found


def _near(one: Happened, peak: Peak, period: float) -> bool:
    """Whether a pulse is part of an event: no farther from it than either is long, or 8 hits."""
    far = max(round(8.0 * EVENTS.short_s / period), one.last - one.first, peak.ticks)
    ends = peak.first + peak.ticks
    apart = peak.first - one.last > far or one.first - ends > far
    return one.recording == peak.recording and not apart


def _searched(
    h: Hypothesis, known: Sequence[Happened], aside: int = 0, stretch: int = 64
) -> tuple[Peak | None, Chance]:
    """The highest of all peaks, and what chance reaches in stretches beside known events.

    aside: so many of the highest peaks are no chance either, but may be events yet unknown.
    stretch: ticks of which the highest peak counts for chance.
    """
    fitted = Fitted(h.model, h.x, 0.0, h.residual, np.zeros((0, 0)), h.samples)
    answers = [
        (
            s,
            response(
                h.problem, fitted, "sensor" if s.sensor is not None else s.place, s.sensor or 0
            ),
        )
        for s in sources(h)
    ]
    outputs, row = h.noise.observer.deviation.size, 0
    gains: list[Floats] = []
    kinds: list[list[tuple[Source, int]]] = []
    for e in h.experiments:
        white = np.zeros((e.ticks, outputs))
        rows = (e.ticks - SETTLING) * outputs
        white[SETTLING:] = h.residual[row : row + rows].reshape(-1, outputs)
        row += rows
        own, which = _gains(white, answers, e)
        own[:ONSET] = 0.0
        gains.append(own)
        kinds.append(which)
    best = _highest(gains, kinds)
    kept = [g.copy() for g in gains]
    for one in known:
        _mask(kept[one.recording], one.first, one.last, stretch)
    for _ in range(aside):
        if (top := _highest(kept, kinds)) is not None:
            left = sum(_stretches(own, stretch).size for own in kept)
            # All of a long event, as far as enough is left to tell chance by.
            beside = _longest(h.experiments[top.recording]) // 3 if left > 36 else 0
            _mask(kept[top.recording], top.first - beside, top.first + top.ticks + beside, stretch)
    return best, _chance(np.concatenate([_stretches(own, stretch) for own in kept]))


def _highest(gains: Sequence[Floats], kinds: Sequence[list[tuple[Source, int]]]) -> Peak | None:
    tops = [float(np.nan_to_num(own, nan=0.0).max(initial=0.0)) for own in gains]
    i = int(np.argmax(tops))
    if not tops[i] > 0.0:
        return None
    first = int(np.nanargmax(gains[i]))
    source, ticks = kinds[i][first]
    return Peak(i, source, first, ticks, tops[i])


def _mask(gains: Floats, first: int, last: int, stretch: int) -> None:
    """Take out what an event touches: its own ticks, and those that hold its pulses."""
    gains[max(0, first - stretch) : last + 2 * stretch] = np.nan


def _stretches(gains: Floats, stretch: int) -> Floats:
    """The highest gain of each stretch of which nothing was taken out."""
    starts = range(ONSET, gains.size - stretch + 1, stretch)
    every = np.array([gains[a : a + stretch].max() for a in starts])
    return every[np.isfinite(every)]


def _longest(e: Experiment) -> int:
    """Ticks of the longest event that is asked for."""
    most = min(EVENTS.longest_s / e.period, e.ticks / (CHANGES.most + 1))
    return max(1, round(most))


def _gains(
    white: Floats, answers: Sequence[tuple[Source, Floats]], e: Experiment
) -> tuple[Floats, list[tuple[Source, int]]]:
    """The best gain of what begins at each tick (ticks,), in its own median; and what it is."""
    ticks, longest = white.shape[0], _longest(e)
    count = 1 + int(2.0 * math.log2(longest))  # two durations an octave
    lengths = np.unique(np.round(np.geomspace(1.0, longest, count)))
    best, labels = np.zeros(ticks), np.zeros(ticks, dtype=np.int64)
    each: list[tuple[Source, int]] = []
    for source, h in answers:
        if source.lasting:
            durations = [(_onset(white, h), 1)]
        else:
            total = np.append(0.0, np.cumsum(_matched(white, h)))
            durations = [_of_length(total, h, int(d)) for d in lengths]
        for score, d in durations:
            usual = float(np.median(np.abs(score[ONSET:]))) / 0.6745  # of |z| of a normal
            gained = (score / max(1.0, usual)) ** 2
            better = gained > best
            best[better], labels[better] = gained[better], len(each)
            each.append((source, d))
    return best, [each[i] for i in labels]


def _matched(white: Floats, h: Floats) -> Floats:
    """The matched filter g (ticks,)."""
    ticks, every = white.shape[0], range(h.shape[1])
    return np.sum([fftconvolve(white[::-1, o], h[:, o])[:ticks][::-1] for o in every], axis=0)


def _onset(white: Floats, h: Floats, seen: int = 100) -> Floats:
    """The score (ticks,) of what sets in for good, by what it does in the first ticks."""
    s = np.cumsum(h[:seen], axis=0)
    return _matched(white, s) / math.sqrt(max(float(np.sum(s**2)), 1e-300))


def _of_length(total: Floats, h: Floats, d: int) -> tuple[Floats, int]:
    """The score (ticks,) of d ticks."""
    step = np.cumsum(h, axis=0)
    s = np.vstack([step, np.repeat(step[-1:], d, axis=0)])
    s[d:] -= step
    score = np.zeros(total.size - 1)
    score[: total.size - d] = (total[d:] - total[:-d]) / math.sqrt(max(float(np.sum(s**2)), 1e-300))
    return score, d


def _chance(highest: Floats, fewest: int = 12) -> Chance:
    """Chance by the highest gain of each stretch; none is beyond it where they are fewer."""
    if highest.size < fewest:
        return Chance(max(1, highest.size), math.inf, 2.0)
    levels = np.quantile(highest, (0.5, 0.75, 0.9))
    over = [float(np.mean(highest[highest > level] - level)) for level in levels
            if np.any(highest > level)]  # fmt: skip
    return Chance(highest.size, float(levels[0]), max([2.0, *over]))  # 2 of Gaussian noise

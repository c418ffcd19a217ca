"""Finds events that happen once in a recording, such as a push or a sensor slip, and when.

A missing force a at a place, from tick t on for d ticks, gives the whitened innovations

    r = a s(. - t) + e,    s_k = sum over i < d of h_(k-i),    e white,

where h is the response of observer, device and whitening filter to a force of one tick. With the
matched filter g_t = sum_k h_k r_(t+k) and its running sum G, least squares over a gives for all t
and d at once

    a = (G_(t+d) - G_t) / |s|^2,    gain(t, d) = (G_(t+d) - G_t)^2 / |s|^2

in chi-square: the generalised likelihood ratio (Willsky & Jones, IEEE Trans. Autom. Control 21(1),
1976). For a slip of a sensor, h is the response to its reading. This is a lower bound: a fit
together with the parameters gains more.

Chance. z = sqrt(gain) of every place and duration is divided by its own median over the recording,
so that coloured noise and missing physics, which raise z everywhere, raise no alarm. The maximum of
each of n stretches is then taken. Maxima above their median u exceed it by an exponentially
distributed amount of mean m (peaks over threshold: Davison & Smith, J. R. Stat. Soc. B 52(3), 1990;
m = 2 for Gaussian noise). Chance exceeds a gain c somewhere in the recordings with

    P = n / 2 exp(-(c - u) / m),

and an event is believed if P is less than `ALPHA` times the odds that something happens at all. m
is the largest mean excess over three thresholds. So a recording with many such peaks has no events;
its model lacks something. Before any fit, the k = `EVENTS.most` highest peaks may all be events,
and are excluded from chance; what then looks like an event is tested again once it is fitted. Where
a part of a recording is set apart there is no such second test, so m counts the k as chance that
exceeds the highest that is left, h: the likeliest mean of a sample of which the k highest are known
no closer, and l excesses are left, is

    m = (sum of excesses + k (h - u)) / l

(Epstein & Sobel, J. Am. Stat. Assoc. 48(263), 1953), whatever the k are. Without the second term,
chance passes ten times as often (20 000 draws of 60 maxima), and each time costs a search.

Limits: at most `EVENTS.most` events; events that last longer than 3 s or a fifth of the recording
are not found. The response h, which only finds an event, is that of the device without its
nonlinear physics; the kernel then fits the event (`learning.event_force`).
"""

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve

from zwidth.diagnosis.fitting.fit import Fitted
from zwidth.diagnosis.forces.spatial import response
from zwidth.diagnosis.learning.event_force import Happened, Pulse, Source, fitted_event
from zwidth.diagnosis.learning.scatter import scatter_in_like_states
from zwidth.diagnosis.noise.family import SLOWER
from zwidth.diagnosis.noise.loudness import loudness
from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.hypothesis import Hypothesis, judged, settled
from zwidth.diagnosis.settings import EVENTS, EVIDENCE
from zwidth.sim.place import masses_and_links

Floats = NDArray[np.float64]
TURNS = 24  # most turns of the search, for all events together
REFITS = 2  # turns of parameters and noise with events, and of events with that noise
TOGETHER, GAINED = 6, 2.0  # turns of all, at most; gain in -2 ln that justifies another
PER_OCTAVE = 2  # durations
SEEN = 100  # ticks after the onset of a permanent event, by which it is found
STRETCH = 64  # ticks, of which the highest gain counts
FEWEST = 12  # stretches from which chance is estimated
THRESHOLDS = (0.5, 0.75, 0.9)  # quantiles over which excesses are averaged
GAUSSIAN = 2.0  # mean excess of a chi-square of one
MEDIAN = 0.6745  # median of |z| of a normal distribution
SHORTEST_PART = 6 * SETTLING  # ticks beside an event that are searched
ONSET = 3 * SETTLING  # ticks after which the slowest observer has forgotten its start


FitOn = Callable[[Sequence[Happened]], Sequence[Experiment]]


class Peak(NamedTuple):
    """The highest gain of all filters: its recording, source, first tick, duration and size."""

    recording: int
    source: Source
    first: int
    ticks: int
    gain: float

    @property
    def last(self) -> int:
        """The first tick after it."""
        return self.first + self.ticks


@dataclass(frozen=True)
class Chance:
    """The distribution of chance: P = n / 2 exp(-(c - u) / m) exceeds c."""

    count: int
    median: float
    excess: float

    @property
    def most(self) -> float:
        """The gain that an event must have."""
        odds = math.log(max(self.count, 2) / 2.0) + math.log(1.0 / EVIDENCE.alpha)
        odds += 0.5 * EVIDENCE.rarity_of_once
        return self.median + self.excess * odds


def happenings(
    recordings: Sequence[Experiment],
    h: Hypothesis,
    fit_on: FitOn,
) -> tuple[Happened, ...]:
    """Return the events of recordings according to a fitted hypothesis; in order of time.

    recordings: whole, without forces of events; fit_on: returns the recordings of the fit with some
    events known. Parameters are fitted again with each event, which has distorted them. May raise
    NoObserver.
    """
    found: list[Happened] = []
    for _ in range(TURNS):
        seen = _judged(recordings, found, h)
        peak, chance = _searched(seen, found, EVENTS.most - len(found))
        if peak is None or peak.gain <= chance.most:
            break
        near = [one for one in found if _near(one, peak, seen.experiments[0].period)]
        if not near and len(found) >= EVENTS.most:
            break
        rest = [one for one in found if one not in near]
        pulses = [pulse for one in near for pulse in one.pulses]
        again = Pulse(peak.first, peak.ticks)
        if again in pulses:  # a force there explains no more
            break
        beside = replace(seen, experiments=with_events(recordings, rest))
        new = fitted_event(beside, peak.recording, [*pulses, again])
        found, h = _agreed(recordings, [*rest, new], h, fit_on)
    kept = _believed(recordings, found, h, fit_on)
    return tuple(sorted(kept, key=lambda one: (one.recording, one.first)))


def highest(recordings: Sequence[Experiment], h: Hypothesis) -> Peak | None:
    """Return the highest peak before any fit, None if chance reaches it.

    The most likely noise of all recordings includes part of an event; a peak that still exceeds it
    is one. May raise NoObserver.
    """
    peak, chance = _searched(judged(recordings, h.model, h.x), (), EVENTS.most)
    return peak if peak is not None and peak.gain > chance.most else None


def set_apart(h: Hypothesis) -> list[Experiment] | None:
    """Return a hypothesis's recordings without the most improbable peak; None if there is none.

    Both its own noise and a slower one are tried, since the most likely noise attributes a long
    force to disturbance. The recording is cut around a force, which would otherwise hide missing
    physics; a slip is permanent, and is subtracted from the reading.
    """
    views = [h if h.family.whitening else _judged(h.experiments, (), h)]
    with suppress(NoObserver):
        views.append(views[0].under(SLOWER * views[0].ratio))
    found = [(*_searched(seen, (), EVENTS.most, counted=True), seen) for seen in views]
    clear = [(peak, seen) for peak, chance, seen in found if peak and peak.gain > chance.most]
    if not clear:
        return None
    peak, seen = max(clear, key=lambda one: one[0].gain)
    one = fitted_event(seen, peak.recording, [Pulse(peak.first, peak.ticks)])
    if one.source.lasting:
        return with_events(h.experiments, [one])
    parts = list(h.experiments)
    e, beside = parts[one.recording], (one.last - one.first) // 3
    ends = ((0, one.first - beside), (one.last + beside, e.ticks))
    kept = [e.part(a, b) for a, b in ends if b - a >= SHORTEST_PART]
    parts[one.recording : one.recording + 1] = kept
    return parts or None


def _agreed(
    recordings: Sequence[Experiment], found: list[Happened], h: Hypothesis, fit_on: FitOn
) -> tuple[list[Happened], Hypothesis]:
    """Fit events, parameters and noise in turn, until neither gains.

    At distorted parameters the remainder of an event looks like another event, and noise fitted
    without an event includes it. So in each turn events are fitted twice, in the first turns first
    at all places.
    """
    before = math.inf
    for turn in range(TOGETHER):
        h = settled(judged(fit_on(found), h.model, h.x, h.family), turns=REFITS)
        if before - h.cost.misfit < GAINED:
            break
        before = h.cost.misfit
        for again in range(REFITS):
            free, seen = turn < REFITS and again == 0, _judged(recordings, found, h)
            for i, one in enumerate(found):
                others = with_events(recordings, [*found[:i], *found[i + 1 :]])
                beside, source = replace(seen, experiments=others), None if free else one.source
                new = fitted_event(beside, one.recording, one.pulses, source)
                found[i] = new if free else replace(new, elsewhere=one.elsewhere)
    return found, h


def _believed(
    recordings: Sequence[Experiment], found: list[Happened], h: Hypothesis, fit_on: FitOn
) -> list[Happened]:
    """The events that exceed chance in recordings without them; the weakest is tested first.

    A dropped event becomes part of the chance of the others. An event beside others must stand out
    after a fit with only the others known; otherwise it is a remainder of them.
    """
    while found:
        _, chance = _searched(_judged(recordings, found, h), found)
        weakest = min(found, key=lambda one: one.gain)
        rest = [one for one in found if one is not weakest]
        if weakest.gain > chance.most and not rest:
            break
        others, own = _agreed(recordings, rest, h, fit_on)
        if weakest.gain > chance.most:
            seen = _judged(recordings, others, own)
            peak, chance = _searched(seen, found)
            period = seen.experiments[0].period
            if peak is not None and _near(weakest, peak, period) and peak.gain > chance.most:
                break
        found, h = others, own
    return found


def _judged(
    recordings: Sequence[Experiment], found: Sequence[Happened], h: Hypothesis
) -> Hypothesis:
    """The hypothesis with known events and the noise of the fit, which excludes events."""
    there = with_events(recordings, found)
    if not h.family.whitening:
        return judged(there, h.model, h.x)
    return h.on(there)


def with_events(recordings: Sequence[Experiment], found: Sequence[Happened]) -> list[Experiment]:
    """Return recordings with their events: forces act, slips are subtracted."""
    known = list(recordings)
    for one in found:
        known[one.recording] = one.on(known[one.recording])
    return known


def _near(one: Happened, peak: Peak, period: float) -> bool:
    """Whether a peak belongs to an event: no farther from it than either is long."""
    far = max(round(EVENTS.apart_s / period), one.last - one.first, peak.ticks)
    ends = peak.first + peak.ticks
    apart = peak.first - one.last > far or one.first - ends > far
    return one.recording == peak.recording and not apart


class _Answer(NamedTuple):
    """Response h (length, o) of the innovations to one tick of a source."""

    source: Source
    h: Floats


def _searched(
    h: Hypothesis, known: Sequence[Happened], aside: int = 0, *, counted: bool = False
) -> tuple[Peak | None, Chance]:
    """The highest peak, and the distribution of chance in stretches beside known events.

    Innovations are divided by the loudness of the noise (`noise.loudness`). aside: number of
    highest peaks to exclude, which may be unknown events; counted: whether they count as chance all
    the same, since no fit tests them. With nonsmooth laws, an event must also exceed chance among
    like states.
    """
    white, answers = _in_ticks(h), _answers(h)
    loud = loudness(white, [e.command for e in h.experiments])
    white = [r / louder[:, None] for r, louder in zip(white, loud, strict=True)]
    peak, chance = _standing_out(h, white, answers, known, aside, counted=counted)
    gaussian = replace(chance, excess=min(chance.excess, GAUSSIAN))
    if not h.creased or peak is None or peak.gain <= gaussian.most:
        return peak, chance
    apart = [np.zeros(e.ticks, dtype=np.bool_) for e in h.experiments]
    for one in known:
        apart[one.recording][_touched(one)] = True
    scales = scatter_in_like_states(h, apart)
    white = [r / scale for r, scale in zip(white, scales, strict=True)]
    among_alike, chance = _standing_out(h, white, answers, known, aside, counted=counted)
    if among_alike is None or among_alike.recording != peak.recording:
        return among_alike, chance
    if abs(among_alike.first - peak.first) > STRETCH:
        return among_alike, chance
    return peak._replace(gain=among_alike.gain), chance  # the time comes from unscaled gains


def _in_ticks(h: Hypothesis) -> list[Floats]:
    """The whitened innovations (ticks, o) of each recording, zero while an observer settles."""
    row, outputs = 0, h.noise.observer.deviation.size
    found: list[Floats] = []
    for e in h.experiments:
        white = np.zeros((e.ticks, outputs))
        rows = (e.ticks - SETTLING) * outputs
        white[SETTLING:] = h.residual[row : row + rows].reshape(-1, outputs)
        row += rows
        found.append(white)
    return found


def _standing_out(
    h: Hypothesis,
    white: Sequence[Floats],
    answers: Sequence[_Answer],
    known: Sequence[Happened],
    aside: int,
    *,
    counted: bool,
) -> tuple[Peak | None, Chance]:
    """As `_searched`, for whitened innovations (ticks, o) of each recording."""
    gains: list[Floats] = []
    kinds: list[list[tuple[Source, int]]] = []
    for e, r in zip(h.experiments, white, strict=True):
        own, which = _gains(r, answers, e)
        own[:ONSET] = 0.0
        gains.append(own)
        kinds.append(which)
    best = _highest(gains, kinds)
    kept = [g.copy() for g in gains]
    for one in known:
        kept[one.recording][_touched(one)] = np.nan
    excluded = 0
    for _ in range(aside):
        if (top := _highest(kept, kinds)) is not None:
            excluded += 1
            left = sum(_stretches(own).size for own in kept)
            # All of a long event, if enough is left to estimate chance.
            beside = _longest(h.experiments[top.recording]) // 3 if left > 3 * FEWEST else 0
            there = _touching(top.first - beside, top.first + top.ticks + beside)
            kept[top.recording][there] = np.nan
    chance = np.concatenate([_stretches(own) for own in kept])
    return best, _chance(chance, excluded if counted else 0)


def _highest(gains: Sequence[Floats], kinds: Sequence[list[tuple[Source, int]]]) -> Peak | None:
    tops = [float(np.nan_to_num(own, nan=0.0).max(initial=0.0)) for own in gains]
    i = int(np.argmax(tops))
    if not tops[i] > 0.0:
        return None
    first = int(np.nanargmax(gains[i]))
    source, ticks = kinds[i][first]
    return Peak(i, source, first, ticks, tops[i])


def _touching(first: int, last: int) -> slice:
    """The ticks of an event and those around it that its filters include."""
    return slice(max(0, first - STRETCH), last + 2 * STRETCH)


def _touched(one: Happened) -> slice:
    return _touching(one.first, one.last)


def _stretches(gains: Floats) -> Floats:
    """The highest gain of each stretch without removed ticks."""
    starts = range(ONSET, gains.size - STRETCH + 1, STRETCH)
    every = np.array([gains[a : a + STRETCH].max() for a in starts])
    return every[np.isfinite(every)]


def _answers(h: Hypothesis) -> list[_Answer]:
    """The response to one tick of every source."""
    problem, model = h.problem, h.model
    fitted = Fitted(model, h.x, 0.0, h.residual, np.zeros((0, 0)), h.samples)
    device = model.build(h.x)
    n = device.chain.masses.size
    found: list[_Answer] = []
    for place in masses_and_links(n):
        answer = -response(problem, fitted, str(place))
        found.append(_Answer(Source(str(place)), answer))
        if place.kind == "link" or (place.index == 0 and device.chain.ground_spring > 0.0):
            found.append(_Answer(Source(str(place), lasting=True), answer))
    for o, output in enumerate(h.experiments[0].outputs):
        if output.quantity == "position":
            answer = response(problem, fitted, "sensor", o)
            found.append(_Answer(Source(output.name, sensor=o, lasting=True), answer))
    return found


def _longest(e: Experiment) -> int:
    """Ticks of the longest event that is sought."""
    return max(1, round(min(EVENTS.longest_s / e.period, EVENTS.longest_share * e.ticks)))


def _gains(
    white: Floats, answers: Sequence[_Answer], e: Experiment
) -> tuple[Floats, list[tuple[Source, int]]]:
    """The best scaled gain of an event that begins at each tick (ticks,); its source and length."""
    ticks, longest = white.shape[0], _longest(e)
    octaves = math.log2(longest)
    lengths = np.unique(np.round(2.0 ** np.linspace(0.0, octaves, 1 + int(PER_OCTAVE * octaves))))
    best, labels = np.zeros(ticks), np.zeros(ticks, dtype=np.int64)
    each: list[tuple[Source, int]] = []
    for source, h in answers:
        pull = sum(fftconvolve(white[::-1, o], h[:, o])[:ticks][::-1] for o in range(h.shape[1]))
        total = np.append(0.0, np.cumsum(pull))
        if source.lasting:
            durations = [(_onset(white, h), 1)]
        else:
            durations = [_of_length(total, h, int(d)) for d in lengths]
        for score, d in durations:
            late = np.abs(score[ONSET:])  # empty for a short part
            usual = float(np.median(late)) / MEDIAN if late.size else math.inf
            gained = (score / max(1.0, usual)) ** 2
            better = gained > best
            best[better], labels[better] = gained[better], len(each)
            each.append((source, d))
    return best, [each[i] for i in labels]


def _onset(white: Floats, h: Floats) -> Floats:
    """The score (ticks,) of a permanent event, from its first ticks."""
    s, ticks = np.cumsum(h[:SEEN], axis=0), white.shape[0]
    pull = [fftconvolve(white[::-1, o], s[:, o])[:ticks][::-1] for o in range(s.shape[1])]
    return np.sum(pull, axis=0) / math.sqrt(max(float(np.sum(s**2)), 1e-300))


def _of_length(total: Floats, h: Floats, d: int) -> tuple[Floats, int]:
    """The score (ticks,) of d ticks."""
    step = np.cumsum(h, axis=0)
    s = np.vstack([step, np.repeat(step[-1:], d, axis=0)])
    s[d:] -= np.vstack([step, np.repeat(step[-1:], d, axis=0)])[: s.shape[0] - d]
    score = np.zeros(total.size - 1)
    score[: total.size - d] = (total[d:] - total[:-d]) / math.sqrt(max(float(np.sum(s**2)), 1e-300))
    return score, d


def _chance(highest: Floats, excluded: int = 0) -> Chance:
    """Chance by the highest gains of stretches; excluded: how many are higher than all of these."""
    if highest.size < FEWEST:
        return Chance(max(1, highest.size), math.inf, GAUSSIAN)
    levels = np.quantile(highest, THRESHOLDS)
    over: list[float] = []
    for level in levels:
        excess = highest[highest > level] - level
        if excess.size:
            over.append(float(np.sum(excess) + excluded * np.max(excess)) / excess.size)
    return Chance(highest.size, float(levels[0]), max([GAUSSIAN, *over]))

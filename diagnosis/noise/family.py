"""The noise models from which a hypothesis may choose, all evaluated at once.

A model of the noise consists of the share of the motion that is disturbance (the observer's ratio
of process to measurement variance), and the spectrum and covariance of the innovations (the filters
that whiten them). For one device at one x, the members of the family differ only in their
observers, so they are lanes of one population: the same device with different gains.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.account import reason
from zwidth.diagnosis.fitting.fit import Problem
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.beginning import Beginnings, by_own_slopes, with_play
from zwidth.diagnosis.noise.gaps import Changing, Gain, changing, steadily
from zwidth.diagnosis.noise.predictor import (
    SEARCHING,
    SETTLING,
    Observer,
    in_motion,
    innovations,
    prepared,
    told,
    unit_of,
    whitened,
)
from zwidth.diagnosis.noise.steady import (
    NoObserver,
    links_with_play,
    steady_gains,
    with_apart,
)
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.sim.device import Device

Floats = NDArray[np.float64]
# From trusting the device almost fully to hardly at all. At 1e-10 an observer of positions
# forgets in 300 ticks; coarse encoders on quiet machines need 1e-9 (43 in -2 ln over 1e-7 on a
# rig of four effects), and beyond either end nothing changes.
FAMILY = np.geomspace(1e-10, 1e7, 18)
SLOWER = 1e-2  # of the likeliest ratio, of an observer that leaves more of missing physics to see
WORTH = 1.0  # in -2 ln, for which a motion is followed again
NEAR_RATIOS = 2.5  # decades about the last ratio, within which the next is sought


@dataclass(frozen=True)
class Family:
    """The noise models from which a hypothesis may choose.

    ratios: of their observers. whitening: whether innovations are filtered to be white, so that
    one-step errors decide; without it, errors count as far ahead as the observer looks. counts: as
    how many independent samples each sample then counts.
    """

    ratios: tuple[float, ...]
    whitening: bool = True
    counts: float = 1.0

    def of(self, ratio: float) -> "Family":
        """Return the family of one ratio alone."""
        return replace(self, ratios=(ratio,))

    def near(self, ratio: float) -> "Family":
        """Return the family of ratios near one, or near its own end if that is beyond it."""
        there = min(max(ratio, min(self.ratios)), max(self.ratios))
        about = [r for r in self.ratios if abs(math.log10(r / there)) < NEAR_RATIOS]
        return replace(self, ratios=tuple(about))


def blind(ratio: float) -> Family:
    """Return the family of one ratio, without whitening, after which all observers would agree."""
    return Family((ratio,), whitening=False)


NEXT_SAMPLE = Family(tuple(FAMILY.tolist()))


def as_far_as(horizon: float, experiments: Sequence[Experiment]) -> Family:
    """Return the noise model that counts errors over a horizon [s] and not one step ahead.

    The steady observer of a rigid body under white force with white noise of its position has poles
    of omega_0 with (omega_0 T)^4 = ratio, of its velocity omega_0 T = sqrt(ratio): its memory is T
    / ratio^(1/4), or T / ratio^(1/2).
    """
    first = experiments[0]
    power = 4.0 if any(o.quantity == "position" for o in first.outputs) else 2.0
    return Family(((first.period / horizon) ** power,), whitening=False)


class Course(NamedTuple):
    """What an observer found of a recording.

    start (2n,): the addition to positions and velocities at its beginning; motions: as in
    `Experiment`.
    """

    start: Floats
    motions: Floats | None = None


@dataclass(frozen=True)
class Noise:
    """The noise model of a hypothesis: its observer, and what that found of each recording.

    cost: -2 log likelihood, up to a constant. weighed: the weighted innovations (samples,).
    """

    observer: Observer
    courses: tuple[Course, ...]
    cost: float
    weighed: Floats

    def problem(self, experiments: Sequence[Experiment]) -> Problem:
        """Return the recordings under this model of their noise."""
        return Problem(_as(experiments, self.courses), self.observer, SEARCHING)


def _as(experiments: Sequence[Experiment], courses: Sequence[Course]) -> list[Experiment]:
    each = zip(experiments, courses, strict=True)
    return [replace(e, start=b.start, motions=b.motions) for e, b in each]


def likeliest(
    experiments: Sequence[Experiment],
    model: Model,
    x: Floats,
    family: Family = NEXT_SAMPLE,
    begun: Sequence[Course] | None = None,
) -> Noise:
    """Return the most likely noise model; raises NoObserver if no observer is possible.

    begun: with play, what an observer of a similar model found, so that it need not be sought
    again.
    """
    began = _Began(experiments, model, x, family)
    known = begun is not None and all(began.has_states_of(c) for c in begun)
    with reason("noise"):
        found = began.noises(family, begun) if begun and known else began.linear()
    if not found:
        raise NoObserver(
            f"no observer of this device ({model.label}) predicts the recordings; check sign, scale"
            " and units of the command, of forces that were recorded, and of the outputs"
        )
    best = min(found, key=lambda noise: noise.cost)
    if not with_play(began.device.physics):
        return best
    with reason("beginnings"):
        if not known:
            best = began.better(best, begun or began.starts(best))
        if begun and not known:
            return best
        near, cost = family, math.inf
        while best.cost < cost - WORTH:
            cost = best.cost
            asked = began.noises(near, began.in_motion(best))
            best = min([best, *asked], key=lambda noise: noise.cost)
            near = near.near(best.observer.ratio)
        return best


def noises(
    experiments: Sequence[Experiment], model: Model, x: Floats, family: Family = NEXT_SAMPLE
) -> list[Noise]:
    """Return the noise models with which the device at x can be followed, by steady observers."""
    return _Began(experiments, model, x, family).linear()


def _noise(
    gain: Gain,
    ratio: float,
    family: Family,
    courses: Sequence[Course],
    errors: Sequence[Floats],
    experiments: Sequence[Experiment],
) -> Noise | None:
    """The noise of recordings with an observer; None if this cannot follow them."""
    if not all(np.all(np.isfinite(e)) for e in errors):
        return None
    share = told(experiments)
    far = _deviation(errors) / math.sqrt(share * family.counts)
    plain = Observer(gain, far, ratio, counts=family.counts, told=share)
    try:
        white = whitened(plain, errors, experiments) if family.whitening else plain
    except NoObserver:
        return None
    weighed = np.concatenate(
        [
            white.weigh(e, one.uncounted)[SETTLING:].ravel()
            for e, one in zip(errors, experiments, strict=True)
        ]
    )
    cost = white.cost(weighed)
    return Noise(white, tuple(courses), cost, weighed) if np.isfinite(cost) else None


class _Began:
    """What observers of a device find of recordings."""

    def __init__(
        self, experiments: Sequence[Experiment], model: Model, x: Floats, family: Family
    ) -> None:
        self.experiments, self.family, self.device = experiments, family, model.acting(x)
        self.seen = [model.seen(e, x) for e in experiments]

    def has_states_of(self, course: Course) -> bool:
        """Whether motions are known, of as many states as this device has."""
        known = course.motions
        return known is not None and known.shape[1] == self.device.bare().plant().size

    def gains(self, ratios: Sequence[float], *, follows: bool) -> list[tuple[float, Gain]]:
        """Return the ratios that have an observer, with its gain; follows: as in `gaps`."""
        bare, first = self.device.bare(), self.seen[0]
        gains = steady_gains([bare] * len(ratios), first, np.array(ratios))
        if links := links_with_play(self.device):
            gains = with_apart(bare, links, first, gains)
        return [
            (ratio, changing(bare, self.seen, ratio, gain, follows=follows))
            for ratio, gain in zip(ratios, gains, strict=True)
            if np.all(np.isfinite(gain))
        ]

    def linear(self) -> list[Noise]:
        """Return the noise models of steady observers, which begin as linear ones do."""
        each = self.gains(self.family.ratios, follows=False)
        if not each:
            return []
        usable = [gain for _, gain in each]
        begins = {id(e.changes): Beginnings(e.on(self.device), usable) for e in self.seen}
        asked = [(begins[id(e.changes)], e) for e in self.seen]
        followed = [(starts := b.of(e), b.followed(e, starts)) for b, e in asked]
        found: list[Noise | None] = []
        for i, (ratio, gain) in enumerate(each):
            courses = [Course(starts[i]) for starts, _ in followed]
            errors = [e[i] for _, e in followed]
            found.append(_noise(gain, ratio, self.family, courses, errors, self.experiments))
        return [noise for noise in found if noise is not None]

    def noises(self, family: Family, courses: Sequence[Course]) -> list[Noise]:
        """Return the noise models of a family on given courses, in their motions."""
        each = self.gains(family.ratios, follows=True)
        if not each:
            return []
        gains = [gain for _, gain in each]
        errors = [
            Beginnings(e.on(self.device), gains).followed(e, np.tile(c.start, (len(gains), 1)))
            for e, c in zip(_as(self.seen, courses), courses, strict=True)
        ]
        found = [
            _noise(gain, ratio, family, courses, [e[i] for e in errors], self.experiments)
            for i, (ratio, gain) in enumerate(each)
        ]
        return [noise for noise in found if noise is not None]

    def starts(self, noise: Noise) -> list[Course]:
        """Return the courses with the initial states that play needs."""
        each = zip(_as(self.seen, noise.courses), noise.courses, strict=True)
        return [
            c._replace(start=by_own_slopes(self.device, e, noise.observer, c.start))
            for e, c in each
        ]

    def in_motion(self, noise: Noise) -> list[Course]:
        """Return the courses with the motions along which the noise's observer follows them."""
        observer = noise.observer
        gain = changing(
            self.device.bare(), self.seen, observer.ratio, steadily(observer.gain), follows=True
        )
        each = zip(_as(self.seen, noise.courses), noise.courses, strict=True)
        assert isinstance(gain, Changing)
        unit = unit_of(observer, gain)
        return [c._replace(motions=in_motion(self.device, e, gain, unit).motions) for e, c in each]

    def better(self, noise: Noise, courses: Sequence[Course]) -> Noise:
        """Return the noise with the same observer on other courses, if it is no worse."""
        pairs = zip(courses, noise.courses, strict=True)
        if all(a.start is b.start and a.motions is b.motions for a, b in pairs):
            return noise
        plain, gain = prepared(self.device, SEARCHING), noise.observer.gain
        errors = [
            innovations(
                self.device, e, gain,
                ready=plain if e.changes is None else prepared(e.on(self.device), SEARCHING),
            )
            for e in _as(self.seen, courses)
        ]  # fmt: skip
        own = _noise(gain, noise.observer.ratio, self.family, courses, errors, self.experiments)
        return noise if own is None or own.cost > noise.cost else own


def begun(device: Device, experiment: Experiment, observer: Observer) -> Experiment:
    """Return the recording with what an observer finds of it: its initial state, and its course."""
    gain = observer.gain
    follows = gain if isinstance(gain, Changing) and gain.follows else None
    if experiment.before is not None:
        whole = replace(experiment, before=begun(device, experiment.before, observer))
        return in_motion(device, whole, follows, unit_of(observer, follows)) if follows else whole
    if follows:  # a ratio that suits it may suit no steady gain
        alone = Model(device)
        family = blind(observer.ratio) if observer.whitening is None else NEXT_SAMPLE
        noise = likeliest([experiment], alone, np.zeros(alone.linear_count), family)
        (first,) = _as([experiment], noise.courses)
        asked = [in_motion(device, first, follows, unit_of(observer, follows))]
        asked += [first] if first.motions is not None else []
        white = [observer.weigh(innovations(device, e, gain), e.uncounted) for e in asked]
        with np.errstate(all="ignore"):  # infinite after an overflow
            return asked[int(np.argmin([np.nan_to_num(np.sum(w**2), nan=np.inf) for w in white]))]
    (linear,) = Beginnings(experiment.on(device), [gain]).of(experiment)
    return replace(experiment, start=by_own_slopes(device, experiment, observer, linear))


def _deviation(errors: Sequence[Floats]) -> Floats:
    return np.sqrt(np.mean(np.concatenate([e[SETTLING:] for e in errors]) ** 2, axis=0))

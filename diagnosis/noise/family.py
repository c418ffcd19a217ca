"""The noise models from which a hypothesis may choose, all evaluated at once.

A noise model consists of the share of the motion that is disturbance (the observer's ratio of
process to measurement variance), and the spectrum and covariance of the innovations (the filters
that whiten them). For one device at one x, the members of the family differ only in their
observers, so they are lanes of one population: the same device with different gains.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.account import reason
from zwidth.diagnosis.fitting.fit import Problem
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.gaps import Changing, Gain, changing, steadily, with_play
from zwidth.diagnosis.noise.predictor import (
    SEARCHING,
    SETTLING,
    Observer,
    in_motion,
    innovations,
    innovations_each,
    settling,
    substeps_of,
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
from zwidth.sim.members import alike
from zwidth.sim.population import Population

Floats = NDArray[np.float64]
Motions = tuple[Floats, ...] | None
# From trusting the device almost fully to hardly at all. At 1e-10 an observer of positions
# forgets in 300 ticks; coarse encoders on quiet machines need 1e-9 (43 in -2 ln over 1e-7 on a
# rig of four effects), and beyond either end nothing changes.
FAMILY = np.geomspace(1e-10, 1e7, 18)
SLOWER = 1e-2  # of the likeliest ratio: an observer that hides less of missing physics
TRUSTING = (1e-2, 1.0, 1e2, 1e4)  # times the ratio of the observer that follows a recording
WORTH = 1.0  # gain in -2 ln that justifies following a motion again
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


@dataclass(frozen=True)
class Noise:
    """The noise model of a hypothesis: its observer, and its results for each recording.

    motions: with play, of each recording (`Experiment`), else None. cost: -2 log likelihood, up to
    a constant. weighed: the weighted innovations (samples,).
    """

    observer: Observer
    motions: Motions
    cost: float
    weighed: Floats

    def problem(self, experiments: Sequence[Experiment]) -> Problem:
        """Return the fit of the recordings with this model of their noise."""
        return Problem(_in(self.motions, experiments), self.observer, SEARCHING)


def _in(motions: Motions, experiments: Sequence[Experiment]) -> list[Experiment]:
    known = (None,) * len(experiments) if motions is None else motions
    return [replace(e, motions=own) for e, own in zip(experiments, known, strict=True)]


def likeliest(
    experiments: Sequence[Experiment],
    model: Model,
    x: Floats,
    family: Family = NEXT_SAMPLE,
    motions: Motions = None,
) -> Noise:
    """Return the most likely noise model; raises NoObserver if no observer is possible.

    motions: with play, those of a similar model, from which they are sought.
    """
    followed = _Followed(experiments, model, x, family)
    with reason("noise"):
        found = followed.noises(family, motions if followed.has_states_of(motions) else None)
    if not found:
        raise NoObserver(
            f"no observer of this device ({model.label}) predicts the recordings; check sign, scale"
            " and units of the command, of forces that were recorded, and of the outputs"
        )
    best = min(found, key=lambda noise: noise.cost)
    if not with_play(followed.device.physics):
        return best
    with reason("motions"):
        near, cost = family, math.inf
        while best.cost < cost - WORTH:
            cost = best.cost
            asked = followed.noises(near, followed.in_motion(best))
            best = min([best, *asked], key=lambda noise: noise.cost)
            near = near.near(best.observer.ratio)
        return best


def noises(
    experiments: Sequence[Experiment], model: Model, x: Floats, family: Family = NEXT_SAMPLE
) -> list[Noise]:
    """Return the noise models with which the device at x can be followed, by steady observers."""
    return _Followed(experiments, model, x, family).noises(family, None)


def _noise(
    gain: Gain,
    ratio: float,
    family: Family,
    motions: Motions,
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
    return Noise(white, motions, cost, weighed) if np.isfinite(cost) else None


class _Followed:
    """Recordings as observers of a device follow them."""

    def __init__(
        self, experiments: Sequence[Experiment], model: Model, x: Floats, family: Family
    ) -> None:
        self.experiments, self.family, self.device = experiments, family, model.acting(x)
        self.seen = [model.seen(e, x) for e in experiments]

    def has_states_of(self, motions: Motions) -> bool:
        """Whether motions are of as many states as this device has."""
        size = self.device.bare().plant().size
        return motions is not None and all(m.shape[1] == size for m in motions)

    def gains(self, ratios: Sequence[float], *, follows: bool) -> list[tuple[float, Gain]]:
        """Return the ratios that have an observer, with its gain; follows: as in `gaps`."""
        bare, first = self.device.bare(), self.seen[0]
        gains = steady_gains([bare] * len(ratios), first, np.array(ratios))
        if links := links_with_play(self.device):
            gains = with_apart(bare, links, first, gains)
        found: list[tuple[float, Gain]] = []
        for ratio, gain in zip(ratios, gains, strict=True):
            if np.all(np.isfinite(gain)):
                with suppress(NoObserver):
                    found.append((ratio, changing(bare, self.seen, ratio, gain, follows=follows)))
        return found

    def noises(self, family: Family, motions: Motions) -> list[Noise]:
        """Return the noise models of a family: of steady observers, or along known motions."""
        each = self.gains(family.ratios, follows=motions is not None)
        if not each:
            return []
        gains = [gain for _, gain in each]
        alike_there: dict[int, Population] = {}
        errors: list[Floats] = []
        for e in _in(motions, self.seen):
            key, there = id(e.changes), e.on(self.device)
            if key not in alike_there:
                few, many = substeps_of(there, SEARCHING)
                alike_there[key] = Population(alike(there, len(gains)), few, many)
            errors.append(innovations_each(alike_there[key], e, self.device, gains))
        found = [
            _noise(gain, ratio, family, motions, [e[i] for e in errors], self.experiments)
            for i, (ratio, gain) in enumerate(each)
        ]
        return [noise for noise in found if noise is not None]

    def in_motion(self, noise: Noise) -> Motions:
        """Return the motions along which the noise's observer follows the recordings."""
        observer = noise.observer
        gain = changing(
            self.device.bare(), self.seen, observer.ratio, steadily(observer.gain), follows=True
        )
        unit = unit_of(observer, gain)
        each = _in(noise.motions, self.seen)
        every = (in_motion(self.device, e, gain, unit).motions for e in each)
        return tuple(own for own in every if own is not None)


def followed_by(device: Device, experiment: Experiment, observer: Observer) -> Experiment:
    """Return the recording with the motions along which an observer follows it, if it does.

    With play, observers that trust the model more or less follow different motions, and the
    likeliest counts: one may take the wrong side of a gap, and be wrong for many contacts.
    """
    gain = observer.gain
    if not (isinstance(gain, Changing) and gain.follows):
        return experiment
    tried: list[tuple[float, Experiment]] = []
    for times in TRUSTING:
        with suppress(NoObserver):
            other = changing(
                device.bare(), [experiment], times * observer.ratio, steadily(gain), follows=True
            )
            own = in_motion(device, experiment, other, unit_of(observer, gain))
            with np.errstate(all="ignore"):  # infinite after an overflow
                white = observer.weigh(innovations(device, own, gain), own.uncounted)
                square = float(np.sum(white[settling(own) :] ** 2))
            tried.append((square if math.isfinite(square) else math.inf, own))
    return min(tried, key=lambda one: one[0], default=(0.0, experiment))[1]


def _deviation(errors: Sequence[Floats]) -> Floats:
    return np.sqrt(np.mean(np.concatenate([e[SETTLING:] for e in errors]) ** 2, axis=0))

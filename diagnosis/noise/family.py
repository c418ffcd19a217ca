"""The noise models from which a hypothesis may choose, all evaluated at once.

A model of the noise consists of the share of the motion that is disturbance (the observer's ratio
of process to measurement variance), and the spectrum and covariance of the innovations (the filters
that whiten them). For one device at one x, the members of the family differ only in their
observers, so they are lanes of one population: the same device with different gains.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.account import reason
from zwidth.diagnosis.fitting.fit import Problem
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.beginning import Beginnings, by_own_slopes, with_play
from zwidth.diagnosis.noise.gaps import Gain, returning
from zwidth.diagnosis.noise.predictor import (
    SEARCHING,
    SETTLING,
    Observer,
    innovations,
    prepared,
    told,
    whitened,
)
from zwidth.diagnosis.noise.steady import NoObserver, links_with_play, steady_gains, with_apart
from zwidth.diagnosis.recording.experiment import Experiment

Floats = NDArray[np.float64]
# From trusting the device almost fully to hardly at all. At 1e-10 an observer of positions
# forgets in 300 ticks; coarse encoders on quiet machines need 1e-9 (43 in -2 ln over 1e-7 on a
# rig of four effects), and beyond either end nothing changes.
FAMILY = np.geomspace(1e-10, 1e7, 18)
SLOWER = 1e-2  # of the likeliest ratio, of an observer that leaves more of missing physics to see
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
        """Return the family of ratios near one."""
        about = [r for r in self.ratios if abs(math.log10(r / ratio)) < NEAR_RATIOS]
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
    """The noise model of a hypothesis: its observer, and the observer's initial state.

    starts: for each recording, the addition to positions and velocities (2n,) at its beginning.
    cost: -2 log likelihood, up to a constant. weighed: the weighted innovations (samples,).
    """

    observer: Observer
    starts: tuple[Floats, ...]
    cost: float
    weighed: Floats

    def problem(self, experiments: Sequence[Experiment]) -> Problem:
        """Return the recordings under this model of their noise."""
        known = [replace(e, start=s) for e, s in zip(experiments, self.starts, strict=True)]
        return Problem(known, self.observer, SEARCHING)


def likeliest(
    experiments: Sequence[Experiment],
    model: Model,
    x: Floats,
    family: Family = NEXT_SAMPLE,
    begun: Sequence[Floats] | None = None,
) -> Noise:
    """Return the most likely noise model; raises NoObserver if no observer is possible.

    begun: with play, initial states of a similar model, so that they need not be sought again.
    """
    with reason("noise"):
        found = noises(experiments, model, x, family)
    if not found:
        raise NoObserver(
            f"no observer of this device ({model.label}) predicts the recordings; check sign, scale"
            " and units of the command, of forces that were recorded, and of the outputs"
        )
    best = min(found, key=lambda noise: noise.cost)
    with reason("beginnings"):
        own = _begun_with_play(experiments, model, x, family, best, begun)
    return best if own is None or own.cost > best.cost else own


def noises(
    experiments: Sequence[Experiment], model: Model, x: Floats, family: Family = NEXT_SAMPLE
) -> list[Noise]:
    """Return the noise models with which the device at x can be followed."""
    ratios = np.array(family.ratios)
    device = model.acting(x)
    seen = [model.seen(e, x) for e in experiments]
    bare = device.bare()
    gains = steady_gains([bare] * ratios.size, seen[0], ratios)
    if links := links_with_play(device):
        gains = with_apart(bare, links, seen[0], gains)
    each = [
        (ratio, returning(bare, seen, ratio, gain))
        for ratio, gain in zip(ratios.tolist(), gains, strict=True)
        if np.all(np.isfinite(gain))
    ]
    if not each:
        return []
    usable = [gain for _, gain in each]
    begins = {id(e.changes): Beginnings(e.on(device), usable) for e in seen}
    asked = [(begins[id(e.changes)], e) for e in seen]
    followed = [(starts := b.of(e), b.followed(e, starts)) for b, e in asked]
    found: list[Noise | None] = []
    for i, (ratio, gain) in enumerate(each):
        starts, errors = [b[i] for b, _ in followed], [e[i] for _, e in followed]
        found.append(_noise(gain, ratio, family, starts, errors, experiments))
    return [noise for noise in found if noise is not None]


def _noise(
    gain: Gain,
    ratio: float,
    family: Family,
    starts: Sequence[Floats],
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
    return Noise(white, tuple(starts), cost, weighed) if np.isfinite(cost) else None


def _begun_with_play(
    experiments: Sequence[Experiment],
    model: Model,
    x: Floats,
    family: Family,
    noise: Noise,
    begun: Sequence[Floats] | None,
) -> Noise | None:
    """The noise with the initial states that play needs; None if these are the same."""
    if not with_play((*model.nominal.physics, *model.effects)):
        return None
    device = model.acting(x)
    seen = [model.seen(e, x) for e in experiments]
    observer = noise.observer
    starts = begun or [
        by_own_slopes(device, e, observer, s) for e, s in zip(seen, noise.starts, strict=True)
    ]
    if all(now is before for now, before in zip(starts, noise.starts, strict=True)):
        return None
    plain = prepared(device, SEARCHING)
    ready = [plain if e.changes is None else prepared(e.on(device), SEARCHING) for e in seen]
    errors = [
        innovations(device, replace(e, start=start), observer.gain, ready=one)
        for e, start, one in zip(seen, starts, ready, strict=True)
    ]
    return _noise(observer.gain, observer.ratio, family, starts, errors, experiments)


def _deviation(errors: Sequence[Floats]) -> Floats:
    return np.sqrt(np.mean(np.concatenate([e[SETTLING:] for e in errors]) ** 2, axis=0))

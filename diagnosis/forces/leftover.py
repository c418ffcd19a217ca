"""Tests with a bank of generic forces whether one is left that no library effect explains.

A device that sways, warms or swings has forces f = a q cos(phase + 2 pi s / period), where q is one
of

    1, velocity, acceleration of a mass, or deflection and its rate of a link,

and s is time or the position of m1. With g = F' r (`forces.spatial`), such a force would gain a
chi-square of 2 |G|^2 / n, where G is the spectrum of g q over s: one FFT gives all periods. n is
the mean of |G|^2 over `DRAWS` residuals drawn at random with the residual's own smoothed spectrum
and envelope, because noise is never quite white near a resonance and, with irregular sampling, is
larger during fast motion. For q = 1, a hum is itself a line of that spectrum, so n comes from white
residuals and from neighbouring lines, in wide and narrow ranges, since an antiresonance is narrow.
The best line of all families is compared with the value that the best of as many lines of white
noise exceeds once in `odds` recordings. Slow warming is a line of low frequency. The part that a
refit absorbs is removed from residual and noise: a damper that varies once over the whole travel is
nearly a damper. Limits: q is the observer's prediction.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d, median_filter, uniform_filter1d

from zwidth.diagnosis.fitting.descend import fitted_at
from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.forces.spatial import matched
from zwidth.diagnosis.noise.predictor import SETTLING, followed, innovations, whitened
from zwidth.diagnosis.seeking.screen import Complement
from zwidth.diagnosis.settings import FREE_FORCES
from zwidth.sim.place import GROUND, MASSES, masses_and_links, place_at

Floats = NDArray[np.float64]
FASTEST_HZ = 40.0  # highest frequency at which a parameter may vary
FINEST = 60.0  # periods over the travel
SPRINGS = 6  # half periods over the travel; with fewer, a ripple is a bent spring
DRAWS = 48  # number of draws of white noise
SEED = 0
AROUND = 51  # lines whose median gives the noise about a hum
BESIDE = (2, 8)  # lines to either side whose mean does too; nearer ones have the hum's leakage
ENVELOPE = 300  # samples over which the residual's size is averaged
SMOOTH = 15  # lines over which the residual's spectrum is smoothed, to draw similar noise
COARSE = 8.0  # lags of the filters' memory: a resolution of 20 Hz at 1 kHz
BINS = 4096  # over twice the travel


@dataclass(frozen=True)
class Leftover:
    """The strongest line. gained: its chi-square; chance: one that noise exceeds once in `odds`.

    at: "m1".. or "link12"..; follows: q; over: "time" or "position"; period [s, rad or m];
    spacing: of 1 / period between two lines.
    """

    gained: float
    chance: float
    at: str
    follows: str
    over: str
    period: float
    spacing: float

    @property
    def significant(self) -> bool:
        """Whether the gain exceeds chance."""
        return self.gained > self.chance

    def sentence(self, rotary: bool) -> str:
        """Say what is left."""
        unit = "s" if self.over == "time" else "rad" if rotary else "m"
        q = "" if self.follows == "1" else f" proportional to the {self.follows}"
        hertz = f" ({1.0 / self.period:.3g} Hz)" if self.over == "time" else ""
        return (
            f"a force at {self.at}{q} that repeats with {self.over} every {self.period:.3g} {unit}"
            f"{hertz} would lower the chi-square by {self.gained:.0f} (chance: {self.chance:.0f})"
        )


def leftover(problem: Problem, fitted: Fitted) -> Leftover:
    """Return the strongest line in the residual of a fitted model.

    It is sought in coarsely whitened innovations, since a fine filter treats a strong line as
    noise.
    """
    problem, fitted = _coarsely(problem, fitted)
    off = Complement(fitted.jacobian)
    fitted = replace(fitted, residual=off(fitted.residual))
    states = predicted_states(problem, fitted)
    rippled = {p.at for p in fitted.model.effects if p.effect.sought == "waves"}
    bank = list(_bank(states, problem.experiments[0].period, rippled))
    hums = [f for f in bank if f.hums]
    sways = [f for f in bank if not f.hums]
    random = np.random.default_rng(SEED)
    best: tuple[float, Family, int] | None = None
    lines = 0
    for families, drawn in ((hums, _white), (sways, _alike)):
        own = _powers(problem, fitted, families)
        level = [np.zeros(power.size) for power in own]
        for _ in range(DRAWS):  # one by one: all of them would fill memory
            noise = drawn(fitted, random)
            noise = replace(noise, residual=off(noise.residual))
            for total, power in zip(level, _powers(problem, noise, families), strict=True):
                total += power / DRAWS
        for family, power, mean in zip(families, own, level, strict=True):
            gained = _gained(power, mean, family.hums)
            lines += gained.size
            k = int(np.argmax(gained)) if gained.size else 0
            if gained.size and (best is None or gained[k] > best[0]):
                best = float(gained[k]), family, k
    chance = 2.0 * float(np.log(max(lines, 1) * FREE_FORCES.odds))
    if best is None:
        return Leftover(0.0, chance, "m1", "1", "time", 1.0, 1.0)
    gained, family, k = best
    period, spacing = float(family.periods[k]), float(1.0 / family.periods.max())
    return Leftover(gained, chance, family.place, family.follows, family.over, period, spacing)


def _coarsely(problem: Problem, fitted: Fitted) -> tuple[Problem, Fitted]:
    """Problem and fit with coarse filters, which hide no line."""
    if problem.observer.whitening is None:
        return problem, fitted
    device = fitted.model.acting(fitted.x)
    seen = [fitted.model.seen(e, fitted.x) for e in problem.experiments]
    errors = [innovations(device, e, problem.observer.gain) for e in seen]
    there = Problem(problem.experiments, whitened(problem.observer, errors, seen, COARSE))
    return there, fitted_at(there, fitted.model, fitted.x)


@dataclass(frozen=True)
class Family:
    """The forces q cos(phase + 2 pi s / period) at one place, for one q, one s and many periods.

    factor: q at every tick of every recording; bins: of a position s, None for time; kept: lines of
    the spectrum that are used; periods: of these lines.
    """

    place: str
    follows: str
    over: str
    factor: list[Floats]
    bins: list[NDArray[np.int64]] | None
    kept: NDArray[np.bool_]
    periods: Floats

    @property
    def hums(self) -> bool:
        """Whether the force varies with time alone."""
        return self.follows == "1" and self.over == "time"

    def power(self, pulls: list[Floats]) -> Floats:
        """Return |G|^2 of the lines, from g of every recording."""
        both = zip(pulls, self.factor, strict=True)
        if self.bins is None:
            product = np.concatenate([g * q for g, q in both])
        else:
            parts = zip(self.bins, both, strict=True)
            product = np.sum([np.bincount(i, g * q, BINS) for i, (g, q) in parts], 0)
        return np.abs(np.fft.rfft(product)[self.kept]) ** 2


def _bank(states: list[Floats], period: float, rippled: Collection[str]) -> Iterator[Family]:
    """Every family; forces periodic in position alone only at places with a ripple."""
    n = states[0].shape[1] // 2
    places = map(str, masses_and_links(n))
    positions = [x[:, 0] for x in states]
    low = min(float(x.min()) for x in positions)
    span = max(float(x.max()) for x in positions) - low
    ticks = sum(x.size for x in positions)
    frequency = np.fft.rfftfreq(ticks, period)
    number = np.arange(BINS // 2 + 1)
    for place in places:
        for follows, factor in factors(place, states, n, period).items():
            for q in factor:  # a spike while the observer settles would add to all lines
                q[: SETTLING + 5] = 0.0
            fastest = 0.45 / period if follows == "1" else min(FASTEST_HZ, 0.1 / period)
            kept = (np.arange(frequency.size) > 0) & (frequency < fastest)
            times = 1.0 / np.maximum(frequency, frequency[1])
            yield Family(place, follows, "time", factor, None, kept, times[kept])
            if not span > 0.0 or (follows == "1" and place not in rippled):
                continue
            width = 2.0 * span / BINS
            bins = [np.minimum(((x - low) / width).astype(np.int64), BINS - 1) for x in positions]
            seen = (number >= (SPRINGS if follows == "1" else 1)) & (number <= 2.0 * FINEST)
            lengths = 2.0 * span / np.maximum(number, 1)
            yield Family(place, follows, "position", factor, bins, seen, lengths[seen])


def _powers(problem: Problem, fitted: Fitted, families: Sequence[Family]) -> list[Floats]:
    """Return |G|^2 of every family for one residual."""
    pulls: dict[str, list[Floats]] = {}

    def pull(place: str) -> list[Floats]:
        if place not in pulls:
            first, second = place_at(place).ends
            if second != GROUND:
                ends = zip(pull(MASSES[first]), pull(MASSES[second]), strict=True)
                pulls[place] = [a - b for a, b in ends]
            else:
                pulls[place] = matched(problem, fitted, place)
        return pulls[place]

    return [family.power(pull(family.place)) for family in families]


def factors(place: str, states: list[Floats], n: int, period: float) -> dict[str, list[Floats]]:
    """Return q at every tick of every recording, by name."""
    i, j = place_at(place).ends
    if j != GROUND:
        return {
            "deflection": [x[:, i] - x[:, j] for x in states],
            "rate of deflection": [x[:, n + i] - x[:, n + j] for x in states],
        }
    return {
        "1": [np.ones(x.shape[0]) for x in states],
        "velocity": [x[:, n + i] for x in states],
        "acceleration": [np.gradient(x[:, n + i]) / period for x in states],
    }


def _white(fitted: Fitted, random: np.random.Generator) -> Fitted:
    """The fit with white noise as its residual."""
    return replace(fitted, residual=random.standard_normal(fitted.residual.size))


def _alike(fitted: Fitted, random: np.random.Generator) -> Fitted:
    """The fit with noise of the residual's envelope and smoothed spectrum, with random phases."""
    # Rounding can make a running mean of zeros negative.
    size = uniform_filter1d(fitted.white**2, ENVELOPE, mode="reflect")
    envelope = np.sqrt(np.maximum(size, 0.0))
    envelope[envelope == 0.0] = 1.0
    waves = np.fft.rfft(fitted.white / envelope)
    size = np.sqrt(np.maximum(uniform_filter1d(np.abs(waves) ** 2, SMOOTH, mode="reflect"), 0.0))
    turned = size * np.exp(2j * np.pi * random.random(size.size))
    residual = fitted.residual.copy()
    residual[: fitted.samples] = envelope * np.fft.irfft(turned, fitted.samples)
    return replace(fitted, residual=residual)


def _gained(power: Floats, level: Floats, alone: bool) -> Floats:
    """Chi-square of the lines. alone: relative to the lines around, if these exceed the level."""
    over = power / np.where(level > 0.0, level, np.inf)
    if not alone or not over.size:
        return 2.0 * over
    many = median_filter(over, min(AROUND, over.size), mode="reflect") / np.log(2.0)
    near, far = BESIDE
    weights = np.ones(2 * far + 1)
    weights[far - near + 1 : far + near] = 0.0
    few = convolve1d(over, weights / weights.sum(), mode="reflect")
    return 2.0 * over / np.maximum(1.0, np.maximum(many, few))


def predicted_states(problem: Problem, fitted: Fitted) -> list[Floats]:
    """Return positions and velocities (ticks, 2n) of all masses that the observer predicts."""
    device, gain = fitted.model.acting(fitted.x), problem.observer.gain
    return [followed(device, fitted.model.seen(e, fitted.x), gain) for e in problem.experiments]

"""Is anything left that no effect of the library explains? A bank of forces of unknown cause.

A device that sways, warms or swings has forces f = a q cos(phase + 2 pi s / period): q one of

    1, velocity, acceleration of a mass, or deflection and its rate of a link,

s time or the position of m1. With g = F' r (`diagnosis.spatial`) the chi-square that such a force
would gain is 2 |G|^2 / n, G the spectrum of g q over s: one FFT for all periods, n the mean of
|G|^2 over `DRAWS` drawn residuals: with the residual's own smoothed spectrum, since noise is never
quite white near a resonance; for q = 1, where a hum is a line of that very spectrum, white ones and
the lines around. The best of all lines of all families is held against what the best of as many
lines of white noise exceeds once in `ODDS` recordings. Slow warming is a line of low frequency.
Limits: q is what the observer predicts, and what a refit absorbs (periods as long as the recording)
is not taken off.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter1d

from diagnosis.experiment import Output
from diagnosis.fit import Fitted, Problem
from diagnosis.predictor import SETTLING, innovations
from diagnosis.spatial import matched

Floats = NDArray[np.float64]
ODDS = 1e6  # the drawn noise is not the noise of every rig
FASTEST_HZ = 40.0  # at which a parameter sways
FINEST = 60.0  # periods over the travel
DRAWS = 48  # of white noise
SEED = 0
AROUND = 51  # lines whose median says how much colour is left about a hum
SMOOTH = 15  # lines over which the residual's spectrum is smoothed, to draw noise alike
BINS = 4096  # over twice the travel


@dataclass(frozen=True)
class Leftover:
    """The strongest line. gained: its chi-square; chance: what noise reaches once in `ODDS`.

    at: "m1".. or "link12"..; follows: q; over: "time" or "position"; period [s, rad or m].
    """

    gained: float
    chance: float
    at: str
    follows: str
    over: str
    period: float

    @property
    def significant(self) -> bool:
        """Whether it is more than chance."""
        return self.gained > self.chance

    def sentence(self, rotary: bool) -> str:
        """Say what is left."""
        unit = "s" if self.over == "time" else "rad" if rotary else "m"
        q = "" if self.follows == "1" else f" proportional to the {self.follows}"
        return (
            f"a force at {self.at}{q} that repeats over {self.over} every {self.period:.3g} {unit}"
            f" would gain a chi-square of {self.gained:.0f} (chance: {self.chance:.0f})"
        )


def leftover(problem: Problem, fitted: Fitted) -> Leftover:
    """Return the strongest line in what a fitted model leaves."""
    states = predicted_states(problem, fitted)
    n = states[0].shape[1] // 2
    period = problem.experiments[0].period
    random = np.random.default_rng(SEED)
    white = [fitted, *(_white(fitted, random) for _ in range(DRAWS))]
    alike = [fitted, *(_alike(fitted, random) for _ in range(DRAWS))]
    hums = _pulls(problem, white, n)
    sways = _pulls(problem, alike, n)
    positions = [x[:, 0] for x in states]
    lines = 0
    best: tuple[float, str, str, str, float] = (0.0, "m1", "1", "time", 1.0)
    for place in hums:
        for name, factor in factors(place, states, n, period).items():
            for q in factor:  # a spike where the observer settles would be on every line
                q[: SETTLING + 5] = 0.0
            for over in ("time", "position"):
                if name == "1" and over == "position":  # the library has ripple and springs
                    continue
                pull = hums[place] if name == "1" else sways[place]
                gained, periods = _over(pull, factor, over, name, positions, period)
                lines += gained.size
                k = int(np.argmax(gained)) if gained.size else 0
                if gained.size and gained[k] > best[0]:
                    best = (float(gained[k]), place, name, over, float(periods[k]))
    chance = 2.0 * float(np.log(max(lines, 1) * ODDS))
    return Leftover(best[0], chance, *best[1:])


def factors(place: str, states: list[Floats], n: int, period: float) -> dict[str, list[Floats]]:
    """Q at every tick of every recording, by name."""
    if place.startswith("link"):
        i = int(place[4]) - 1
        return {
            "deflection": [x[:, i] - x[:, i + 1] for x in states],
            "rate of deflection": [x[:, n + i] - x[:, n + i + 1] for x in states],
        }
    i = int(place[1]) - 1
    return {
        "1": [np.ones(x.shape[0]) for x in states],
        "velocity": [x[:, n + i] for x in states],
        "acceleration": [np.gradient(x[:, n + i]) / period for x in states],
    }


def _pulls(problem: Problem, residuals: list[Fitted], n: int) -> dict[str, list[list[Floats]]]:
    """Return g of every residual and recording, by place."""
    at = {f"m{i + 1}": [matched(problem, one, f"m{i + 1}") for one in residuals] for i in range(n)}
    for i in range(n - 1):
        both = zip(at[f"m{i + 1}"], at[f"m{i + 2}"], strict=True)
        at[f"link{i + 1}{i + 2}"] = [
            [a - b for a, b in zip(one, two, strict=True)] for one, two in both
        ]
    return at


def _white(fitted: Fitted, random: np.random.Generator) -> Fitted:
    """The fit with white noise for a residual."""
    return replace(fitted, residual=random.standard_normal(fitted.residual.size))


def _alike(fitted: Fitted, random: np.random.Generator) -> Fitted:
    """The fit with noise of the residual's own colour: its spectrum smoothed, phases drawn."""
    waves = np.fft.rfft(fitted.white)
    size = np.sqrt(uniform_filter1d(np.abs(waves) ** 2, SMOOTH, mode="reflect"))
    turned = size * np.exp(2j * np.pi * random.random(size.size))
    residual = fitted.residual.copy()
    residual[: fitted.samples] = np.fft.irfft(turned, fitted.samples)
    return replace(fitted, residual=residual)


def _over(
    pull: list[list[Floats]],
    factor: list[Floats],
    over: str,
    name: str,
    positions: list[Floats],
    period: float,
) -> tuple[Floats, Floats]:
    """Chi-square of every line, and its period. pull: g of the residual, then of drawn noise."""
    if over == "time":
        products = [np.concatenate([g * q for g, q in zip(p, factor, strict=True)]) for p in pull]
        fastest = 0.45 / period if name == "1" else min(FASTEST_HZ, 0.1 / period)
        frequency = np.fft.rfftfreq(products[0].size, period)
        kept = (np.arange(frequency.size) > 0) & (frequency < fastest)
        return _lines(products, kept, 1.0 / np.maximum(frequency, frequency[1]), name == "1")
    low = min(float(x.min()) for x in positions)
    span = max(float(x.max()) for x in positions) - low
    if not span > 0.0:
        return np.zeros(0), np.zeros(0)
    width = 2.0 * span / BINS
    places = [np.minimum(((x - low) / width).astype(np.int64), BINS - 1) for x in positions]
    binned = [
        np.sum([np.bincount(i, g * q, BINS) for i, g, q in zip(places, p, factor, strict=True)], 0)
        for p in pull
    ]
    number = np.arange(BINS // 2 + 1)
    kept = (number >= 1) & (number <= 2.0 * FINEST)
    return _lines(binned, kept, 2.0 * span / np.maximum(number, 1), alone=False)


def _lines(
    products: list[Floats], kept: NDArray[np.bool_], periods: Floats, alone: bool
) -> tuple[Floats, Floats]:
    """Chi-square of the lines kept. alone: only of those that stand out of the band around them."""
    power = [np.abs(np.fft.rfft(z)[kept]) ** 2 for z in products]
    level = np.mean(power[1:], axis=0)
    over = power[0] / np.where(level > 0.0, level, np.inf)
    if not alone:
        return 2.0 * over, periods[kept]
    around = median_filter(over, min(AROUND, over.size), mode="reflect") / np.log(2.0)
    return 2.0 * over / np.maximum(1.0, around), periods[kept]


def predicted_states(problem: Problem, fitted: Fitted) -> list[Floats]:
    """Return positions and velocities (ticks, 2n) of all masses as the observer predicts them.

    By outputs that correct nothing: their innovation, measured as zero, is the state turned round.
    """
    device = fitted.model.acting(fitted.x)
    n = device.chain.masses.size
    further = tuple(Output(q, i) for q in ("position", "velocity") for i in range(n))
    gain = problem.observer.gain
    found: list[Floats] = []
    sensors = [p.effect.name for p in device.physics if p.effect.hook == "sensor"]
    bare = device.without_physics(*sensors) if sensors else device
    for e in problem.experiments:
        seen = fitted.model.seen(e, fitted.x)
        wide = replace(
            seen,
            outputs=(*seen.outputs, *further),
            measured=np.hstack([seen.measured, np.zeros((seen.ticks, 2 * n))]),
        )
        still = np.hstack([gain, np.zeros((gain.shape[0], 2 * n))])
        state = -innovations(bare, wide, still)[:, len(seen.outputs) :]
        found.append(state)
    return found

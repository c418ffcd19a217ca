"""Predict the walls of a haptic paddle from its firmware, before they are seen.

    python docs/paddle_prediction.py

writes `docs/haptics/paddle_prediction.json` and two pictures, and prints the section that
`docs/make_haptics_page.py` puts into `docs/haptics.md`. Known are the rates, the encoder, the
motor, the friction at the motor and two ultimate points of the position loop; what is not known is
drawn, `DRAWS` times. On one core it takes about a minute and a half.
"""

import itertools
import json
import math
import sys
import textwrap
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.optimize import brentq

from zwidth.figures.style import COLOURS, DASHES, STYLE
from zwidth.files.protection import writing_as
from zwidth.files.whole import write_text, write_with
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.stability.bisection import Bracket, Search, Trial, find_brackets

Floats = NDArray[np.float64]
FOLDER = Path(__file__).parent / "haptics"
DRAWS, SEED = 100, 49

# Known. Of the paddle where nothing else is said: torques times the ratio, angles over it.
PERIOD, RATIO = 350e-6, 15.0
STEP = 2.0 * math.pi / 4096 / RATIO
LIMIT = 24.0 / 5.78 * 0.0346 * RATIO  # what the supply drives through the winding [N m]
CUTOFF_HZ = 50.0
BUILDS = np.array([[1.22e-3, 1.48e-3], [1.70e-3, 1.56e-3]]) * RATIO  # friction, minus and plus
DEGREES = math.degrees(1.0)
KU, TU = 0.07 * RATIO * DEGREES, 0.023  # on the encoder [N m/rad], [s]
KU_HALL, TU_HALL = 0.01345 * RATIO * DEGREES, 0.045
VISCOUS = 8.33e-7 * RATIO**2  # of the motor [N m s/rad]
NEAR = 0.15  # of the periods that are given, within which a drawn rig is kept
REST = 5.0 * STEP  # an oscillation of up to five counts is dither; 32 give the same walls
DAMPINGS = np.arange(0.0, 0.0241, 0.002)  # at the end of the paddle [N s/mm]

ESTIMATORS = ("difference", "foaw", "levant", "kalman")
NAMES = {"difference": "difference", "foaw": "FOAW", "levant": "Levant", "kalman": "Kalman"}
LOW, HIGH = 5.0, 95.0  # percentiles of an interval


@dataclass(frozen=True)
class Rig:
    """One draw of the paddle's unknown properties, in units of the paddle.

    inertia [kg m2]; delay [s]; friction minus, plus [N m]; start: how far a tap moves it [rad];
    ultimate: K at which the position loop oscillates, on the encoder and on the Hall sensor
    [N m/rad]; radius [m]; FOAW's window and band [rad]; Levant's bound [rad/s2]; whether the Kalman
    has the acceleration as a state, and its acceleration [rad/s2].
    """

    inertia: float
    delay: float
    minus: float
    plus: float
    start: float
    ultimate: float
    ultimate_hall: float
    radius: float
    window: int
    band: float
    bound: float
    accelerates: bool
    acceleration: float

    @property
    def level(self) -> float:
        """Mean of the two frictions."""
        return 0.5 * (self.minus + self.plus)

    def settings(self, estimator: str) -> dict[str, Any]:
        """Return the interface's fields of an estimator."""
        match estimator:
            case "foaw":
                own = {"velocity_window": self.window, "velocity_band": self.band}
            case "levant":
                own = {"velocity_acceleration": self.bound}
            case "kalman":
                own = {"velocity_noise": STEP / math.sqrt(12.0)}
                own |= {"velocity_acceleration": self.acceleration}
                estimator = "kalman_acceleration" if self.accelerates else "kalman"
            case _:
                own = {}
        return {"velocity_estimator": estimator, **own}

    def device(self, damping: float, **face: Any) -> Device:
        """Return the paddle with a damper, with friction and steps."""
        interface = Interface(
            period=PERIOD, delay=self.delay, encoder_step=STEP,
            command_limit=LIMIT, velocity_cutoff_hz=CUTOFF_HZ, **face,
        )  # fmt: skip
        friction = make_physics(
            "directional_friction", "m1", level_plus=self.plus, level_minus=self.minus,
            viscous_plus=0.0, viscous_minus=0.0,
        )  # fmt: skip
        chain = make_chain([self.inertia], [damping], 0.0)
        return Device("haptic paddle", "drawn", True, chain, interface, (friction,))

    @property
    def rubbing(self) -> float:
        """First harmonic of the friction in an oscillation as wide as the start, over it."""
        return 4.0 * self.level / (math.pi * self.start)

    def settled(self) -> "Settled":
        """Return the damper with which the position loop ends at its ultimate K, and its periods.

        A mass with a damper b_t in all, under a spring that is t = T/2 + delay late, is at the end
        of its stability where

            J w^2 = K cos(w t),    b_t w = K sin(w t),    so    K^2 = (J w^2)^2 + (b_t w)^2.

        On the encoder the delay is known, and gives w and b_t; b_t w = b w + `rubbing`, friction's
        part of it. Where friction does more than that, the start was wider. On the Hall sensor, of
        unknown delay, the last equation gives w.
        """
        late = 0.5 * PERIOD + self.delay

        def beyond(w: float) -> float:
            return self.inertia * w * w - self.ultimate * math.cos(w * late)

        w = float(brentq(beyond, 1.0, 0.5 * math.pi / late))
        lost = self.ultimate * math.sin(w * late)
        damping = max((lost - self.rubbing) / w, VISCOUS)
        own = replace(self, start=self.start * self.rubbing / (lost - damping * w))

        def beyond_hall(w: float) -> float:
            both = math.hypot(self.inertia * w * w, damping * w + own.rubbing)
            return both - self.ultimate_hall

        slow = 0.0 if beyond_hall(0.0) >= 0.0 else float(brentq(beyond_hall, 0.0, 1e4))
        turn = 2.0 * math.pi
        return Settled(own, damping, turn / w, turn / slow if slow else math.inf)


class Settled(NamedTuple):
    """A rig with the start and the damper that its ultimate K requires, and its periods [s]."""

    rig: Rig
    damping: float
    period: float
    period_hall: float


def drawn(rng: np.random.Generator) -> Rig:
    """Draw the unknown properties; each line is an assumption with its reason."""
    # The two ultimate points give 8.1e-4 and 5.9e-4, the builders of another paddle say 7.0e-4.
    inertia = 7.0e-4 * math.exp(0.1 * rng.normal())
    # From the reading to the current: at once, or with the next interrupt and an amplifier as late.
    delay = PERIOD * rng.uniform(0.3, 2.0)
    minus, plus = BUILDS[0] + rng.uniform() * (BUILDS[1] - BUILDS[0])
    start = ratios(rng, 0.002, 0.03)  # 0.2 to 3 mm at the finger
    # Gains at which it oscillates are found by turning them up by hand.
    ultimate, ultimate_hall = (
        KU * math.exp(0.2 * rng.normal()),
        KU_HALL * math.exp(0.2 * rng.normal()),
    )
    radius = rng.uniform(0.07, 0.12)
    window, band = int(rng.integers(8, 25)), STEP * float(rng.integers(1, 3))
    # Levant's bound is tuned to follow what the motor can do, which is best in a wall as well; with
    # a fifth of that, or five times as much, no wall is much stiffer than at B = 0. A Kalman is
    # tuned to smooth, and its acceleration is a sigma.
    most = LIMIT / inertia
    bound = most * ratios(rng, 0.3, 2.5)
    accelerates = bool(rng.uniform() < 0.5)
    acceleration = most * ratios(rng, 1.0 / 30.0, 1.0) * (0.1 if accelerates else 1.0)
    return Rig(
        inertia, delay, float(minus), float(plus), start, ultimate, ultimate_hall, radius, window,
        band, bound, accelerates, acceleration,
    )  # fmt: skip


def ratios(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw between two numbers, evenly over their ratio."""
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def fits(settled: Settled) -> bool:
    """Whether both periods are near those that are given."""
    return abs(settled.period / TU - 1.0) < NEAR and abs(settled.period_hall / TU_HALL - 1.0) < NEAR


@dataclass(frozen=True)
class Draws:
    """Rigs of which so many fit, all that were tried, and the walls of those that fit.

    walls (rigs, estimators, 13): K [N m/rad].
    """

    kept: list[Settled]
    tried: list[Settled]
    walls: Floats


def middle(bracket: Bracket) -> float:
    """Return K of a bracket, 0 where no wall is stable."""
    return 0.0 if bracket.stable is None else 0.5 * (bracket.stable + (bracket.unstable or 0.0))


def walls_of(settled: Settled) -> Floats:
    """Return the stiffest walls of a rig with each estimator, (estimators, 13)."""
    own = settled.rig
    grid = 1e3 * DAMPINGS * own.radius**2
    trial = Trial(start=own.start, seconds=1.2, limit_s=4.8, window_s=0.1, threshold=REST)
    search = Search(tolerance=0.01, lowest=1.0, highest=4e3)
    rows: list[list[float]] = []
    for name in ESTIMATORS:
        device = own.device(settled.damping, **own.settings(name))
        rows.append([middle(one) for one in find_brackets([device], [grid], trial, search)[0]])
    return np.array(rows)


def predict(draws: int = DRAWS, seed: int = SEED) -> Draws:
    """Draw rigs until so many fit, and return them with their walls."""
    rng = np.random.default_rng(seed)
    kept: list[Settled] = []
    tried: list[Settled] = []
    while len(kept) < draws:
        tried.append(drawn(rng).settled())
        if fits(tried[-1]):
            kept.append(tried[-1])
    return Draws(kept, tried, np.array([walls_of(one) for one in kept]))


def spread(values: Floats) -> tuple[float, float, float]:
    """Return (median, low, high) over the first axis, of one quantity."""
    low, median, high = np.percentile(values, [LOW, 50.0, HIGH])
    return float(median), float(low), float(high)


@dataclass(frozen=True)
class Prediction:
    """The prediction for the paddle: arrays over draws.

    walls (draws, estimators, 13) [N m/rad]; at_the_end the same in N/mm; periods (draws,) [s], of
    those that fit and of all that were tried; damping (draws,) [N m s/rad].
    """

    walls: Floats
    at_the_end: Floats
    periods: tuple[Floats, Floats]
    periods_tried: tuple[Floats, Floats]
    damping: Floats

    @staticmethod
    def of(found: Draws) -> "Prediction":
        """Collect the draws into arrays."""
        radii = np.array([one.rig.radius for one in found.kept])

        def periods(rigs: list[Settled]) -> tuple[Floats, Floats]:
            return np.array([r.period for r in rigs]), np.array([r.period_hall for r in rigs])

        return Prediction(
            found.walls, found.walls / (1e3 * radii[:, None, None] ** 2), periods(found.kept),
            periods(found.tried), np.array([one.damping for one in found.kept]),
        )  # fmt: skip

    @property
    def largest(self) -> Floats:
        """The largest K of each draw and estimator, (draws, estimators)."""
        return self.walls.max(axis=2)

    @property
    def where(self) -> Floats:
        """B of the largest K [N s/mm], (draws, estimators)."""
        return DAMPINGS[self.walls.argmax(axis=2)]

    @property
    def order(self) -> list[int]:
        """Estimators by the median of their largest K, the stiffest first."""
        return np.argsort(-np.median(self.largest, axis=0)).tolist()

    def beats(self, one: int, other: int) -> float:
        """The share of draws in which an estimator's largest K is above another's."""
        return float(np.mean(self.largest[:, one] > self.largest[:, other]))


def as_json(p: Prediction) -> dict[str, Any]:
    """Return the prediction for its JSON file: median and interval of every wall."""

    def rows(values: Floats) -> list[dict[str, float]]:
        said = (spread(values[:, i]) for i in range(DAMPINGS.size))
        return [
            {"damping_ns_per_mm": round(float(b), 3), "median": m, "p5": low, "p95": high}
            for b, (m, low, high) in zip(DAMPINGS, said, strict=True)
        ]

    return {
        "draws": DRAWS,
        "seed": SEED,
        "ultimate_period_ms": {
            name: spread(1e3 * t) for name, t in zip(("encoder", "hall"), p.periods, strict=True)
        },
        "stiffness_nm_per_rad": {n: rows(p.walls[:, i]) for i, n in enumerate(ESTIMATORS)},
        "stiffness_n_per_mm": {n: rows(p.at_the_end[:, i]) for i, n in enumerate(ESTIMATORS)},
        "order": [ESTIMATORS[i] for i in p.order],
    }


def draw_walls(p: Prediction) -> Figure:
    """Draw K over B with the interval of each estimator, beside the difference."""
    with rc_context(STYLE):
        figure = Figure(figsize=(12.5, 3.6), layout="constrained")
        panels = figure.subplots(1, len(ESTIMATORS), sharey=True)
        plain = np.median(p.walls[:, 0], axis=0)
        for i, (name, axes) in enumerate(zip(ESTIMATORS, panels, strict=True)):
            low, median, high = np.percentile(p.walls[:, i], [LOW, 50.0, HIGH], axis=0)
            axes.fill_between(DAMPINGS, low, high, color=COLOURS[i], alpha=0.2, linewidth=0.0)
            axes.plot(DAMPINGS, median, color=COLOURS[i], linewidth=1.8)
            if i > 0:
                axes.plot(DAMPINGS, plain, color="0.3", linestyle=DASHES[1], linewidth=1.0)
            axes.set_title(NAMES[name])
            axes.set_xlabel("$B$ at the end of the paddle [N s/mm]")
            axes.set_xticks(DAMPINGS[::4])
        panels[0].set_ylabel("stiffest wall [N m/rad]")
        panels[0].set_ylim(bottom=0.0)
        panels[1].text(0.03, 0.04, "dashed: median of the difference", fontsize=8, color="0.3",
                       transform=panels[1].transAxes)  # fmt: skip
    return figure


def draw_shapes(p: Prediction) -> Figure:
    """Draw K over its largest, and K over that of the difference."""
    with rc_context(STYLE):
        figure = Figure(figsize=(8.6, 3.6), layout="constrained")
        left, right = figure.subplots(1, 2)
        for i, name in enumerate(ESTIMATORS):
            look: dict[str, Any] = {"color": COLOURS[i], "linestyle": DASHES[i]}
            left.plot(DAMPINGS, np.median(p.walls[:, i] / p.largest[:, [i]], axis=0),
                      label=NAMES[name], **look)  # fmt: skip
            low, median, high = np.percentile(
                p.walls[:, i] / p.walls[:, 0], [25.0, 50.0, 75.0], axis=0
            )
            right.fill_between(DAMPINGS, low, high, color=COLOURS[i], alpha=0.15, linewidth=0.0)
            right.plot(DAMPINGS, median, **look)
        left.set_ylim(0.0, 1.05)
        left.set_ylabel("$K$ over its largest")
        right.set_ylabel("$K$ over that of the difference")
        for axes in (left, right):
            axes.set_xlabel("$B$ at the end of the paddle [N s/mm]")
            axes.set_xticks(DAMPINGS[::4])
        left.legend(loc="lower right")
        left.set_title("shape of each boundary: median of the draws")
        right.set_title("ratio to the difference: median and middle half")
    return figure


def _said(values: Floats, digits: str = ".0f") -> str:
    median, low, high = spread(values)
    return f"{median:{digits}} ({low:{digits}}\u2013{high:{digits}})"


def section(p: Prediction) -> str:
    """Return what the page says, with its two tables."""
    walls = ["| B [N s/mm] | " + " | ".join(NAMES[n] for n in ESTIMATORS) + " |",
             "|---" * (1 + len(ESTIMATORS)) + "|"]  # fmt: skip
    for j, b in enumerate(DAMPINGS):
        cells = (_said(p.walls[:, i, j]) for i in range(len(ESTIMATORS)))
        walls.append(f"| {b:.3f} | " + " | ".join(cells) + " |")
    top = ["| estimator | largest K [N m/rad] | at the tip [N/mm] | at B [N s/mm] |"
           " K(0) / largest | K(0.024) / largest |", "|---" * 6 + "|"]  # fmt: skip
    for i in p.order:
        ends = (p.walls[:, i, k] / p.largest[:, i] for k in (0, -1))
        top.append(
            f"| {NAMES[ESTIMATORS[i]]} | {_said(p.largest[:, i])} |"
            f" {_said(p.at_the_end[:, i].max(axis=1), '.1f')} | {_said(p.where[:, i], '.3f')} | "
            + " | ".join(_said(one, ".2f") for one in ends) + " |"
        )  # fmt: skip
    pairs = (
        f"{NAMES[ESTIMATORS[a]]} above {NAMES[ESTIMATORS[b]]} in {100.0 * p.beats(a, b):.0f} %"
        for a, b in itertools.pairwise(p.order)
    )
    text = (
        "The estimators are ordered by the median of the largest K. Share of draws with this order:"
        f" {', '.join(pairs)}. At B = 0 the velocity has no effect, and the four are equal."
        f" {p.periods_tried[0].size} rigs were drawn, with periods of"
        f" {_said(1e3 * p.periods_tried[0], '.1f')} and"
        f" {_said(1e3 * p.periods_tried[1], '.1f')} ms. The {p.walls.shape[0]} rigs whose periods"
        f" are within {100.0 * NEAR:.0f} % of the given ones are kept; their periods are"
        f" {_said(1e3 * p.periods[0], '.1f')} and {_said(1e3 * p.periods[1], '.1f')} ms. Their"
        f" damper is {_said(p.damping, '.3f')} N m s/rad. All walls, in N m/rad:"
    )
    said = textwrap.wrap(text, 99, break_long_words=False, break_on_hyphens=False)
    return "\n".join([*top, "", *said, "", *walls])


def made() -> str:
    """Predict, write what is kept, and return the section."""
    found = predict()
    p = Prediction.of(found)
    kept = as_json(p) | {"rigs": [asdict(one.rig) | {"damping": one.damping} for one in found.kept]}
    write_text(FOLDER / "paddle_prediction.json", json.dumps(kept, indent=1) + "\n")
    for name, figure in (("paddle_walls", draw_walls(p)), ("paddle_shapes", draw_shapes(p))):
        write_with(
            FOLDER / f"{name}.png", lambda file, f=figure: f.savefig(file, format="png", dpi=150)
        )
    return section(p)


if __name__ == "__main__":
    with writing_as("python docs/paddle_prediction.py", True):
        sys.stdout.write(made() + "\n")

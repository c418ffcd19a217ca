"""Find recordings that are unlike the others: in a parameter, or in how badly they fit.

For each parameter the course of the fleet is fitted robustly: linear in the known columns, with
iterated weights (Tukey's biweight: Huber & Ronchetti, Robust Statistics, 2nd ed., 7), so that
recordings far from it have no influence. A recording is odd in a parameter if

    |y_i - f(columns_i)| > t sqrt(s_i^2 + tau^2),

where tau is the scatter of recordings beyond their errors (from their median absolute deviation),
and t the quantile of Student's t for which, by chance, any of all tests exceeds it with probability
ALPHA. The same test is made within each device that was recorded at least three times, about its
own median. A recording fits badly if its noise, or the error of its free runs, is equally far from
the others'. It also fits badly if the error of its free runs exceeds its motion, unless this is so
for the others too: then the structure explains nothing in it, which its parameters do not show
because their errors are large.

Limits: most of a fleet must be sound. Of three recordings of a device one can be found odd, of two
none.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from zwidth.diagnosis.selection.evidence import ALPHA
from zwidth.fleet.grouping import places_by
from zwidth.fleet.quick import Quick
from zwidth.fleet.switched_off import LOST
from zwidth.shown import Valued

Floats = NDArray[np.float64]
BIWEIGHT = 4.685  # deviations beyond which a recording has no weight
TURNS = 30
MAD = 1.4826  # standard deviation over median absolute deviation of a normal distribution
ROWS = 5  # least number of recordings per column
NO_MATTER = 0.01  # of a parameter: a smaller deviation does not matter
NOISE, FREE = 0.15, 0.3  # least scatter of ln noise and ln free-run error between recordings
HELD = 0.05  # of a recording: a sound sensor's reading is never constant for so long
LOST_TIMES = 3.0  # times the others' error, above which the recording is wrong, not the structure
FEWEST = 3  # least number of recordings of a device that are compared with each other
THEM, OWN, NOISE_OFF, FREE_OFF, STILL = "parameter", "within", "noise", "free run", "still"


@dataclass(frozen=True)
class Course:
    """The course of a parameter over the fleet: the value expected (n,) of each recording.

    tau: scatter of recordings beyond their errors; within: the same within devices.
    """

    expected: Floats
    tau: float
    within: float


@dataclass(frozen=True)
class Odd(Valued):
    """Why a recording is unlike the others: (kind, parameter or "", sigma) of each reason."""

    signs: tuple[tuple[str, str, float], ...]

    @property
    def fits_badly(self) -> bool:
        """Whether the structure does not explain the recording with any parameters."""
        return any(kind in (NOISE_OFF, FREE_OFF, STILL) for kind, _, _ in self.signs)

    @property
    def parameters(self) -> list[str]:
        """The parameters in which the recording is odd, the farthest first."""
        own = sorted((s for s in self.signs if s[1]), key=lambda s: -s[2])
        return list(dict.fromkeys(name for _, name, _ in own))


def courses(
    values: Floats, errors: Floats, devices: Sequence[str], columns: Mapping[str, Floats]
) -> list[Course]:
    """Return the course of each parameter; values, errors (n, q)."""
    own = list(columns.values()) if values.shape[0] >= ROWS * (len(columns) + 1) else []
    whole = [c for c in own if np.ptp(c) > 0.0]
    design = np.column_stack(
        [np.ones(values.shape[0]), *((c - c.mean()) / np.ptp(c) for c in whole)]
    )
    return [_course(values[:, k], errors[:, k], devices, design) for k in range(values.shape[1])]


def _course(y: Floats, s: Floats, devices: Sequence[str], design: Floats) -> Course:
    told = np.isfinite(s)
    if not told.any():
        return Course(np.full(y.size, float(np.median(y))), 0.0, 0.0)
    centre = float(np.median(y[told]))
    expected, scale = np.full(y.size, centre), _spread(y[told] - centre)
    floor = NO_MATTER * abs(centre)
    for _ in range(TURNS):
        size = np.sqrt(s[told] ** 2 + max(scale, floor) ** 2)
        u = (y - expected)[told] / (BIWEIGHT * size)
        weight = np.where(np.abs(u) < 1.0, (1.0 - u**2) ** 2, 0.0) / size**2
        if np.count_nonzero(weight) <= 2 * design.shape[1]:
            break
        root = np.sqrt(weight)
        b = np.linalg.lstsq(root[:, None] * design[told], root * y[told])[0]
        moved = design @ b
        done = np.allclose(moved, expected, rtol=1e-9)
        expected, scale = moved, _spread((y - moved)[told])
        if done:
            break
    error = float(np.median(s[told]))
    tau = max(np.sqrt(max(scale**2 - error**2, 0.0)), floor)
    return Course(expected, float(tau), max(_within(y - expected, s, devices), floor))


def _spread(off: Floats) -> float:
    return MAD * float(np.median(np.abs(off)))


def _within(off: Floats, s: Floats, devices: Sequence[str]) -> float:
    """The scatter of recordings of one device beyond their errors."""
    about: list[float] = []
    error: list[float] = []
    for every in places_by(devices).values():
        mine = every[np.isfinite(s[every])]
        if mine.size >= 2:
            # Differences of consecutive recordings, which contain little of a drift over years.
            about += (np.diff(off[mine]) / np.sqrt(2.0)).tolist()
            error += s[mine].tolist()
    if not about:
        return 0.0
    scale = MAD * float(np.median(np.abs(about)))
    return float(np.sqrt(max(scale**2 - float(np.median(error)) ** 2, 0.0)))


def odd_ones(
    quicks: Sequence[Quick], names: Sequence[str], devices: Sequence[str], found: Sequence[Course]
) -> dict[int, Odd]:
    """Return the recordings that are unlike the others, by index; quicks: all fitted recordings."""
    n, q = len(quicks), len(names)
    asked = n * (2 * q + 3)
    t = float(student.isf(ALPHA / (2.0 * asked), max(3, n - 1)))
    # If there are several devices, their number determines how well the scatter is known.
    count = len(set(devices))
    between = float(student.isf(ALPHA / (2.0 * asked), max(3, (count if count > 1 else n) - 1)))
    signs: dict[int, list[tuple[str, str, float]]] = {}

    def say(place: int, kind: str, name: str, sigma: float) -> None:
        signs.setdefault(place, []).append((kind, name, float(sigma)))

    values, errors = np.stack([o.values for o in quicks]), np.stack([o.errors for o in quicks])
    own = list(places_by(devices).values())
    for k, course in enumerate(found):
        off = values[:, k] - course.expected
        sigma = np.abs(off) / np.sqrt(errors[:, k] ** 2 + course.tau**2)
        for place in np.flatnonzero(sigma > between).tolist():
            say(place, THEM, names[k], sigma[place])
        for every in own:
            mine = every[np.isfinite(errors[every, k])]
            if mine.size < FEWEST:
                continue
            about = off[mine] - np.median(off[mine])
            inside = np.abs(about) / np.sqrt(errors[mine, k] ** 2 + course.within**2)
            for place, sigma_of in zip(mine.tolist(), inside.tolist(), strict=True):
                if sigma_of > t:
                    say(place, OWN, names[k], sigma_of)
    for kind, least, sizes in (
        (NOISE_OFF, NOISE, [o.noise for o in quicks]),
        (FREE_OFF, FREE, [o.free for o in quicks]),
    ):
        logs = np.log(np.maximum(sizes, 1e-300))
        off = logs - np.median(logs)
        sigma = off / max(_spread(off), least)
        sigma = np.abs(sigma) if kind == NOISE_OFF else sigma
        lost = np.array(sizes) > max(LOST, LOST_TIMES * float(np.median(sizes)))
        far = (sigma > t) | (lost & (kind == FREE_OFF))
        for place in np.flatnonzero(far).tolist():
            say(place, kind, "", sigma[place])
    typical = float(np.median([o.held for o in quicks]))
    for place, one in enumerate(quicks):
        if one.held > max(HELD, 5.0 * typical):
            say(place, STILL, "", one.held / max(typical, HELD / 5.0))
    return {place: Odd(tuple(each)) for place, each in signs.items()}

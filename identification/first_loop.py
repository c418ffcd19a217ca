"""A starting device for recordings whose command is a goal: a loop on the position of one mass.

    m q'' + b q' = K (g(t - tau) - q)

Only the goal drives the device, so the scale is undetermined: m is set to 1, and K / m and b / m
are fitted by least squares over a free run of the whole recording, with the goal held over each
sample. A delay tau of whole samples is fitted too, otherwise K and b would compensate it. Like
friction and limits, the delay is not in the returned device, since the diagnosis has to find it.
The position is compared, or the speed if only that was measured.

An integrating loop on the speed is the same loop: with the gains k_p and k_i,

    m v' + b v = k_p (g - v) + k_i integral(g - v),

and with Q and G the integrals of v and g, T = k_p / k_i, this is K = k_i, a damper b + k_p, and the
goal G + T g. The response is linear in T, which is solved for at every step (`speed_loop`).
"""

import cmath
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import lfilter

from zwidth.identification.first_device import LEAST_SAMPLES, MOST_SAMPLES, Motion
from zwidth.identification.response import RecordingError

Floats = NDArray[np.float64]
FREQUENCIES, RATIOS = 16, (0.3, 0.7, 1.5, 4.0)  # damping ratios of the loop that are tried
LATEST_S, MOST_DELAYS = 0.3, 24  # longest delay tried, and number of delays
FASTEST = 0.5  # of the loop's frequency [rad/s], over the sampling rate
STEPS = 60

Left = Callable[[Floats, Floats, Floats, int], Floats]
"""Goal, motion, logarithms of frequency and damping ratio, delay in samples -> the residual."""


@dataclass(frozen=True)
class FirstLoop:
    """K / m [1/s2], b / m [1/s], the delay [s], and the rms error relative to the motion."""

    stiffness: float
    damper: float
    delay: float
    error: float


@dataclass(frozen=True)
class SpeedLoop:
    """An integrating loop on the speed: T [s], the delay [s], the error relative to the motion.

    stiffness: K / m [1/s2]; proportional: the error of a loop that does not integrate.
    """

    integral_time: float
    stiffness: float
    delay: float
    error: float
    proportional: float


def first_loop(motions: Sequence[Motion]) -> FirstLoop:
    """Return the position loop fitted to recordings of goals and positions.

    Raises RecordingError if they are too short, or have neither position nor velocity of m1.
    """
    pairs: list[tuple[Floats, Floats]] = []
    known = (("position", 0), ("velocity", 0))
    kind = next((k for k in known if all(k in m.quantities for m in motions)), None)
    for motion in motions:
        if motion.command is None or kind is None:
            raise RecordingError("a position loop needs a goal, and the position or velocity of m1")
        moved = motion.outputs[:, motion.quantities.index(kind)]
        pairs.append((motion.command[:MOST_SAMPLES], moved[:MOST_SAMPLES]))
    period = motions[0].period
    speed = kind == known[1]

    def left(goal: Floats, moved: Floats, x: Floats, late: int) -> Floats:
        late_goal = _late(goal, late) - goal[0]
        columns = _answers([late_goal], x, moved.size, period, speed)
        return _unexplained(moved - columns[0], columns[1:])

    x, late, error = _fitted(left, pairs, period)
    frequency, ratio = np.exp(x).tolist()
    return FirstLoop(frequency**2, 2.0 * ratio * frequency, late * period, error)


def speed_loop(goal: Floats, speed: Floats, period: float) -> SpeedLoop:
    """Return the integrating speed loop fitted to goal and speed (samples,), both in SI.

    Raises RecordingError if they are too short.
    """
    pair = [(goal[:MOST_SAMPLES], speed[:MOST_SAMPLES])]

    def answers(x: Floats, late: int) -> Floats:
        asked = _late(pair[0][0], late)
        others = _answers([asked], x, asked.size, period, True)
        # The speed responds to the goal's integral as the position responds to the goal; the
        # integral is not held over a sample.
        reached = _answers([asked], x, asked.size, period, False)[:1]
        return np.vstack([reached, others])

    def left(_: Floats, moved: Floats, x: Floats, late: int) -> Floats:
        columns = answers(x, late)
        return _unexplained(moved - columns[0], columns[1:])

    x, late, error = _fitted(left, pair, period)
    reached, *others = answers(x, late)
    time = float(np.linalg.lstsq(np.transpose(others), pair[0][1] - reached, rcond=None)[0][0])

    def of_first_order(goal: Floats, moved: Floats, x: Floats, late: int) -> Floats:
        pole = math.exp(-math.exp(float(x[0])) * period)
        own = lfilter([0.0, 1.0 - pole], [1.0, -pole], _late(goal, late))
        began = np.asarray(pole ** np.arange(moved.size), dtype=np.float64)
        columns = np.vstack([own, np.ones(moved.size), began]).astype(np.float64)
        return _unexplained(moved, columns)

    _, _, without = _fitted(of_first_order, pair, period, (1.0,))
    return SpeedLoop(time, math.exp(2.0 * float(x[0])), late * period, error, without)


def _fitted(
    left: Left,
    pairs: Sequence[tuple[Floats, Floats]],
    period: float,
    ratios: Sequence[float] = RATIOS,
) -> tuple[Floats, int, float]:
    """Return the logarithms and the delay of least error, and that error relative to the motion."""
    shortest = min(goal.size for goal, _ in pairs)
    if shortest < LEAST_SAMPLES:
        raise RecordingError(
            f"the recording has {shortest} samples; at least {LEAST_SAMPLES} are needed, and 10 s"
            " is plenty"
        )

    def residual(x: Floats, late: int) -> Floats:
        return np.concatenate([left(goal, moved, x, late) for goal, moved in pairs])

    slowest, fastest = 2.0 * math.pi / (shortest * period), FASTEST / period
    latest = min(int(LATEST_S / period), shortest // 4)
    delays = sorted({round(d) for d in np.linspace(0, latest, MOST_DELAYS)})
    grid = [
        np.array([math.log(w), math.log(ratio)])
        for w in np.geomspace(slowest, fastest, FREQUENCIES)
        for ratio in ratios
    ]
    tried = [(float(np.sum(residual(x, d) ** 2)), d, x) for x, d in itertools.product(grid, delays)]
    _, late, best = min(tried, key=lambda one: one[0])
    limits = ([math.log(0.5 * slowest), -4.0], [math.log(2.0 * fastest), 4.0])

    @cache
    def descended(late: int) -> tuple[float, Floats]:
        fit = least_squares(residual, best, args=(late,), max_nfev=STEPS, bounds=limits)
        return 2.0 * float(fit.cost), fit.x

    step = max(1, latest // MOST_DELAYS)
    while True:  # refine: each delay needs its own fitted loop, and the grid is coarse
        near = [d for d in (late - step, late, late + step) if 0 <= d <= latest]
        lower = min(near, key=lambda d: descended(d)[0])
        if lower == late and step == 1:
            break
        late, step = (lower, step) if lower != late else (late, step // 2)
    left_over, x = descended(late)
    size = math.sqrt(sum(float(np.sum((y - y.mean()) ** 2)) for _, y in pairs)) or 1.0
    return x, late, math.sqrt(left_over) / size


def _late(goal: Floats, late: int) -> Floats:
    return np.concatenate([np.full(late, goal[0]), goal[: goal.size - late]])


def _answers(goals: Sequence[Floats], x: Floats, count: int, period: float, speed: bool) -> Floats:
    """Return as rows the loop's responses to goals, to a constant, and to its initial state.

    They are positions, or speeds if `speed`.
    """
    frequency, ratio = np.exp(x).tolist()
    power = _over_a_sample(frequency, ratio, period)
    held = np.array([1.0, 0.0]) - power[:, 0]  # response of the position to a held goal
    poles = [1.0, -float(np.trace(power)), float(np.linalg.det(power))]
    own, other = (1, 0) if speed else (0, 1)
    zeros = [0.0, float(held[own]),
             float(power[own, other] * held[other] - power[other, other] * held[own])]  # fmt: skip
    impulse = np.zeros(count)
    impulse[0] = 1.0
    began = lfilter([1.0], poles, impulse)
    answers = [lfilter(zeros, poles, goal) for goal in goals]
    return np.vstack([*answers, np.ones(count), began, np.append(0.0, began[:-1])])


def _over_a_sample(frequency: float, ratio: float, period: float) -> Floats:
    """Return the exponential of the loop's matrix over a period, (2, 2), in closed form."""
    decay = ratio * frequency
    root = cmath.sqrt(decay**2 - frequency**2) or 1e-12 * frequency
    slow, fast = cmath.exp((root - decay) * period), cmath.exp(-(root + decay) * period)
    even, odd = (0.5 * (slow + fast)).real, ((slow - fast) / (2.0 * root)).real
    return np.array([
        [even + decay * odd, odd],
        [-(frequency**2) * odd, even - decay * odd],
    ])  # fmt: skip


def _unexplained(wanted: Floats, columns: Floats) -> Floats:
    """Return the residual of the target after a fit of the columns, large if they overflow."""
    if not (np.all(np.isfinite(columns)) and np.all(np.isfinite(wanted))):
        return np.full(wanted.size, 1e6)
    basis, _ = np.linalg.qr(columns.T)
    return wanted - basis @ (basis.T @ wanted)

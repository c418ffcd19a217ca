"""A device to start from whose command is a goal: a loop on the position of one mass.

    m q'' + b q' = K (g(t - tau) - q)

The goal alone drives, so that nothing tells the scale: m is counted as 1, and K / m and b / m are
fitted, by least squares over the whole recording in a free run from its first sample, the goal held
over each sample. A delay tau of whole samples is fitted with them, or K and b would make up for it;
like friction and limits it is not in the device that is returned, but left for the diagnosis to
say.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import least_squares
from scipy.signal import lfilter

from zwidth.identification.first_device import LEAST_SAMPLES, MOST_SAMPLES, Motion
from zwidth.identification.response import RecordingError

Floats = NDArray[np.float64]
FREQUENCIES, RATIOS = 16, (0.3, 0.7, 1.5, 4.0)  # of the loop, that are tried
LATEST_S, MOST_DELAYS = 0.3, 24  # longest delay tried, and how many
FASTEST = 0.5  # of the loop's frequency [rad/s], over the sampling rate
STEPS = 60


@dataclass(frozen=True)
class FirstLoop:
    """K / m [1/s2], b / m [1/s], the delay [s] beside them, and the error over the motion."""

    stiffness: float
    damper: float
    delay: float
    error: float


def first_loop(motions: Sequence[Motion]) -> FirstLoop:
    """Return the loop that recordings of goals and positions ask for.

    Raises RecordingError where they are too short, or have no position of m1.
    """
    pairs: list[tuple[Floats, Floats]] = []
    for motion in motions:
        if motion.command is None or ("position", 0) not in motion.quantities:
            raise RecordingError("a loop on the position needs a goal and the position of m1")
        moved = motion.outputs[:, motion.quantities.index(("position", 0))]
        pairs.append((motion.command[:MOST_SAMPLES], moved[:MOST_SAMPLES]))
    period = motions[0].period
    shortest = min(goal.size for goal, _ in pairs)
    if shortest < LEAST_SAMPLES:
        raise RecordingError(
            f"the recording has {shortest} samples; at least {LEAST_SAMPLES} are needed, 10 s are"
            " good"
        )

    def residual(x: Floats, late: int) -> Floats:
        return np.concatenate([_left(goal, moved, x, late, period) for goal, moved in pairs])

    slowest, fastest = 2.0 * math.pi / (shortest * period), FASTEST / period
    latest = min(int(LATEST_S / period), shortest // 4)
    delays = sorted({round(d) for d in np.linspace(0, latest, MOST_DELAYS)})
    grid = [
        np.array([math.log(w), math.log(ratio)])
        for w in np.geomspace(slowest, fastest, FREQUENCIES)
        for ratio in RATIOS
    ]
    tried = [(float(np.sum(residual(x, d) ** 2)), d, x) for x, d in itertools.product(grid, delays)]
    _, late, best = min(tried, key=lambda one: one[0])
    step = delays[1] - delays[0] if len(delays) > 1 else 1
    limits = ([math.log(0.5 * slowest), -4.0], [math.log(2.0 * fastest), 4.0])
    found = [
        (least_squares(residual, best, args=(d,), max_nfev=STEPS, bounds=limits), d)
        for d in range(max(0, late - step), min(latest, late + step) + 1)
    ]
    fit, late = min(found, key=lambda one: float(one[0].cost))
    frequency, ratio = np.exp(fit.x).tolist()
    size = math.sqrt(sum(float(np.sum((y - y.mean()) ** 2)) for _, y in pairs)) or 1.0
    error = math.sqrt(2.0 * float(fit.cost)) / size
    return FirstLoop(frequency**2, 2.0 * ratio * frequency, late * period, error)


def _left(goal: Floats, moved: Floats, x: Floats, late: int, period: float) -> Floats:
    """Return what the loop leaves of a position, but for where it began and a constant."""
    frequency, ratio = np.exp(x).tolist()
    rate = np.array([[0.0, 1.0, 0.0], [-(frequency**2), -2.0 * ratio * frequency, frequency**2],
                     [0.0, 0.0, 0.0]])  # fmt: skip
    step = expm(rate * period)
    power, held = step[:2, :2], step[:2, 2]
    poles = [1.0, -float(np.trace(power)), float(np.linalg.det(power))]
    zeros = [0.0, float(held[0]), float(power[0, 1] * held[1] - power[1, 1] * held[0])]
    asked = np.concatenate([np.full(late, goal[0]), goal[: goal.size - late]]) - goal[0]
    answered = lfilter(zeros, poles, asked)
    impulse = np.zeros(moved.size)
    impulse[0] = 1.0
    began = lfilter([1.0], poles, impulse)
    basis = np.column_stack([np.ones(moved.size), began, np.append(0.0, began[:-1])])
    left = np.asarray(moved - answered, dtype=np.float64)
    if not (np.all(np.isfinite(basis)) and np.all(np.isfinite(left))):
        return np.full(moved.size, 1e6)
    norms = np.linalg.norm(basis, axis=0)
    return left - basis @ (np.linalg.lstsq(basis / norms, left, rcond=1e-9)[0] / norms)

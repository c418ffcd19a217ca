"""Which signal of a file is the command and which are the motion: by names, then by values.

Names say what is measured and what is commanded (`logs/names.py`). Of the joints of a robot the one
that moves most is taken, with what drives that joint. Where names are ambiguous, numbers decide if
they can: whether an "action" is a goal that the position follows, whether "v" is a speed or a
voltage, whether a speed is a separate measurement. Every choice among several is reported in a
sentence.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import correlate

from zwidth.logs.guess import unit_seen
from zwidth.logs.names import Naming, side_words, words_of
from zwidth.logs.source import Signal

Floats = NDArray[np.float64]
LONGEST = 20_000  # most samples that are compared
FOLLOWS = 0.9  # correlation at the best delay, above which a position follows a goal
LATEST = 0.1  # of the recording: largest delay at which it follows
ALIKE = (0.3, 3.0)  # range of a goal's size over that of the motion that tracks it
RATE = 0.9  # correlation with a position's slope, above which a speed belongs to it
SCALED = 0.1  # largest relative difference of their sizes
NOTHING_NEW = 1e-3  # largest rest of a speed that was computed from differences of the position
STEADILY = 0.3  # scatter of a speed over its mean, below which it hardly varies
STEADY = 0.05  # scatter of a voltage over its mean, below which it is a supply
FIRST = {"torque": 0, "input": 1, "current": 2, "voltage": 3, "duty": 4}


def differing(names: Mapping[str, Naming]) -> dict[str, tuple[str, ...]]:
    """Return the words by which each of several names differs from the others: its joint."""
    sets = [set(one.joint) for one in names.values()]
    common = set.intersection(*sets) if sets else set[str]()
    return {key: tuple(w for w in one.joint if w not in common) for key, one in names.items()}


def of_joint(one: Naming, joint: str) -> bool:
    """Return whether a name belongs to the joint with a given name or number."""
    wanted = words_of(joint)[::-1]
    own = list(one.words)
    split = [part for word in wanted for part in _parts(word)]
    return any(own[i : i + len(split)] == split for i in range(len(own) - len(split) + 1))


def _parts(word: str) -> list[str]:
    head = word.rstrip("0123456789")
    return [part for part in (head, word[len(head) :]) if part]


def follows(goal: Signal, motion: Signal) -> bool:
    """Return whether a motion follows a goal, at most `LATEST` of the recording later."""
    pair = _pair(goal, motion)
    if pair is None:
        return False
    asked, moved = pair
    sizes = float(np.std(asked)), float(np.std(moved))
    if min(sizes) == 0.0 or not ALIKE[0] < sizes[0] / sizes[1] < ALIKE[1]:
        return False
    asked, moved = (asked - asked.mean()) / sizes[0], (moved - moved.mean()) / sizes[1]
    late = correlate(moved, asked, "full", "fft")[asked.size - 1 :][: int(LATEST * asked.size) + 1]
    return bool(late.max() > FOLLOWS * asked.size)


@dataclass(frozen=True)
class Speed:
    """How a speed compares with a position: correlation with its slope, ratio to it, and news.

    news: the share of the speed that differences of neighbouring positions do not explain.
    """

    correlation: float
    size: float
    news: float


def speed_of(position: Signal, speed: Signal, t: NDArray[Any]) -> Speed | None:
    """Compare a speed with the slope of a position over times t; None if nothing moves."""
    pair = _pair(position, speed, t)
    if pair is None or len(pair) < 3 or pair[0].size < 16:
        return None
    y, v, when = pair
    steps = np.diff(when)
    if np.any(steps <= 0.0):
        return None
    best, size = -1.0, 0.0
    for over in (2, 8, 32, 128):  # with coarse steps, the slope over few samples is only noise
        if 4 * over > y.size:
            break
        slope = (y[over:] - y[:-over]) / (when[over:] - when[:-over])
        mean = np.convolve(v, np.ones(over + 1) / (over + 1), "valid")
        alike = _alike(slope, mean)
        if alike > best:
            best, size = alike, _fit(slope, mean)
    backward = np.diff(y) / steps
    v = v[1:-1]
    slopes = (backward[:-1], backward[1:], 0.5 * (backward[:-1] + backward[1:]))
    norm = float(np.linalg.norm(v))
    left = [float(np.linalg.norm(v - _fit(s, v) * s)) / norm if norm else 1.0 for s in slopes]
    return Speed(best, size, min(left))


def _alike(one: Floats, other: Floats) -> float:
    """Return the correlation; about zero where both hardly vary, as of what coasts."""
    if np.std(one) > STEADILY * abs(one.mean()):
        one, other = one - one.mean(), other - other.mean()
    size = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float(one @ other) / size if size else -1.0


def _fit(x: Floats, y: Floats) -> float:
    power = float(x @ x)
    return float(x @ y) / power if power else 0.0


def _pair(one: Signal, other: Signal, t: NDArray[Any] | None = None) -> list[Floats] | None:
    a, b = one.floats(), other.floats()
    if a.size != b.size or (t is not None and t.size != a.size):
        return None
    known = np.isfinite(a) & np.isfinite(b)
    if t is not None:
        known &= np.isfinite(t)
    if known.sum() < 2:
        return None
    rows = (a, b) if t is None else (a, b, t)
    return [np.asarray(row[known][:LONGEST], dtype=np.float64) for row in rows]


def supplies(signal: Signal) -> bool:
    """Return whether a voltage is so constant that it is a supply and not a command."""
    values = signal.floats()[signal.known]
    return bool(values.size) and float(np.std(values)) < STEADY * abs(float(np.mean(values)))


def span(signal: Signal) -> float:
    """Return the standard deviation of the known values, in the signal's unit or SI."""
    values = signal.floats()[signal.known]
    unit = unit_seen(signal)
    return (
        float(np.std(values)) * (unit.factor if unit is not None else 1.0) if values.size else 0.0
    )


def sided(names: Sequence[str]) -> tuple[str, str] | None:
    """Return the driven and the other side of several signals, None if they name no sides."""
    near = next((n for n in names if any(w in side_words("near") for w in words_of(n))), None)
    far = [n for n in names if n != near and any(w in side_words("far") for w in words_of(n))]
    if far and len(far) < len(names):
        return near or next(n for n in names if n not in far), far[0]
    return None


def rank(said: Naming) -> tuple[float, int]:
    """Return how directly a quantity gives the force; among equals, commanded ones come first."""
    unspecific = said.quantity == "input" and said.role == "command"
    order = 2 if said.role == "measured" else 1 if said.role == "" else 0
    return (6.0 if unspecific else float(FIRST[said.quantity])), order

"""Time stamps with a fault that can be corrected: a coarse clock, or one that started again.

A clock that counts in steps longer than the sampling period gives several samples one stamp. If a
line through stamps over sample numbers is within one such step of all of them, samples were even,
and the line gives the times; otherwise samples with one stamp are spread over the time to the next.
A counter that wraps goes back by the same amount every time; the stamps then continue. If a clock
starts again at its first value, after runs of any length, these are runs one after another, such as
the episodes of a data set; between them is a gap, which is not bridged.
"""

import numpy as np
from numpy.typing import NDArray

from zwidth.logs.timing import times

Floats = NDArray[np.float64]
SHARED = 0.1  # least share of all samples that repeat a stamp
ANEW = 0.5  # of the stamps' range: least step back of a counter
FEWEST = 10  # least samples of a run
BITS, EACH = (8, 10, 12, 15, 16, 20, 24, 31, 32), (1.0, 1e-3, 1e-6, 1e-7, 1e-9)
ALIKE = 0.02  # relative difference of a counter's steps back


def mended(t: Floats) -> tuple[Floats, str]:
    """Return finite stamps t [s] (samples,), corrected, and a sentence on it; "" if unchanged."""
    said: list[str] = []
    t, note = _runs(t) or _gone_on(t)
    said += [note] if note else []
    t, note = _spread(t)
    said += [note] if note else []
    return t, "; ".join(said)


def _runs(t: Floats) -> tuple[Floats, str] | None:
    """Return runs that all begin at one stamp as one after another, None for any other clock.

    A counter that wraps may begin at 0, too: its range is a power of two.
    """
    steps = np.diff(t)
    with np.errstate(over="ignore", invalid="ignore"):
        back = np.flatnonzero(steps < 0.0)
        begins = np.concatenate(([0], back + 1))
        forward = steps[steps > 0.0]
        if back.size == 0 or np.diff([*begins, t.size]).min() < FEWEST or forward.size == 0:
            return None
        usual = float(np.median(forward))
        if np.any(np.abs(t[begins] - t[0]) > 0.5 * usual):
            return None
        lengths = t[back] - t[back + 1] + usual
        if back.size > 1 and np.ptp(lengths) <= ALIKE * lengths[0] and _binary(lengths[0], usual):
            return None
        gap = max(1.0, 100.0 * usual)
        turns = np.zeros(t.size)
        turns[back + 1] = lengths + gap
        whole = t + np.cumsum(turns)
    if not np.all(np.isfinite(whole)):
        return None
    return whole, (
        f"the clock starts again at {t[0]:.6g} s, {times(back.size)}: {back.size + 1} runs are"
        " taken, one after another"
    )


def _binary(size: float, usual: float) -> bool:
    """Whether it is the range of a counter of bits in s, ms, us, ns or ticks of 100 ns."""
    return any(abs(size - 2.0**bits * each) <= 1.5 * usual for bits in BITS for each in EACH)


def _gone_on(t: Floats) -> tuple[Floats, str]:
    steps = np.diff(t)
    with np.errstate(over="ignore", invalid="ignore"):
        back = np.flatnonzero(steps < -ANEW * np.ptp(t)) if t.size > 2 else np.array([], np.int64)
    forward = steps[steps > 0.0]
    if back.size == 0 or back.size > t.size // 8 or forward.size == 0:
        return t, ""
    usual = float(np.median(forward))
    sizes = usual - steps[back]
    size = float(np.median(sizes))
    least = 4.0 * usual
    if not np.isfinite(size) or size < least or np.any(np.abs(sizes - size) > ALIKE * size):
        return t, ""
    if np.any(np.delete(steps, back) < 0.0):
        return t, ""
    turns = np.zeros(t.size)
    turns[back + 1] = 1.0
    return t + size * np.cumsum(turns), (
        f"the clock starts again every {size:.6g} s, {times(back.size)}: it is taken to go on"
    )


def _spread(t: Floats) -> tuple[Floats, str]:
    steps = np.diff(t)
    repeats = int(np.count_nonzero(steps == 0.0))
    forward = steps[steps > 0.0]
    if repeats < max(2.0, SHARED * t.size) or np.any(steps < 0.0) or forward.size < 2:
        return t, ""
    coarse = float(np.median(forward))
    count = np.arange(t.size)
    begins = np.flatnonzero(np.diff(t, prepend=t[0] - 1.0) > 0.0)
    own = begins[1:] if begins.size > 3 else begins  # the first run may have begun earlier
    about = own - own.mean()
    period = float(about @ (t[own] - t[own].mean()) / (about @ about))
    away = t - period * count
    line = 0.5 * float(away.min() + away.max()) + period * count
    if np.max(np.abs(t - line)) <= 1.01 * coarse:
        return line - line[0] + t[0], (
            f"the clock counts in steps of {coarse:.4g} s, and {repeats} of {t.size} samples share"
            f" a stamp with the one before: samples are taken as even, every {period:.6g} s"
        )
    ends = np.append(t[begins[1:]], t[begins[-1]] + coarse)
    sizes = np.diff(np.append(begins, t.size))
    inside = count - np.repeat(begins, sizes)
    return t + inside * np.repeat((ends - t[begins]) / sizes, sizes), (
        f"{repeats} of {t.size} samples share a stamp with the one before: they are spread over the"
        " time to the next stamp"
    )

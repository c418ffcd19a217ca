"""Samples at uneven times, resampled at even ticks if the motion shows that they were uneven.

A loop on a busy host samples late, and stamps the true times; a logger on such a host puts late
stamps on samples that were taken evenly. Both files look alike, and the motion distinguishes them.
The difference between a sample at index k and the cubic through its two neighbours on each side,

    r_k = y_k - (4 (y_(k-1) + y_(k+1)) - (y_(k-2) + y_(k+2))) / 6,

is b v_k d_k + noise, where d_k is the same difference of the stamp and v_k the slope there: b is 1
if samples were taken at their stamps, and 0 if they were even. The cubic also removes any drift of
the clock. Least squares over all samples and outputs gives b and its error.

Outputs are resampled by a cubic spline, whose error is of the fourth order in the interval; a
command, which is held, is replaced by its mean over each tick, which has the same impulse. Limits:
a spline does not smooth, but an encoder's values are no longer multiples of its step.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from zwidth.logs.drive_state import STATES
from zwidth.logs.recording_file import KNOWN_FORCE
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]

SCATTER = 0.01  # of the period: smaller scatter counts as even
SHOWN = 0.5  # b above which samples were taken when their stamps say
CLEARLY = 4.0  # least distance of b from 0 or 1, in standard errors
FEWEST = 50  # least samples for this test
LONGEST = 3.0  # periods that a spline may span; beyond, samples are lost


@dataclass(frozen=True)
class Scatter:
    """How much of the stamps' scatter the motion shows: share b and its standard error."""

    seconds: float
    share: float
    error: float

    @property
    def real(self) -> bool:
        """Whether samples were taken at the times of their stamps."""
        return self.share > SHOWN and self.share > CLEARLY * self.error


def scatter(trace: Trace, outputs: Sequence[str]) -> Scatter | None:
    """Return how clearly the outputs show uneven stamps; None if stamps are even, or too few."""
    t = trace.t
    if t.size < FEWEST:
        return None
    steps = np.diff(t)
    period = float(np.median(steps))
    late = _left(t)
    near = np.abs(np.lib.stride_tricks.sliding_window_view(steps, 4) / period - 1.0) < 0.9
    usual = near.all(axis=1) & (np.abs(late) < period)
    seconds = float(np.std(late[usual])) if usual.any() else 0.0
    if seconds < SCATTER * period or usual.sum() < FEWEST:
        return None
    moved, left = list[Floats](), list[Floats]()
    for name in outputs:
        y = trace[name]
        slope = (y[3:-1] - y[1:-3]) / (t[3:-1] - t[1:-3])
        one, other = (slope * late)[usual], _left(y)[usual]
        weight = float(np.median(np.abs(other))) or float(np.std(other)) or 1.0
        moved.append(one / weight)
        left.append(other / weight)
    x, r = np.concatenate(moved), np.concatenate(left)
    power = float(x @ x)
    if power == 0.0:
        return None
    share = float(x @ r) / power
    spread = x * (r - share * x)  # from each sample's own residual, since noise varies
    return Scatter(seconds, share, float(np.sqrt(spread @ spread)) / power)


def evened(trace: Trace, period: float, outputs: Sequence[str], name: str) -> tuple[Trace, str]:
    """Return a trace on even ticks of a period [s], and a sentence; unchanged if it is even.

    outputs: the channels that are interpolated, each finite, like known forces; `command`, if any,
    is averaged, and the recorded state of a drive is held. A late loop holds its command meanwhile,
    and no sample is lost; stretches between gaps of more than `LONGEST` periods each get their own
    ticks.
    """
    seen = scatter(trace, outputs)
    if seen is None:
        return trace, ""
    said = f"the intervals of {name} scatter by {seen.seconds:.2g} s"
    shows = f"{100.0 * seen.share:.0f} +- {196.0 * seen.error:.0f} % of it"
    if not seen.real:
        told = (
            "the motion does not show it"
            if seen.share + CLEARLY * seen.error < SHOWN
            else (f"the motion does not show whether samples were uneven ({shows} would show)")
        )
        return trace, f"{said}, and {told}: samples are taken as even"
    steps = np.diff(trace.t)
    cuts = np.flatnonzero(steps > LONGEST * float(np.median(steps))) + 1
    ends = [0, *(int(j) for j in cuts), len(trace)]
    parts = [_evened(trace, slice(a, b), period, outputs) for a, b in itertools.pairwise(ends)]
    parts = [part for part in parts if part is not None]
    if not parts:
        return trace, f"{said}, and no stretch is long enough to bring it onto even ticks"
    t = np.concatenate([at for at, _ in parts])
    channels = {key: np.concatenate([c[key] for _, c in parts]) for key in parts[0][1]}
    errs = [f"{name} by {_spline_error(trace.t, trace[name], ends):.2g}" for name in outputs]
    return trace.with_channels(channels, t), (
        f"{said}, and the motion shows {shows}: it is brought onto even ticks of {period:.6g} s by"
        f" a spline, which errs in {' and '.join(errs)} rms at the most"
    )


def _left(values: Floats) -> Floats:
    """The residual of a cubic through two neighbours on each side, (n - 4,)."""
    inner, outer = values[1:-3] + values[3:-1], values[:-4] + values[4:]
    return values[2:-2] - (4.0 * inner - outer) / 6.0


def _spline_error(t: Floats, values: Floats, ends: Sequence[int]) -> float:
    """Return what a spline errs by between samples, at most.

    One through every other sample errs 2^4 times as far at those left out, and by their noise
    besides.
    """
    left: list[Floats] = []
    for a, b in itertools.pairwise(ends):
        own, y = t[a:b], values[a:b]
        if own.size > 2 * FEWEST and np.all(np.diff(own) > 0.0):
            left.append((CubicSpline(own[::2], y[::2])(own[1:-1:2]) - y[1:-1:2])[2:-2])
    return float(np.sqrt(np.mean(np.concatenate(left) ** 2))) / 16.0 if left else float("nan")


def _evened(
    trace: Trace, cut: slice, period: float, outputs: Sequence[str]
) -> tuple[Floats, dict[str, Floats]] | None:
    """One stretch on ticks of its own; None if it is too short for a spline."""
    forward = np.concatenate(([True], np.diff(np.maximum.accumulate(trace.t[cut])) > 0.0))
    t = trace.t[cut][forward]
    if t.size < 4:
        return None
    at = t[0] + period * np.arange(int((t[-1] - t[0]) / period * (1.0 + 1e-9)) + 1)
    known = [c for c in trace.channels if c.startswith(KNOWN_FORCE)]
    channels = {n: CubicSpline(t, trace[n][cut][forward])(at) for n in (*outputs, *known)}
    if "command" in trace.channels:
        command = trace["command"][cut][forward]
        impulse = np.concatenate(([0.0], np.cumsum(command[:-1] * np.diff(t))))
        ends = np.append(at, at[-1] + period)
        beyond = np.maximum(ends - t[-1], 0.0) * command[-1]
        channels["command"] = np.diff(np.interp(ends, t, impulse) + beyond) / period
    last = np.searchsorted(t, at, side="right") - 1
    for state in STATES:
        if state in trace.channels:
            channels[state] = trace[state][cut][forward][last]
    return at, channels

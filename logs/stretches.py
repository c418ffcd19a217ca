"""Stretches of a recording without a missing sample; computations use only these.

A sample is missing if its row is missing, which the clock shows by a jump, or if a value of its row
is not a finite number: a sensor that begins late, a cell of text, an empty one. Both are treated
the same: rows without a number are removed, and the clock then jumps over them.

Short gaps need not cut a recording: `bridged` inserts ticks, and marks them. Missing measurements
are replaced there by a monotone cubic through their neighbours, for pictures and never for judging.
A missing command must follow from its neighbours: if a straight line between them does not
represent it, the gap is not bridged, since the device would be driven by a wrong force.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from zwidth.logs.drive_state import STATES
from zwidth.logs.steps import step_seen
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
Which = NDArray[np.bool_]
JUMP = 0.5  # periods by which the clock jumps
BESIDE = 11  # samples
LONGEST_BRIDGED = 10  # samples
WHOLE = 0.2  # of the period: most that a gap differs from whole samples, or a stamp from a tick
TOLD = 0.05  # of the command's rms: largest error of a straight line over a gap
MOST_BRIDGED = 0.5  # largest share of inserted samples


def without_gaps(trace: Trace, channels: Sequence[str], name: str) -> tuple[Trace, str]:
    """Return the samples at which all these channels have a finite value, and a note on the others.

    The note counts the removed samples and names the channels; "" if none were removed.
    """
    known = {channel: np.isfinite(trace[channel]) for channel in channels}
    whole = np.logical_and.reduce(list(known.values()), initial=True)
    if np.all(whole):
        return trace, ""
    kept = trace.with_channels({k: v[whole] for k, v in trace.channels.items()}, trace.t[whole])
    lost = np.flatnonzero(~whole)
    begun = int(np.count_nonzero(np.diff(lost, prepend=-2) > 1))
    without = ", ".join(channel for channel, finite in known.items() if not finite.all())
    has, are = ("has", "is") if lost.size == 1 else ("have", "are")
    where = "a gap" if begun == 1 else f"{begun} gaps, the first"
    return kept, (
        f"{lost.size} of {len(trace)} samples of {name} {has} no number for {without} and {are}"
        f" taken as lost: {where} at {trace.t[lost[0]]:.6g} s"
    )


def jumps(t: Floats, period: float) -> NDArray[np.int64]:
    """Return the samples before which the clock jumps permanently.

    Stamps of a busy host may be late and then catch up: then samples were even and none is lost. So
    the median of t / T - k over the `BESIDE` samples after a jump must differ from that before.
    """
    ahead = (t - t[0]) / period - np.arange(t.size)
    asked = np.flatnonzero(np.abs(np.diff(ahead)) > JUMP) + 1
    stays = [
        abs(np.median(ahead[k : k + BESIDE]) - np.median(ahead[max(0, k - BESIDE) : k])) > JUMP
        for k in asked
    ]
    return asked[np.array(stays, dtype=np.bool_)]


class Bridged(NamedTuple):
    """A trace with ticks inserted in short gaps, which ticks these are, and a note; "" for none."""

    trace: Trace
    ticks: Which
    note: str


def bridged(kept: Trace, whole: Trace, channels: Sequence[str], period: float) -> Bridged:
    """Return a trace without missing samples, with ticks inserted in gaps of `LONGEST_BRIDGED`.

    kept: from `without_gaps`, perhaps corrected later. whole: before that; its rows may have a
    command where nothing was measured. channels: those used for computations; period [s].
    """
    gaps = [(k, n) for k, n in _gaps(kept.t, period) if _tells(kept, whole, k, n, period)]
    lost = sum(n for _, n in gaps)
    if not gaps or lost > MOST_BRIDGED * len(kept):
        return Bridged(kept, np.zeros(len(kept), dtype=np.bool_), "")
    at = np.concatenate([np.full(n, k) for k, n in gaps])
    share = np.concatenate([np.arange(1, n + 1) / (n + 1) for _, n in gaps])
    between = kept.t[at - 1] + share * (kept.t[at] - kept.t[at - 1])
    t = np.insert(kept.t, at, between)
    ticks = np.insert(np.zeros(len(kept), dtype=np.bool_), at, True)
    made = {c: np.insert(v, at, _over(c, v, kept.t, between)) for c, v in kept.channels.items()}
    for channel in ("command", *STATES):
        if channel in made:
            rows, values = _recorded(whole, channel, between, period)
            made[channel][np.flatnonzero(ticks)[rows]] = values[rows]
    widest = max(n for _, n in gaps)
    gap = "1 gap" if len(gaps) == 1 else f"{len(gaps)} gaps"
    many = "1 sample" if widest == 1 else f"at most {widest} samples"
    are = "is" if len(gaps) == 1 else "are"
    return Bridged(
        kept.with_channels(made, t),
        ticks,
        f"{gap} of {many}, {lost} together, {are} bridged: the model goes on over them uncorrected,"
        " and they count for nothing",
    )


def _gaps(t: Floats, period: float) -> Iterator[tuple[int, int]]:
    """Short gaps of whole samples: the sample after each, and how many lack."""
    cuts = jumps(t, period) if t.size > 1 else np.array([], dtype=np.int64)
    ahead = (t - t[0]) / period - np.arange(t.size)
    ends = [0, *cuts.tolist(), t.size]
    for before, k, after in zip(ends[:-2], ends[1:-1], ends[2:], strict=True):
        near = ahead[max(before, k - BESIDE) : k], ahead[k : min(after, k + BESIDE)]
        lacking = float(np.median(near[1]) - np.median(near[0]))
        n = round(lacking)
        if 1 <= n <= LONGEST_BRIDGED and abs(lacking - n) <= WHOLE:
            yield k, n


def _tells(kept: Trace, whole: Trace, k: int, n: int, period: float) -> bool:
    """Whether the command over a gap of n before sample k was recorded, or its neighbours tell."""
    if "command" not in kept.channels:
        return True
    between = kept.t[k - 1] + np.arange(1, n + 1) / (n + 1) * (kept.t[k] - kept.t[k - 1])
    if _recorded(whole, "command", between, period)[0].all():
        return True
    u = kept["command"]
    if u.size < 2 * n + 3:
        return False
    middle = (n + 1) // 2
    line = u[: -n - 1] + middle / (n + 1) * (u[n + 1 :] - u[: -n - 1])
    wrong = u[middle : middle + line.size] - line
    return bool(np.sqrt(np.mean(wrong**2)) <= TOLD * np.sqrt(np.mean(u**2)))


def _recorded(whole: Trace, channel: str, at: Floats, period: float) -> tuple[Which, Floats]:
    """Which instants a channel was recorded at, and what (instants,)."""
    known = np.flatnonzero(np.isfinite(whole[channel]))
    if known.size == 0:
        return np.zeros(at.size, dtype=np.bool_), np.zeros(at.size)
    t = whole.t[known]
    after = np.clip(np.searchsorted(t, at), 1, max(1, t.size - 1))
    near = np.where(np.abs(t[after - 1] - at) < np.abs(t[np.minimum(after, t.size - 1)] - at),
                    after - 1, np.minimum(after, t.size - 1))  # fmt: skip
    return np.abs(t[near] - at) <= WHOLE * period, whole[channel][known[near]]


def _over(channel: str, values: Floats, t: Floats, at: Floats) -> Floats:
    """The assumed value of a channel that was not recorded."""
    known = np.isfinite(values)
    if known.sum() < 2:
        return np.full(at.size, np.nan)
    if channel in STATES:
        return values[np.searchsorted(t, at) - 1]
    if channel == "command" or np.any(np.diff(t[known]) <= 0.0):
        return np.interp(at, t[known], values[known])
    found = np.asarray(PchipInterpolator(t[known], values[known])(at), dtype=np.float64)
    step = step_seen(values[known])
    if step is None:
        return found
    origin = values[known][0]  # on the lattice of the encoder, if there is one
    return origin + step * np.round((found - origin) / step)


def longest_stretch(trace: Trace, channels: Sequence[str], name: str) -> tuple[Trace, str]:
    """Return the longest stretch without a gap, and a sentence on what is left out, "" for none.

    Short gaps are filled as in `bridged`, and reported.
    """
    kept, note = without_gaps(trace, channels, name)
    period = float(np.median(np.diff(kept.t))) if len(kept) > 1 else 0.0
    if period > 0.0:
        kept, _, said = bridged(kept, trace, channels, period)
        note = "; ".join(part for part in (note, said) if part)
    cuts = jumps(kept.t, period) if period > 0.0 else np.array([], dtype=np.int64)
    if cuts.size == 0:
        return kept, note
    ends = np.concatenate(([0], cuts, [len(kept)]))
    longest = int(np.argmax(np.diff(ends)))
    cut = slice(int(ends[longest]), int(ends[longest + 1]))
    used = kept.with_channels({k: v[cut] for k, v in kept.channels.items()}, kept.t[cut])
    before = float(kept.t[int(cuts[0]) - 1])
    jumped = f"the clock of {name} jumps {cuts.size} times, first after {before:g} s"
    return used, (
        f"{note or jumped}; the longest stretch without a gap is used, {len(used)} of {len(trace)}"
        f" samples from {used.t[0]:g} to {used.t[-1]:g} s"
    )

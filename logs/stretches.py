"""Stretches of a recording in which no sample lacks: what may be computed on is one of these.

A sample lacks where its row is missing, which the clock shows by a jump, and where a value of its
row is no finite number: a sensor that begins late, a cell of text, an empty one. Both are the same,
so rows without a number are taken out, and the clock then jumps over them.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
JUMP = 0.5  # periods
BESIDE = 11  # samples


def without_gaps(trace: Trace, channels: Sequence[str], name: str) -> tuple[Trace, str]:
    """Return the samples at which all these channels have a finite value, and what lacks.

    The sentence counts the samples taken out, names the channels, and is "" where there are none.
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
    """Return the samples before which the clock jumps, and stays so.

    Stamps of a busy host bunch up and catch up again: then samples were even and none is lost. So
    the median of t / T - k over the `BESIDE` samples after a jump must differ from that before.
    """
    ahead = (t - t[0]) / period - np.arange(t.size)
    asked = np.flatnonzero(np.abs(np.diff(ahead)) > JUMP) + 1
    stays = [
        abs(np.median(ahead[k : k + BESIDE]) - np.median(ahead[max(0, k - BESIDE) : k])) > JUMP
        for k in asked
    ]
    return asked[np.array(stays, dtype=np.bool_)]


def longest_stretch(trace: Trace, channels: Sequence[str], name: str) -> tuple[Trace, str]:
    """Return the longest stretch without a gap, and a sentence on what is left out, "" for none."""
    kept, note = without_gaps(trace, channels, name)
    period = float(np.median(np.diff(kept.t))) if len(kept) > 1 else 0.0
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

"""Signals in one table that have different clocks, each assigned to its own clock.

    t_cmd, torque_cmd, t_pos, position
    0.000, 0.10,       0.001, 1.04
    0.020, 0.12,       0.011, 1.05

Programs that sample several sources write such tables, and so do spreadsheets with recordings side
by side. Such a clock is a column that is named a time, rises, and differs from the others in number
of samples or in its times. Signals that share a word with a clock are timed by it, otherwise those
between it and the next clock. Two times of the same rows (of a message and of its arrival) have no
columns between them, and are left unchanged.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from zwidth.logs.guess import since_1970, unit_seen
from zwidth.logs.names import read_name, vocabulary, words_of
from zwidth.logs.source import Floats, Signal, Source
from zwidth.logs.units import find_unit

FEWEST = 10  # least samples of each clock
RISING = 0.95  # least share of steps that rise
SHARED = 0.5  # of the shorter of two clocks: least overlap
APART = 0.05  # of a period: least difference of two clocks with equally many samples
NANOSECONDS = 1e9


def with_own_clocks(source: Source) -> Source:
    """Return a source whose signals have the stamps of their clocks; without clocks, unchanged."""
    if any(signal.stamps for signal in source.signals.values()):
        return source
    clocks = {name: one for name, one in source.signals.items() if _is_clock(one)}
    if len(clocks) < 2:
        return source
    seconds = {name: _seconds(one) for name, one in clocks.items()}
    of = _clock_of(list(source.signals), source.signals, clocks)
    if set(of.values()) != set(clocks) or not _run_apart(list(seconds.values())):
        return source
    signals: dict[str, Signal] = {}
    aside: dict[str, Signal] = {}
    for name, signal in source.signals.items():
        if name not in of and name not in clocks:
            aside[name] = signal
            continue
        t = seconds[of.get(name, name)]
        rows = np.isfinite(t)
        lost = None if signal.lost is None else signal.lost[rows]
        taken = replace(signal, values=signal.values[rows], lost=lost)
        if name in clocks:
            aside[name] = taken
        else:
            stamps = {"stamp": np.rint(t[rows] * NANOSECONDS).astype(np.int64)}
            signals[name] = replace(taken, stamps=stamps)
    note = f"{', '.join(clocks)} are clocks of their own, each of the signals beside it"
    return replace(source, signals=signals, aside=aside, notes=(*source.notes, note))


def _is_clock(signal: Signal) -> bool:
    """Whether a signal is called time, beside whatever it is the time of, and rises."""
    if not (_time_words(signal.name) or read_name(signal.name).quantity == "time"):
        return False
    values = signal.floats()[signal.known]
    if values.size < FEWEST:
        return False
    steps = np.diff(values)
    return bool(np.mean(steps > 0.0) > RISING and values[-1] > values[0])


def _time_words(name: str) -> bool:
    """Whether a name begins or ends with a word for time: "t_cmd", "encoder time"."""
    table = vocabulary()["quantity"]["time"]
    spoken = [w for w in re.findall(r"[^\W\d_]+", name.lower()) if w != "column"]
    own = {*table["words"], *table["letters"]}
    return bool(spoken) and (spoken[0] in own or spoken[-1] in own)


def _seconds(clock: Signal) -> Floats:
    values, unit = clock.floats(), unit_seen(clock)
    known = values[np.isfinite(values)]
    told = find_unit(since_1970(float(known[0])) or "")
    own = unit if unit is not None and unit.si == "s" else told
    return values * (own.factor if own is not None else 1.0)


def _clock_of(
    order: Sequence[str], signals: Mapping[str, Signal], clocks: Mapping[str, Signal]
) -> dict[str, str]:
    """Return the clock of each other signal: by its length, by a word that both have, by place."""
    found: dict[str, str] = {}
    table = vocabulary()["quantity"]["time"]
    times = {*table["words"], *table["letters"]}
    words = {name: {*words_of(name)} - times for name in order}
    shared = set.intersection(*(words[name] for name in clocks))
    before = ""
    for name in order:
        if name in clocks:
            before = name
            continue
        long = [c for c in clocks if clocks[c].values.size == signals[name].values.size]
        alike = [c for c in long if (words[c] - shared) & words[name]]
        if len(alike) == 1 or len(long) == 1:
            found[name] = (alike if len(alike) == 1 else long)[0]
        elif before in long:
            found[name] = before
    return found


def _run_apart(clocks: Sequence[Floats]) -> bool:
    """Whether clocks run together over the same time, and not in the same rows."""
    known = [t[np.isfinite(t)] for t in clocks]
    first = known[0]
    apart = False
    for other in known[1:]:
        together = min(first[-1], other[-1]) - max(first[0], other[0])
        if together < SHARED * min(np.ptp(first), np.ptp(other)):
            return False
        period = float(np.median(np.diff(first)))
        apart |= first.size != other.size or bool(np.median(np.abs(first - other)) > APART * period)
    return apart

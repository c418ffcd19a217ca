"""Runs side by side in one table, as in spreadsheets, moved one below the other.

    Time, Torque, Angle, , Time, Torque, Angle
    0.00, 0.1,    0.02,  , 0.00, 0.2,    0.03

Repeated columns, each group with its own time, are runs. A run that is shorter than the longest
ends with empty cells. By names alone, columns of different runs could be combined.
"""

import re
from dataclasses import replace

import numpy as np

from zwidth.logs.guess import is_named_time
from zwidth.logs.source import Signal, Source

AGAIN = re.compile(r" \(column \d+\)$")
NUMBERED = re.compile(
    r"(?i)[ _.-]*(?:run|trial|test|try|exp|experiment|versuch|essai)[ _.-]*\d+[ _.-]*"
)


def below(source: Source) -> Source:
    """Return a table of runs side by side as one of runs in sequence, any other table unchanged."""
    signals = [s for s in source.signals.values() if s.known.any()]
    names = [NUMBERED.sub("", AGAIN.sub("", s.name)) for s in signals]
    count = len(signals)
    width = next((w for w in range(2, count // 2 + 1)
                  if count % w == 0 and names == names[:w] * (count // w)), 0)  # fmt: skip
    clocks = [k for k in range(width) if is_named_time(replace(signals[k], name=names[k]))]
    if len(clocks) != 1 or any(s.stamps for s in signals) or len(set(names)) < width:
        return source
    runs = [signals[first : first + width] for first in range(0, count, width)]
    ends = [1 + int(np.flatnonzero(run[clocks[0]].known)[-1]) for run in runs]
    if len({(s.unit, s.values.size) for run in runs for s in run[clocks[0] : clocks[0] + 1]}) > 1:
        return source
    found: dict[str, Signal] = {}
    for k, name in enumerate(names[:width]):
        parts = [(run[k], end) for run, end in zip(runs, ends, strict=True)]
        lack = np.concatenate([~s.known[:end] for s, end in parts])
        lost = lack if lack.any() else None
        values = np.concatenate([s.values[:end] for s, end in parts])
        note = next((s.note for s, _ in parts if s.note), "")
        found[name] = Signal(name, values, parts[0][0].unit, note=note, lost=lost)
    note = f"{len(runs)} runs are side by side: they are taken one after the other"
    return replace(source, signals=found, notes=(*source.notes, note))

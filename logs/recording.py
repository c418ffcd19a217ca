"""A recording as a trace (`read_recording`), or as a log with everything else (`load_log`)."""

import hashlib
import math
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from zwidth.files.protection import reading
from zwidth.logs.bag_folder import bag_files, is_bag
from zwidth.logs.conversion import Converted, convert, integrated
from zwidth.logs.mcap_reader import Log
from zwidth.logs.mended_stamps import mended
from zwidth.logs.one_axis import Stream, group, one_axis
from zwidth.logs.open_source import open_source, read_own
from zwidth.logs.opening import opened
from zwidth.logs.recording_file import (
    COVARIATE,
    JOINT,
    Clock,
    Description,
    Entry,
    load_description,
)
from zwidth.logs.source import RecordingError, Signal, Source
from zwidth.logs.timing import Stamps, common_origin
from zwidth.logs.units import GOAL, SI, TURN, find_unit
from zwidth.sim.nearest import nearest
from zwidth.sim.trace import Trace

FilePath = str | PathLike[str]
NANOSECONDS = 1_000_000_000


def load_log(path: FilePath, folder: FilePath | None = None) -> Log:
    """Return a recording as a log, with the TOML that describes it as an attachment.

    Arguments and errors: see `read_recording`. From a file of zwidth, everything is returned.
    """
    path = Path(path)
    if path.suffix.lower() != ".toml":
        return read_own(path)
    trace = read_recording(path, folder)
    with opened(path) as file:
        attachments = {path.name: file.read()}
    return Log(path, trace, None, (), {}, attachments, "", _epoch_ns(trace), ())


def _epoch_ns(trace: Trace) -> int:
    """Return the log time of t = 0: what the stamps count from, else as little as t >= 0 needs."""
    counted_from = trace.facts.get("counted_from_s")
    if isinstance(counted_from, str):
        seconds, _, fraction = counted_from.partition(".")
        return max(int(seconds) * NANOSECONDS + int(fraction), 0)
    return max(0, math.ceil(-float(trace.t.min()))) * NANOSECONDS


def read_recording(path: FilePath, folder: FilePath | None = None) -> Trace:
    """Return the recording that a TOML describes, or that zwidth itself wrote.

    path: a recording TOML (see `logs.recording_file`), or an MCAP log, CSV, Parquet or NPZ of
    zwidth. folder: where the TOML's file is looked for, by default the folder of the TOML.

    Channels are `command` and `position_m1`, `velocity_m1` ... in SI. Stamps are kept unchanged,
    even if irregular, and examined; only `resample` changes them. facts: file, sha256, format,
    signals (how each channel was converted), timing (of each stream), resampling, use, warnings.

    Raises RecordingError or another LogError, a ValueError with one sentence.
    """
    path = Path(path)
    if path.suffix.lower() != ".toml":
        return read_own(path).tick
    description = load_description(path)
    return read_described(description, path.parent if folder is None else Path(folder))


def read_described(description: Description, folder: Path) -> Trace:
    """Return the recording that a description makes of its file in a folder; raises as above."""
    path, file = description.path, folder / description.file
    reading(file, f"is what {path.name} describes")
    try:
        own = open_source(file, description.csv)
        others: dict[str, Source] = {}
        for name in dict.fromkeys(e.file for e in description.entries if e.file):
            reading(folder / name, f"is what {path.name} describes")
            others[name] = open_source(folder / name, description.csv)
        return _read(description, own, others, _sha256(file))
    except RecordingError as error:
        raise RecordingError(f"{path.name}: {error}") from None
    except MemoryError:
        raise RecordingError(f"{path.name} needs more memory than there is; split it") from None


def read_source(description: Description, source: Source, of_file: bool = False) -> Trace:
    """Return the recording that a description makes of given signals; raises as above.

    of_file: whether they are the whole content of the described file, whose hash is then noted.
    """
    try:
        return _read(description, source, {}, _sha256(source.path) if of_file else "")
    except RecordingError as error:
        raise RecordingError(f"{source.path.name}: {error}") from None


def _read(
    description: Description, source: Source, others: Mapping[str, Source], digest: str
) -> Trace:
    entries = description.entries
    signals = {entry.channel: others.get(entry.file, source)[entry.signal] for entry in entries}
    converted = {e.channel: convert(e, signals[e.channel]) for e in entries}
    rows = {e.channel: _rows(source, e.clock, signals[e.channel]) for e in entries}
    if description.resample is not None:  # else gaps would make neighbours NaN
        rows = {name: known & np.isfinite(converted[name].values) for name, known in rows.items()}
    stamps = {
        e.channel: _stamps(source, e.clock, signals[e.channel], rows[e.channel]) for e in entries
    }
    origin = common_origin(stamps)
    rotary = _rotary(description.rotary, entries, converted)
    clocks = {name: mended(s.seconds(origin)) for name, s in stamps.items()}
    streams = group(entries, {name: t for name, (t, _) in clocks.items()})
    values = {name: c.values[rows[name]] for name, c in converted.items()}
    t, values, resampling = one_axis(description.resample, streams, values)
    for entry in (e for e in entries if e.integral_time is not None):
        values[entry.channel] = integrated(
            values[entry.channel], t, float(entry.integral_time or 0)
        )
    facts: dict[str, Any] = {
        "recording": description.path.name,
        "source": description.source,
        "file": source.path.name,
        "sha256": digest,
        **({"files": {name: _sha256(one.path) for name, one in others.items()}} if others else {}),
        "format": source.kind,
        "signals": {e.channel: _signal_facts(e, converted[e.channel], signals) for e in entries},
        "timing": {s.name: {"counted": s.counted, **s.timing.facts()} for s in streams},
        "warnings": [
            *_clock_notes(source, entries, rows),
            *dict.fromkeys(note for _, note in clocks.values() if note),
            *_warnings(source, streams, converted, rotary),
        ],
    }
    if description.device:
        facts["device_changes"] = dict(description.device)
    if description.free:
        facts["free"] = dict(description.free)
    if origin:
        facts["counted_from_s"] = _decimal_seconds(origin)
    if resampling:
        facts["resampling"] = resampling
    units = {e.channel: _si(e, converted[e.channel], signals[e.channel], rotary) for e in entries}
    trace = Trace(t, values, units, "recorded", facts)
    return _used(description, trace)


def _si(entry: Entry, converted: Converted, signal: Signal, rotary: bool | None) -> str:
    """The unit of a channel, "" if unknown; for a covariate, the unit in which it is written.

    A joint is rotary or linear by itself.
    """
    if entry.quantity == COVARIATE:
        return entry.unit or signal.unit or ""
    turns = converted.rotary if entry.channel.startswith(JOINT) else rotary
    if turns is None or entry.quantity not in SI:  # the state of a drive
        return ""
    return (GOAL if converted.goal else SI[entry.quantity])[0 if turns else 1]


def _times(source: Source, clock: Clock, signal: Signal) -> Signal | None:
    """Return the signal of the file that has the stamps of another, None if none does."""
    if clock.signal is None or clock.signal in signal.stamps:
        return None
    if signal.stamps and clock.signal not in {*source.signals, *source.aside}:
        raise RecordingError(
            f"{signal.name!r} has no clock {clock.signal!r}; {nearest(clock.signal, signal.stamps)}"
        )
    times = source[clock.signal]
    if times.values.size != signal.values.size:
        raise RecordingError(
            f"{signal.name!r} has {signal.values.size} samples and its time {times.name!r} has"
            f" {times.values.size}; they must have equally many"
        )
    return times


def _rows(source: Source, clock: Clock, signal: Signal) -> NDArray[np.bool_]:
    """Return True for the samples whose time is known; others cannot be placed on the axis."""
    times = _times(source, clock, signal)
    if times is None:
        return np.ones(signal.values.size, dtype=np.bool_)
    if not times.known.any():
        raise RecordingError(
            f"time {times.name!r} has no finite number at all; give another signal, or period_s"
        )
    return times.known


def _stamps(source: Source, clock: Clock, signal: Signal, rows: NDArray[np.bool_]) -> Stamps:
    """Return the stamps of the rows that are kept: counted, from a signal, or from messages."""
    times = _times(source, clock, signal)
    if clock.signal is None:
        assert clock.period is not None
        return Stamps(np.arange(signal.values.size)[rows], clock.period, clock.shift)
    if times is None:
        return Stamps(signal.stamps[clock.signal][rows], 1e-9, clock.shift)
    raw = times.values.astype(np.uint8) if times.values.dtype.kind == "b" else times.values
    return Stamps(raw[rows], _time_unit(times, clock), clock.shift)


def _clock_notes(
    source: Source, entries: Sequence[Entry], rows: dict[str, NDArray[np.bool_]]
) -> list[str]:
    """Return sentences on rows without a time, once for each signal of times."""
    clocks = {e.clock.signal: e for e in entries if e.clock.signal in source.signals}
    notes: list[str] = []
    for name, entry in clocks.items():
        times = source.signals[str(name)]
        known = times.known
        if known.all() or rows[entry.channel].size != known.size:
            continue
        missing = int(known.size - known.sum())
        notes += [times.note] if times.note else []
        notes.append(
            f"time {times.name!r} is not finite in {missing} of {known.size} samples, first in"
            f" sample {int(np.argmin(known))}; their rows are left out as lost"
        )
    return notes


def _time_unit(times: Signal, clock: Clock) -> float:
    """Return what one stamp counts [s]; refuse one that its own header contradicts."""
    spelled = find_unit(times.unit) if times.unit else None
    if clock.unit == 1.0 and spelled is not None and spelled.si == "s" and spelled.factor != 1.0:
        raise RecordingError(
            f"time {times.name!r} is in {times.unit!r} by its own header; add time_unit ="
            f' "{times.unit}"'
        )
    return clock.unit


def _rotary(
    stated: bool | None, entries: Sequence[Entry], converted: dict[str, Converted]
) -> bool | None:
    """Return whether the device is rotary, from the TOML or from units that show it."""
    rotary = stated
    for entry in (e for e in entries if not e.channel.startswith(JOINT)):
        shown = converted[entry.channel].rotary
        if shown is not None and rotary is not None and shown != rotary:
            kind = "rotary" if rotary else "linear"
            raise RecordingError(
                f"{entry.channel} is in {entry.unit} on a {kind} device; correct the unit or"
                " rotary, or give scale"
            )
        rotary = shown if rotary is None else rotary
    return rotary


def _used(description: Description, trace: Trace) -> Trace:
    """Return the part that [use] names."""
    if description.from_s == -np.inf and description.to_s == np.inf:
        return trace
    used = trace.between(description.from_s, description.to_s)
    if len(used) == 0:
        raise RecordingError(
            f"[use] from {description.from_s:g} to {description.to_s:g} s leaves no sample of those"
            f" from {trace.t.min():.6g} to {trace.t.max():.6g} s; correct from_s and to_s"
        )
    facts = {**trace.facts, "use": {"from_s": float(used.t[0]), "to_s": float(used.t[-1])}}
    return Trace(used.t, used.channels, used.units, used.origin, facts)


def unscaled(traces: Sequence[Trace]) -> tuple[str, str]:
    """Return the units of forces and lengths if the scale of recordings is unknown.

    counts_per_rev = 2 pi or counts_per_m = 1 states that a count is treated as one SI unit. Returns
    the unit of the command ("A", "V", "counts") and of the motion ("counts") if a scale of 1 treats
    each as one SI unit; "" if the scale is known, or differs between recordings.
    """
    said = {
        ("" if t.units.get("command") in GOAL else _foreign(t, ("command",)), _foreign(t, _MOTIONS))
        for t in traces
    }
    return said.pop() if len(said) == 1 else ("", "")


_MOTIONS = tuple(f"{quantity}_m1" for quantity in ("position", "velocity"))


def _foreign(trace: Trace, channels: Sequence[str]) -> str:
    """The unit in which channels of a trace are counted as if it were SI's, "" for none."""
    signals = cast("Mapping[str, Mapping[str, Any]]", trace.facts.get("signals", {}))
    for name in channels:
        told = signals.get(name)
        if told is None:
            continue
        unit = find_unit(str(told["unit"]))
        known = told["counts_per_rev"] not in (None, TURN) or told["counts_per_m"] not in (
            None,
            1.0,
        )
        if unit is None or known or told["scale"] != 1.0:
            return ""
        return unit.si.removesuffix("/s") if unit.si in _UNSCALED else ""
    return ""


_UNSCALED = ("A", "V", "counts", "counts/s")


def _signal_facts(entry: Entry, converted: Converted, signals: dict[str, Signal]) -> dict[str, Any]:
    return {
        "signal": entry.signal,
        "unit": entry.unit or signals[entry.channel].unit,
        "scale": 1.0 if entry.scale is None else entry.scale,
        "offset": entry.offset,
        "counts_per_rev": entry.counts_per_rev,
        "counts_per_m": entry.counts_per_m,
        "shift_s": entry.clock.shift,
        "formula": converted.formula,
    }


def _warnings(
    source: Source, streams: list[Stream], converted: dict[str, Converted], rotary: bool | None
) -> list[str]:
    found = list(source.notes)
    for stream in streams:
        found += [f"{stream.name}: {fault}" for fault in stream.timing.faults()]
    for channel in converted.values():
        found += channel.warnings
    if rotary is None:
        found.append("no unit shows whether the device is rotary or linear; set rotary in the TOML")
    return found


def _decimal_seconds(origin: Any) -> str:
    whole, nanoseconds = divmod(round(origin * 1_000_000_000), 1_000_000_000)
    return f"{whole}.{nanoseconds:09d}"


def _sha256(path: Path) -> str:
    found = hashlib.sha256()
    for part in bag_files(path) if is_bag(path) else [path]:
        with opened(part) as file:
            found.update(file.read())
    return found.hexdigest()

"""A log as a table and back: how a CSV, Parquet or NPZ file of zwidth describes its columns.

`about` is JSON: schema, origin, time (the column of t), columns (column -> [channel, unit, CRC-32
of its doubles]), facts, metadata, epoch_ns and, if the format can store them, events, attachments
and the columns of the substep trace. Columns are named like the fields of zwidth's MCAP logs,
quantity_place_unit. It ends with a checksum over the JSON itself.
"""

import base64
import json
import zlib
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from zwidth.logs.events import Event
from zwidth.logs.mcap_reader import Log
from zwidth.logs.schema import field_names
from zwidth.logs.source import Floats, RecordingError, Source
from zwidth.sim.trace import Trace

SCHEMA = 1
CHECKSUM = "crc32"
SUBSTEP = "substep/"  # prefix of the columns of the substep trace
ATTACHMENT = "attachment/"  # prefix of attachments that are entries of an archive

Columns = dict[str, Floats]


def columns_of(trace: Trace, prefix: str = "") -> tuple[Columns, dict[str, Any]]:
    """Return column -> values with the time first, and their description in `about`."""
    units = {name: trace.units[name] for name in trace.channels}
    fields = field_names(units)
    time = "t_s"
    while time in fields.values():
        time = f"_{time}"
    columns = {f"{prefix}{fields[name]}": values for name, values in trace.channels.items()}
    described = {
        f"{prefix}{fields[name]}": [name, unit, checksum(trace[name])]
        for name, unit in units.items()
    }
    return {f"{prefix}{time}": trace.t, **columns}, {
        "time": f"{prefix}{time}",
        "time_checksum": checksum(trace.t),
        "columns": described,
    }


def checksum(values: Floats) -> int:
    """Return the CRC-32 of doubles; all NaN count as equal."""
    return zlib.crc32(np.where(np.isnan(values), np.nan, values).astype("<f8").tobytes())


def about_of(log: Log) -> dict[str, Any]:
    """Return the description of a log that every format stores."""
    return {
        "schema": SCHEMA,
        "origin": log.tick.origin,
        **columns_of(log.tick)[1],
        "facts": dict(log.tick.facts),
        "metadata": dict(log.metadata),
        "epoch_ns": log.epoch_ns,
    }


def as_json(about: Mapping[str, Any]) -> str:
    """Return `about` as one line of ASCII, with a checksum over itself."""
    plain = json.loads(json.dumps(about, default=str))
    return json.dumps({**plain, CHECKSUM: _sum(plain)})


def _sum(about: Mapping[str, Any]) -> int:
    return zlib.crc32(json.dumps(about, sort_keys=True).encode())


def events_of(log: Log) -> list[list[Any]]:
    """Return the events in JSON types."""
    return [list(event) for event in log.events]


def encoded(attachments: Mapping[str, bytes]) -> dict[str, str]:
    """Return attachments as text."""
    return {name: base64.b64encode(data).decode() for name, data in attachments.items()}


def trace_of(source: Source) -> Trace:
    """Return the trace in a file of zwidth; raises RecordingError."""
    return log_of(source).tick


def log_of(source: Source) -> Log:
    """Return the log in a CSV, Parquet or NPZ file of zwidth; raises RecordingError."""
    try:
        return _log(source, source.about)
    except RecordingError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise RecordingError(
            f"{source.path.name}: what zwidth wrote about its columns is damaged"
            f" ({type(error).__name__}: {error}); describe them in a recording TOML"
        ) from None


def _log(source: Source, sealed: Mapping[str, Any]) -> Log:
    about = {key: value for key, value in sealed.items() if key != CHECKSUM}
    if about["schema"] != SCHEMA:
        raise RecordingError(
            f"{source.path.name} has schema {about['schema']}; this version reads {SCHEMA}"
        )
    if sealed[CHECKSUM] != _sum(about):
        raise ValueError("its checksum is wrong")
    origin = about["origin"]
    if origin not in ("simulated", "recorded"):
        raise ValueError(f"origin is {origin!r}")
    warnings = (*source.notes, *_strangers(source, about), *_changed(source, about))
    facts = dict(about["facts"])
    if warnings:
        facts["warnings"] = [*facts.get("warnings", ()), *warnings]
    tick = _trace(source, about, origin, facts)
    substep = about.get("substep")
    return Log(
        path=source.path,
        tick=tick,
        substep=None if substep is None else _trace(source, substep, origin, facts),
        events=tuple(_event(*event) for event in about.get("events", [])),
        metadata={str(key): str(value) for key, value in about["metadata"].items()},
        attachments=_attachments(source, about.get("attachments", {})),
        library="zwidth",
        epoch_ns=int(about["epoch_ns"]),
        warnings=warnings,
    )


def _trace(
    source: Source,
    about: Mapping[str, Any],
    origin: Literal["simulated", "recorded"],
    facts: Mapping[str, object],
) -> Trace:
    channels: dict[str, Floats] = {}
    units: dict[str, str] = {}
    for column, (name, unit, _) in about["columns"].items():
        channels[str(name)] = _values(source, column)
        units[str(name)] = str(unit)
    t = _values(source, about["time"])
    if not np.isfinite(t).all():
        raise RecordingError(
            f"{source.path.name}: column {about['time']!r} is not finite in sample"
            f" {int(np.argmin(np.isfinite(t)))}; every sample needs a time"
        )
    return Trace(t, channels, units, origin, dict(facts))


def _values(source: Source, column: str) -> Floats:
    if column in source.unreadable and source.unreadable[column] == "is empty":
        return np.empty(0)
    return source[column].floats()


def _event(t: float, kind: str, place: str, value: float) -> Event:
    return Event(float(t), str(kind), str(place), float(value))


def _attachments(source: Source, described: Mapping[str, Any]) -> dict[str, bytes]:
    """Return attachments from text, or from entries of their own, whose size alone is told."""
    return {
        name: base64.b64decode(held, validate=True)
        if isinstance(held, str)
        else _entry(source, name, int(held))
        for name, held in described.items()
    }


def _entry(source: Source, name: str, size: int) -> bytes:
    data = b"" if size == 0 else source[f"{ATTACHMENT}{name}"].values.tobytes()
    if len(data) != size:
        raise RecordingError(f"{source.path.name}: attachment {name!r} has lost bytes")
    return data


def _changed(source: Source, about: Mapping[str, Any]) -> list[str]:
    """Name columns that are not as zwidth wrote them."""
    changed: list[str] = []
    for described in (about, about.get("substep")):
        if described is not None:
            sums = {described["time"]: described["time_checksum"]}
            sums |= {column: total for column, (_, _, total) in described["columns"].items()}
            changed += [c for c, total in sums.items() if checksum(_values(source, c)) != total]
    if not changed:
        return []
    return [f"not as zwidth wrote them, edited or damaged, are the columns {', '.join(changed)}"]


def _strangers(source: Source, about: Mapping[str, Any]) -> list[str]:
    """Name columns that zwidth did not write."""
    known = {f"{ATTACHMENT}{name}" for name in about.get("attachments", {})}
    for described in (about, about.get("substep")):
        if described is not None:
            known |= {described["time"], *described["columns"]}
    strange = [name for name in source.signals if name not in known]
    return (
        [f"columns that zwidth did not write are left out: {', '.join(strange)}"] if strange else []
    )

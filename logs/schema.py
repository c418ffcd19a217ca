"""Channel names, units and the protobuf schema that describes them inside the file.

A flat topic is one protobuf message of double scalars. A field is the channel's name with its unit
as a suffix (`position_m1` in rad: `position_m1_rad`); the channel record's metadata keeps the
original name and unit, so nothing is guessed when the file is read.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from google.protobuf.message import DecodeError
from mcap.records import Channel, Schema

from zwidth.logs.errors import LogBlockError

TICK, SUBSTEP, EVENTS = "/tick", "/substep", "/events"
MESSAGES = {TICK: "zwidth.Tick", SUBSTEP: "zwidth.Substep", EVENTS: "zwidth.Event"}

LIBRARY = "zwidth"  # beginning of the header of zwidth's files

# Metadata records: the run, the facts of its traces, and under ENDED why a run ended early.
RECORD, FACTS, ENDED = "zwidth", "zwidth.facts", "ended"

# log_time counts whole nanoseconds; this field is the remainder of t (see logs.clock).
TIME_RESIDUAL = "time_residual_s"
EPOCH_KEY, ORIGIN_KEY = "log.epoch_ns", "log.origin"

# Field numbers start at 2^18, where a protobuf tag takes four bytes. Between two noisy mantissas
# the compressor then meets the high byte of one value and four constant bytes of the next tag, long
# enough to match the sample before. With one-byte tags it finds nothing, and files are 13 % larger.
FIRST_FIELD = 1 << 18
LAST_FIELD = (1 << 29) - 1  # of protobuf

Origin = Literal["simulated", "recorded"]
DOUBLE, STRING = FieldDescriptorProto.TYPE_DOUBLE, FieldDescriptorProto.TYPE_STRING


@dataclass(frozen=True)
class FlatSchema:
    """The double scalars of one topic: field names and numbers, channel names, units.

    fields[0] may be the time residual, which is not a channel. All tuples have one entry per field.
    """

    topic: str
    fields: tuple[str, ...]
    numbers: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    epoch_ns: int | None
    origin: Origin


def unit_suffix(unit: str) -> str:
    """Return a unit as the end of a field name: "N m" -> "nm", "rad/s" -> "rad_s", "" -> ""."""
    spelled = unit.replace("/", "_").replace("°", "deg").replace("%", "percent")
    spelled = re.sub("[\u00b5\u03bc]", "u", spelled)  # micro sign, mu
    spelled = re.sub("[\u03a9\u2126]", "ohm", spelled)  # Omega, ohm sign
    return re.sub("[^a-z0-9_]", "", spelled.lower())


def field_names(units: Mapping[str, str]) -> dict[str, str]:
    """Return channel -> protobuf field, unique also in the camel case that JSON viewers use."""
    fields: dict[str, str] = {}
    taken = {_camel(TIME_RESIDUAL)}
    for name, unit in units.items():
        stem = re.sub("[^A-Za-z0-9_]", "_", name)
        stem = stem if re.match("[A-Za-z_]", stem) else f"_{stem}"
        suffix = unit_suffix(unit)
        field = base = f"{stem}_{suffix}" if suffix else stem
        copy = 1
        while _camel(field) in taken:
            copy += 1
            field = f"{base}_{copy}"
        taken.add(_camel(field))
        fields[name] = field
    return fields


def _camel(field: str) -> str:
    return field.replace("_", "").lower()


def flat_schema(
    topic: str, units: Mapping[str, str], epoch_ns: int, origin: Origin = "simulated"
) -> FlatSchema:
    """Lay out the fields of a topic; channels keep their order. Raises LogBlockError (a name)."""
    for text in (*units, *units.values()):
        if not text.isprintable():
            raise LogBlockError(f"channel or unit {text!r} of {topic} must be printable text")
    fields = (TIME_RESIDUAL, *field_names(units).values())
    return FlatSchema(
        topic=topic,
        fields=fields,
        numbers=tuple(range(FIRST_FIELD, FIRST_FIELD + len(fields))),
        names=("", *units),
        units=("s", *units.values()),
        epoch_ns=epoch_ns,
        origin=origin,
    )


def describe(
    message: str, fields: Mapping[str, tuple[int, "FieldDescriptorProto.Type.ValueType"]]
) -> bytes:
    """Return a self-contained FileDescriptorSet with one message, field -> (number, type)."""
    package, _, name = message.rpartition(".")
    description = DescriptorProto(name=name)
    for field, (number, kind) in fields.items():
        description.field.add(
            name=field, number=number, type=kind, label=FieldDescriptorProto.LABEL_OPTIONAL
        )
    file = FileDescriptorProto(
        name=f"{message.replace('.', '/')}.proto",
        package=package,
        message_type=[description],
        syntax="proto3",
    )
    return FileDescriptorSet(file=[file]).SerializeToString(deterministic=True)


def schema_record(flat: FlatSchema, schema_id: int) -> Schema:
    """Return the MCAP schema record of a flat topic."""
    fields = {f: (n, DOUBLE) for f, n in zip(flat.fields, flat.numbers, strict=True)}
    message = MESSAGES[flat.topic]
    return Schema(schema_id, describe(message, fields), "protobuf", message)


def channel_record(flat: FlatSchema, channel_id: int) -> Channel:
    """Return the MCAP channel record: epoch, origin, and field -> [channel name, unit]."""
    metadata = {EPOCH_KEY: str(flat.epoch_ns), ORIGIN_KEY: flat.origin}
    for field, name, unit in zip(flat.fields, flat.names, flat.units, strict=True):
        if field != TIME_RESIDUAL:
            metadata[field] = json.dumps([name, unit], ensure_ascii=False)
    return Channel(channel_id, flat.topic, "protobuf", metadata, channel_id)


def read_flat(channel: Channel, schema: Schema) -> FlatSchema | None:
    """Return the flat topic that these records describe, or None if they describe none."""
    described = _message(schema)
    if described is None or channel.message_encoding != "protobuf":
        return None
    fields = sorted(described.field, key=lambda field: field.number)
    if any(f.type != DOUBLE or f.label == FieldDescriptorProto.LABEL_REPEATED for f in fields):
        return None
    known = [_name_and_unit(channel, field.name) for field in fields]
    numbers = {field.number for field in fields if 0 < field.number <= LAST_FIELD}
    if not len(numbers) == len({name for name, _ in known}) == len(fields):
        return None
    return FlatSchema(
        topic=channel.topic,
        fields=tuple(field.name for field in fields),
        numbers=tuple(field.number for field in fields),
        names=tuple(name for name, _ in known),
        units=tuple(unit for _, unit in known),
        epoch_ns=read_epoch(channel),
        origin="simulated" if channel.metadata.get(ORIGIN_KEY) == "simulated" else "recorded",
    )


def read_epoch(channel: Channel) -> int | None:
    """Return the log time of t = 0 [ns], or None if the channel record does not state it."""
    text = channel.metadata.get(EPOCH_KEY, "")
    epoch = int(text) if re.fullmatch("[0-9]{1,19}", text) else -1
    return epoch if 0 <= epoch < 2**63 else None


def _message(schema: Schema) -> DescriptorProto | None:
    if schema.encoding != "protobuf":
        return None
    try:
        files = FileDescriptorSet.FromString(schema.data).file
    except DecodeError:
        return None
    named = {f"{file.package}.{m.name}": m for file in files for m in file.message_type}
    return named.get(schema.name)


def _name_and_unit(channel: Channel, field: str) -> tuple[str, str]:
    try:
        name, unit = json.loads(channel.metadata[field])
    except (KeyError, ValueError, TypeError, RecursionError):
        return field, ""
    return str(name), str(unit)

"""Annotations of stretches of time in a log, as viewers of MCAP files show them.

Each annotation is written twice: as a `foxglove.Event`, which has a beginning and an end, and as a
`foxglove.Log`, which has a severity and appears in a log panel. Foxglove knows both by their names;
PlotJuggler and Rerun read any protobuf, and Rerun shows a `foxglove.Log` as text.

Schemas: https://docs.foxglove.dev/docs/sdk/schemas/event and .../log
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from google.protobuf import text_format, timestamp_pb2
from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema
from mcap_protobuf.decoder import DecoderFactory

from zwidth.logs.clock import to_log_time
from zwidth.logs.container import Content, encode
from zwidth.logs.errors import LogBlockError
from zwidth.shown import fields_html

RANGES, TEXTS = "/annotations", "/annotations_text"
Severity = Literal["info", "warning", "error"]
LEVELS: dict[Severity, int] = {"info": 2, "warning": 3, "error": 4}  # of foxglove.Log

EVENT = """
    name: "foxglove/Event.proto" package: "foxglove" syntax: "proto3"
    dependency: "google/protobuf/timestamp.proto"
    message_type {
      name: "KeyValuePair"
      field { name: "key" number: 1 label: LABEL_OPTIONAL type: TYPE_STRING }
      field { name: "value" number: 2 label: LABEL_OPTIONAL type: TYPE_STRING }
    }
    message_type {
      name: "Event"
      field { name: "start_time" number: 1 label: LABEL_OPTIONAL type: TYPE_MESSAGE
              type_name: ".google.protobuf.Timestamp" }
      field { name: "end_time" number: 2 label: LABEL_OPTIONAL type: TYPE_MESSAGE
              type_name: ".google.protobuf.Timestamp" }
      field { name: "metadata" number: 3 label: LABEL_REPEATED type: TYPE_MESSAGE
              type_name: ".foxglove.KeyValuePair" }
    }
"""
LOG = """
    name: "foxglove/Log.proto" package: "foxglove" syntax: "proto3"
    dependency: "google/protobuf/timestamp.proto"
    message_type {
      name: "Log"
      field { name: "timestamp" number: 1 label: LABEL_OPTIONAL type: TYPE_MESSAGE
              type_name: ".google.protobuf.Timestamp" }
      field { name: "level" number: 2 label: LABEL_OPTIONAL type: TYPE_ENUM
              type_name: ".foxglove.Log.Level" }
      field { name: "message" number: 3 label: LABEL_OPTIONAL type: TYPE_STRING }
      field { name: "name" number: 4 label: LABEL_OPTIONAL type: TYPE_STRING }
      field { name: "file" number: 5 label: LABEL_OPTIONAL type: TYPE_STRING }
      field { name: "line" number: 6 label: LABEL_OPTIONAL type: TYPE_FIXED32 }
      enum_type {
        name: "Level"
        value { name: "UNKNOWN" number: 0 } value { name: "DEBUG" number: 1 }
        value { name: "INFO" number: 2 } value { name: "WARNING" number: 3 }
        value { name: "ERROR" number: 4 } value { name: "FATAL" number: 5 }
      }
    }
"""


class Annotation(NamedTuple):
    """An annotation of a stretch of time, from start [s] to end [s], inclusive.

    name: unique within the log. text: one sentence. details: further values by name; the names
    "name", "severity" and "text" are reserved.
    """

    start: float
    end: float
    severity: Severity
    name: str
    text: str
    details: Mapping[str, str] = MappingProxyType({})

    _repr_html_ = fields_html


class Kind(NamedTuple):
    """One way to write annotations: its topic and schema, and the fields of an annotation."""

    topic: str
    message: str
    description: str
    fields: Callable[[Annotation, int, int], dict[str, Any]]


def _event(one: Annotation, start_ns: int, end_ns: int) -> dict[str, Any]:
    told = {"name": one.name, "severity": one.severity, "text": one.text, **one.details}
    return {
        "start_time": _timestamp(start_ns),
        "end_time": _timestamp(end_ns),
        "metadata": [{"key": key, "value": value} for key, value in told.items()],
    }


def _log(one: Annotation, start_ns: int, _: int) -> dict[str, Any]:
    return {
        "timestamp": _timestamp(start_ns), "level": LEVELS[one.severity],
        "message": one.text, "name": one.name,
    }  # fmt: skip


KINDS = (
    Kind(RANGES, "foxglove.Event", EVENT, _event),
    Kind(TEXTS, "foxglove.Log", LOG, _log),
)


def annotation_records(first_id: int) -> list[tuple[Schema, Channel]]:
    """Return the schema and the channel of each topic, numbered from first_id on."""
    return [
        (
            Schema(i, _described(t.description).SerializeToString(), "protobuf", t.message),
            Channel(i, t.topic, "protobuf", {}, i),
        )
        for i, t in enumerate(KINDS, first_id)
    ]


def annotation_chunks(
    annotations: Sequence[Annotation], first_id: int, epoch_ns: int
) -> Iterator[Content]:
    """Yield the annotations as one chunk per topic, in the order of their beginnings.

    Raises LogBlockError for times that a log cannot store, an end before its beginning, an unknown
    severity, and repeated names.
    """
    ordered = sorted(annotations, key=lambda one: one.start)
    _check(ordered)
    span = np.array([[one.start, one.end] for one in ordered], dtype=np.float64)
    starts, ends = (to_log_time(span[:, i], epoch_ns)[0].tolist() for i in (0, 1))
    for (schema, channel), kind in zip(annotation_records(first_id), KINDS, strict=True):
        head, builder = encode(schema, channel), RecordBuilder()
        message, entries = _message_class(kind), list[list[int]]()
        for i, (one, start, end) in enumerate(zip(ordered, starts, ends, strict=True)):
            entries.append([start, len(head) + builder.count])
            data = message(**kind.fields(one, start, end)).SerializeToString()
            Message(channel.id, start, data, start, i).write(builder)
        yield Content(
            channel.id, head + builder.end(), starts[0], starts[-1], len(ordered),
            np.array(entries, dtype="<u8").tobytes(),
        )  # fmt: skip


def read_annotations(path: Path, epoch_ns: int) -> list[Annotation]:
    """Return the annotations of a log, in the order of their beginnings; epoch_ns: of t = 0.

    Raises OSError, and McapError for a damaged file.
    """
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [_read(one, epoch_ns) for _, _, _, one in reader.iter_decoded_messages([RANGES])]


def _read(one: Any, epoch_ns: int) -> Annotation:
    told = {pair.key: pair.value for pair in one.metadata}
    start, end = ((t.ToNanoseconds() - epoch_ns) / 1e9 for t in (one.start_time, one.end_time))
    severity, name, text = (told.pop(key, "") for key in ("severity", "name", "text"))
    return Annotation(start, end, severity, name, text, told)


def _check(annotations: Sequence[Annotation]) -> None:
    names = [one.name for one in annotations]
    for one in annotations:
        if one.severity not in get_args(Severity):
            allowed = ", ".join(get_args(Severity))
            raise LogBlockError(
                f"severity of {one.name} is {one.severity!r}; it must be one of {allowed}"
            )
        if not one.start <= one.end:
            raise LogBlockError(
                f"annotation {one.name} ends at {one.end} s, before it begins at {one.start} s"
            )
        if names.count(one.name) > 1:
            raise LogBlockError(f"two annotations are called {one.name}; give each its own name")


def _timestamp(ns: int) -> dict[str, int]:
    return {"seconds": ns // 10**9, "nanos": ns % 10**9}


@cache
def _described(description: str) -> FileDescriptorSet:
    """Return a schema that needs no other file."""
    time = FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(time)
    return FileDescriptorSet(file=[time, text_format.Parse(description, FileDescriptorProto())])


@cache
def _message_class(kind: Kind) -> Any:
    pool = DescriptorPool()
    for file in _described(kind.description).file:
        pool.AddSerializedFile(file.SerializeToString())
    return GetMessageClass(pool.FindMessageTypeByName(kind.message))

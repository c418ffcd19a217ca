"""An event at a moment: contact made, command saturated, mass stuck."""

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Message, Schema

from zwidth.logs.clock import to_log_time
from zwidth.logs.errors import LogBlockError
from zwidth.logs.schema import DOUBLE, EPOCH_KEY, EVENTS, MESSAGES, STRING, TIME_RESIDUAL, describe
from zwidth.shown import fields_html

FIELDS = {
    TIME_RESIDUAL: (1, DOUBLE),
    "kind": (2, STRING),
    "place": (3, STRING),
    "value": (4, DOUBLE),
}


class Event(NamedTuple):
    """t [s], kind ("contact", "saturated", ...), place ("m1", "command", ...), value (SI)."""

    t: float
    kind: str
    place: str
    value: float

    _repr_html_ = fields_html


class EncodedEvents(NamedTuple):
    """Message records, with the log times (n,) [ns] and offsets (n,) of each."""

    content: bytes
    log_times: list[int]
    offsets: list[int]


def event_records(channel_id: int, epoch_ns: int) -> tuple[Schema, Channel]:
    """Return the schema and channel records of the topic of events."""
    message = MESSAGES[EVENTS]
    schema = Schema(channel_id, describe(message, FIELDS), "protobuf", message)
    channel = Channel(channel_id, EVENTS, "protobuf", {EPOCH_KEY: str(epoch_ns)}, channel_id)
    return schema, channel


def encode_events(
    events: Sequence[Event], channel_id: int, sequence: int, epoch_ns: int, head: int
) -> EncodedEvents:
    """Encode events as message records that begin head bytes into their chunk.

    Raises LogBlockError for a time that a log cannot store, or text that UTF-8 cannot encode.
    """
    t = np.array([event.t for event in events], dtype=np.float64)
    log_times, residuals = to_log_time(t, epoch_ns)
    message, builder = _message_class(), RecordBuilder()
    offsets: list[int] = []
    for i, (event, log_time) in enumerate(zip(events, log_times.tolist(), strict=True)):
        offsets.append(head + builder.count)
        try:
            fields = {"kind": event.kind, "place": event.place, "value": event.value}
            data = message(**fields, **{TIME_RESIDUAL: residuals[i]}).SerializeToString()
        except (TypeError, ValueError) as error:
            raise LogBlockError(f"event {event} does not fit the log: {error}") from None
        counter = (sequence + i) % 2**32
        Message(channel_id, log_time, data, log_time, counter).write(builder)
    return EncodedEvents(builder.end(), log_times.tolist(), offsets)


@cache
def _message_class() -> Any:
    files = FileDescriptorSet.FromString(describe(MESSAGES[EVENTS], FIELDS))
    pool = DescriptorPool()
    pool.AddSerializedFile(files.file[0].SerializeToString())
    return GetMessageClass(pool.FindMessageTypeByName(MESSAGES[EVENTS]))

"""The messages of a file by channel: as arrays if their layout is known, else one by one."""

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from io import BytesIO
from typing import Any, NamedTuple

import numpy as np
from google.protobuf.message import DecodeError
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from mcap_protobuf.decoder import DecoderFactory

from zwidth.logs.layout import FRAME, MESSAGE_HEADER, Layout, Samples
from zwidth.logs.records import RecordDamaged
from zwidth.logs.schema import EVENTS, MESSAGES, TIME_RESIDUAL, FlatSchema, read_epoch, read_flat

MESSAGE_HEAD = struct.Struct("<BQHIQQ")


class EventMessage(NamedTuple):
    """One decoded message of `/events`; residual [s]: the remainder of log_time [ns]."""

    sequence: int
    log_time: int
    residual: float
    kind: str
    place: str
    value: float


@dataclass
class Stream:
    """A channel that zwidth wrote: samples of a flat topic, or messages of `/events`."""

    schema: Schema
    channel: Channel
    flat: FlatSchema | None
    layout: Layout | None
    samples: list[Samples] = field(default_factory=list[Samples])
    messages: list[EventMessage] = field(default_factory=list[EventMessage])

    @cached_property
    def decoder(self) -> Callable[[bytes], Any] | None:
        """The mcap package's own decoder of this channel's messages."""
        return DecoderFactory().decoder_for(self.channel.message_encoding, self.schema)

    @property
    def count(self) -> int:
        """Number of messages read so far."""
        return sum(part.sequence.size for part in self.samples) + len(self.messages)

    @property
    def epoch_ns(self) -> int:
        """The log time of t = 0; that of the first message if the file does not state it."""
        known = read_epoch(self.channel)
        if known is not None:
            return known
        first = [int(part.log_time[0]) for part in self.samples[:1]]
        return (first or [message.log_time for message in self.messages[:1]] or [0])[0]


@dataclass
class Streams:
    """Schemas and channels found so far, and the content of those that zwidth wrote."""

    schemas: dict[int, Schema] = field(default_factory=dict[int, Schema])
    channels: dict[int, Channel] = field(default_factory=dict[int, Channel])
    ours: dict[int, Stream] = field(default_factory=dict[int, Stream])
    described: dict[bytes, bytes] = field(default_factory=dict[bytes, bytes])

    def add_schema(self, schema: Schema) -> None:
        """Remember a schema; id 0 means none."""
        self.schemas[schema.id] = schema
        self.described.clear()

    def add_channel(self, channel: Channel) -> None:
        """Remember a channel, and open a stream for it if zwidth wrote it."""
        self.described.clear()
        schema = self.schemas.get(channel.schema_id)
        known = self.ours.get(channel.id)
        if known is not None and known.channel == channel and known.schema == schema:
            return
        if known is not None and known.count:
            raise RecordDamaged(f"a second, different description of {known.channel.topic}")
        self.channels[channel.id] = channel
        stream = None if schema is None else _open(channel, schema)
        if stream is None:
            self.ours.pop(channel.id, None)
        else:
            self.ours[channel.id] = stream

    def add_records(self, data: bytes) -> None:
        """Read all records of a chunk; if one is damaged, raise RecordDamaged and read none."""
        found: list[tuple[Stream, Samples | EventMessage]] = []
        offset = 0
        while offset < len(data):
            opcode, length = _frame(data, offset)
            following = offset + FRAME + length
            if opcode == Opcode.MESSAGE:
                stream = self._stream(data, offset, length)
                run = stream.layout.run(data, offset) if stream and stream.layout else 0
                if stream and stream.layout and run:
                    found.append((stream, stream.layout.decode(data, offset, run)))
                    following = offset + run * stream.layout.size
                elif stream:
                    found.append((stream, _decode(stream, data[offset:following])))
            else:
                self._describe(data[offset:following])
            offset = following
        for stream, part in found:
            if isinstance(part, EventMessage):
                stream.messages.append(part)
            else:
                stream.samples.append(part)

    def _stream(self, data: bytes, offset: int, length: int) -> Stream | None:
        if length < MESSAGE_HEADER:
            raise RecordDamaged("a chunk with a message that is too short")
        (channel_id,) = struct.unpack_from("<H", data, offset + FRAME)
        if channel_id not in self.channels:
            raise RecordDamaged("a chunk of messages on a channel that is not described")
        return self.ours.get(channel_id)

    def _describe(self, record: bytes) -> None:
        """Add a schema or channel, unless the very record (by opcode and id) was the last added.

        Every chunk of ours repeats its schema and channel.
        """
        kind, opcode = record[:1] + record[FRAME : FRAME + 2], record[0]
        if self.described.get(kind) == record:
            return
        before = dict(self.described)
        stream = ReadDataStream(BytesIO(record[FRAME:]))
        try:
            if opcode == Opcode.SCHEMA:
                self.add_schema(Schema.read(stream))
            elif opcode == Opcode.CHANNEL:
                self.add_channel(Channel.read(stream))
        except (McapError, struct.error, UnicodeDecodeError):
            raise RecordDamaged("a chunk with a channel that cannot be decoded") from None
        self.described = before | {kind: record}


def _frame(data: bytes, offset: int) -> tuple[int, int]:
    if len(data) - offset >= FRAME:
        opcode, length = struct.unpack_from("<BQ", data, offset)
        if offset + FRAME + length <= len(data):
            return opcode, length
    raise RecordDamaged("a chunk whose records do not fill it exactly")


def _open(channel: Channel, schema: Schema) -> Stream | None:
    if MESSAGES.get(channel.topic) != schema.name:
        return None
    flat = None if channel.topic == EVENTS else read_flat(channel, schema)
    if flat is None and channel.topic != EVENTS:
        return None
    layout = None if flat is None else Layout(channel.id, flat.numbers)
    return Stream(schema, channel, flat, layout)


def _decode(stream: Stream, record: bytes) -> Samples | EventMessage:
    """Decode one message the slow way: an event, or a sample that leaves out its zeros."""
    _, _, _, sequence, log_time, _ = MESSAGE_HEAD.unpack_from(record)
    try:
        if stream.decoder is None:
            raise RecordDamaged(f"a message of {stream.channel.topic} that is not protobuf")
        body = stream.decoder(record[MESSAGE_HEAD.size :])
        if stream.flat is None:
            residual = getattr(body, TIME_RESIDUAL)
            return EventMessage(sequence, log_time, residual, body.kind, body.place, body.value)
        values = [[getattr(body, name)] for name in stream.flat.fields]
    except (DecodeError, McapError, AttributeError, TypeError, KeyError, ValueError):
        reason = f"a message of {stream.channel.topic} that does not match its schema"
        raise RecordDamaged(reason) from None
    return Samples(
        np.array([sequence], dtype=np.uint32),
        np.array([log_time], dtype=np.uint64),
        np.array(values, dtype=np.float64).reshape(len(values), 1),
    )

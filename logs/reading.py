"""The items found in a file, sorted into traces, events, metadata and attachments."""

import json
from collections import deque
from dataclasses import dataclass, field

import numpy as np
from mcap.records import Attachment, Channel, Header, Metadata, Schema, Statistics

from zwidth.logs.clock import from_log_time
from zwidth.logs.errors import ForeignLog
from zwidth.logs.events import Event
from zwidth.logs.gaps import gaps
from zwidth.logs.layout import Samples
from zwidth.logs.records import Parsed, RecordDamaged, Records
from zwidth.logs.schema import EVENTS, FACTS, LIBRARY, RECORD, TIME_RESIDUAL
from zwidth.logs.seal import unseal
from zwidth.logs.streams import Stream, Streams
from zwidth.sim.trace import Trace


@dataclass
class Reading:
    """Everything read so far."""

    streams: Streams = field(default_factory=Streams)
    header: Header | None = None
    metadata: dict[str, str] = field(default_factory=dict[str, str])
    facts: dict[str, object] = field(default_factory=dict[str, object])
    attachments: dict[str, bytes] = field(default_factory=dict[str, bytes])
    inconsistent: list[str] = field(default_factory=list[str])
    all_checked: bool = True

    def add(self, record: Parsed) -> None:
        """Sort one record of the data section in."""
        try:
            match record:
                case Records():
                    self._add_records(record)
                case Schema():
                    self.streams.add_schema(record)
                case Channel():
                    self.streams.add_channel(record)
                case Metadata():
                    self._add_metadata(record)
                case Attachment():
                    self.attachments[record.name] = record.data
                case Header():
                    self.header = self.header or record
                case _:
                    pass
        except RecordDamaged as error:
            self.inconsistent.append(str(error))

    @property
    def by_us(self) -> bool:
        """Whether zwidth wrote the file, so that every sample and note has a checksum."""
        return self.header is not None and self.header.library.startswith(LIBRARY)

    def _add_records(self, records: Records) -> None:
        if self.by_us and not records.checked:
            raise RecordDamaged("samples without a checksum; every log of zwidth has checksums")
        self.all_checked &= records.checked
        self.streams.add_records(records.data)

    def _add_metadata(self, record: Metadata) -> None:
        entries = unseal(record.name, record.metadata, required=self.by_us)
        if entries is None:
            raise RecordDamaged(f"the metadata {record.name!r}, whose checksum is wrong")
        if record.name == FACTS:
            try:
                self.facts |= {key: json.loads(text) for key, text in entries.items()}
            except (ValueError, RecursionError):
                raise RecordDamaged("facts that cannot be decoded") from None
        elif record.name == RECORD:
            self.metadata |= entries
        else:
            self.metadata |= {f"{record.name}/{key}": text for key, text in entries.items()}

    def stream(self, topic: str) -> Stream | None:
        """Return the one stream of a topic; raises ForeignLog if runs have been merged."""
        found = [s for s in self.streams.ours.values() if s.channel.topic == topic]
        filled = [s for s in found if s.count] or found[:1]
        if len(filled) > 1:
            raise ForeignLog(
                f"the log was merged from {len(filled)} runs, each with a topic {topic}; split it"
                " into one file per run"
            )
        return filled[0] if filled else None

    def trace(self, stream: Stream, statistics: Statistics | None) -> tuple[Trace, list[str]]:
        """Return the samples of a stream as a trace, and a sentence for each gap in them.

        The stream releases its samples, so that an hour of them is not in memory twice.
        """
        assert stream.flat is not None
        epoch_ns = stream.epoch_ns
        sequence, log_time, values = _joined(stream)
        rows = dict(zip(stream.flat.fields, values, strict=True))
        residual = rows.get(TIME_RESIDUAL, np.zeros(log_time.size))
        t = from_log_time(log_time, residual, epoch_ns)
        names = dict(zip(stream.flat.fields, stream.flat.names, strict=True))
        units = dict(zip(stream.flat.names, stream.flat.units, strict=True))
        channels = {names[f]: row for f, row in rows.items() if f != TIME_RESIDUAL}
        used = {name: units[name] for name in channels}
        trace = Trace(t, channels, used, stream.flat.origin, dict(self.facts))
        return trace, gaps(stream.channel.topic, sequence, t, _expected(stream, statistics))

    def events(self, statistics: Statistics | None) -> tuple[tuple[Event, ...], list[str]]:
        """Return the events in file order, and a sentence for each gap in them."""
        stream = self.stream(EVENTS)
        if stream is None:
            return (), []
        messages = stream.messages
        log_time = np.array([m.log_time for m in messages], dtype=np.uint64)
        residual = np.array([m.residual for m in messages], dtype=np.float64)
        t = from_log_time(log_time, residual, stream.epoch_ns)
        found = tuple(
            Event(when, m.kind, m.place, m.value)
            for when, m in zip(t.tolist(), messages, strict=True)
        )
        sequence = np.array([m.sequence for m in messages], dtype=np.uint32)
        return found, gaps(EVENTS, sequence, t, _expected(stream, statistics))


def _joined(stream: Stream) -> Samples:
    parts = deque(stream.samples)
    stream.samples.clear()
    total = sum(part.sequence.size for part in parts)
    fields = 0 if stream.flat is None else len(stream.flat.fields)
    joined = Samples(
        np.empty(total, np.uint32), np.empty(total, np.uint64), np.empty((fields, total))
    )
    start = 0
    while parts:
        part = parts.popleft()
        rows = slice(start, start + part.sequence.size)
        joined.sequence[rows], joined.log_time[rows] = part.sequence, part.log_time
        joined.values[:, rows] = part.values
        start = rows.stop
    return joined


def _expected(stream: Stream, statistics: Statistics | None) -> int | None:
    if statistics is None:
        return None
    return statistics.channel_message_counts.get(stream.channel.id, 0)

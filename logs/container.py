"""An MCAP file under construction: whole records only, indexed and checksummed as they are written.

The mcap package encodes every record but the message index, which is an array here.
"""

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

from zwidth.logs.sink import Sink

# Levels 1, 3 and 6 differ by 2 % in size on simulated runs; 3 is smaller than 1 and three times as
# fast as 6 (benchmarks/bench_logs.py).
ZSTD_LEVEL = 3


class Content(NamedTuple):
    """An uncompressed chunk of one channel: its bytes, time span, and message index."""

    channel_id: int
    data: bytes | memoryview
    start_ns: int
    end_ns: int
    messages: int
    entries: bytes


def encode(*records: McapRecord) -> bytes:
    """Return records as the bytes of a file."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


@dataclass
class Container:
    """Appends records to a sink; a record that was not written whole cannot be read at all."""

    sink: Sink
    schemas: list[Schema] = field(default_factory=list[Schema])
    channels: list[Channel] = field(default_factory=list[Channel])
    chunks: list[ChunkIndex] = field(default_factory=list[ChunkIndex])
    attachments: list[AttachmentIndex] = field(default_factory=list[AttachmentIndex])
    metadata: list[MetadataIndex] = field(default_factory=list[MetadataIndex])
    counts: dict[int, int] = field(default_factory=dict[int, int])
    crc: int = 0

    def __post_init__(self) -> None:
        self.compressor = zstandard.ZstdCompressor(level=ZSTD_LEVEL)

    def _append(self, data: bytes) -> int:
        start = self.sink.append(data)
        self.crc = zlib.crc32(data, self.crc)
        return start

    def open(self, library: str, schemas: Sequence[Schema], channels: Sequence[Channel]) -> None:
        """Write magic, header and the description of every channel."""
        self.schemas.extend(schemas)
        self.channels.extend(channels)
        self.counts.update({channel.id: 0 for channel in channels})
        self._append(MCAP0_MAGIC + encode(Header("", library), *schemas, *channels))

    def add_metadata(self, name: str, entries: dict[str, str]) -> None:
        """Write one metadata record."""
        record = encode(Metadata(name, entries))
        self.metadata.append(MetadataIndex(self._append(record), len(record), name))

    def add_attachment(self, attachment: Attachment) -> None:
        """Write one file into the log."""
        record = encode(attachment)
        self.attachments.append(
            AttachmentIndex(
                offset=self._append(record),
                length=len(record),
                log_time=attachment.log_time,
                create_time=attachment.create_time,
                data_size=len(attachment.data),
                name=attachment.name,
                media_type=attachment.media_type,
            )
        )

    def add_chunk(self, content: Content) -> None:
        """Compress and write one chunk and its message index, in one piece."""
        compressed = self.compressor.compress(content.data)
        chunk = encode(
            Chunk(
                compression="zstd",
                data=compressed,
                message_start_time=content.start_ns,
                message_end_time=content.end_ns,
                uncompressed_crc=zlib.crc32(content.data),
                uncompressed_size=len(content.data),
            )
        )
        length = len(content.entries)
        index = struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + length, content.channel_id, length)
        start = self._append(chunk + index + content.entries)
        self.counts[content.channel_id] += content.messages
        self.chunks.append(
            ChunkIndex(
                chunk_start_offset=start,
                chunk_length=len(chunk),
                compression="zstd",
                compressed_size=len(compressed),
                uncompressed_size=len(content.data),
                message_start_time=content.start_ns,
                message_end_time=content.end_ns,
                message_index_offsets={content.channel_id: start + len(chunk)},
                message_index_length=len(index) + length,
            )
        )

    def finish(self) -> None:
        """Write the end of the data section, the summary with its indexes, footer and magic."""
        self._append(encode(DataEnd(self.crc)))
        start = self.sink.offset
        summary, offsets = b"", list[SummaryOffset]()
        for opcode, records in self._groups():
            group = encode(*records)
            if records:
                offsets.append(SummaryOffset(opcode, start + len(summary), len(group)))
            summary += group
        offset_start = start + len(summary)
        summary += encode(*offsets)
        unchecked = encode(Footer(start, offset_start, 0))
        crc = zlib.crc32(unchecked[:-4], zlib.crc32(summary))
        self.sink.append(summary + encode(Footer(start, offset_start, crc)) + MCAP0_MAGIC)

    def _groups(self) -> list[tuple[Opcode, Sequence[McapRecord]]]:
        return [
            (Opcode.SCHEMA, self.schemas),
            (Opcode.CHANNEL, self.channels),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self.chunks),
            (Opcode.ATTACHMENT_INDEX, self.attachments),
            (Opcode.METADATA_INDEX, self.metadata),
        ]

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self.attachments),
            channel_count=len(self.channels),
            channel_message_counts={i: count for i, count in self.counts.items() if count},
            chunk_count=len(self.chunks),
            message_count=sum(self.counts.values()),
            message_start_time=min((c.message_start_time for c in self.chunks), default=0),
            message_end_time=max((c.message_end_time for c in self.chunks), default=0),
            metadata_count=len(self.metadata),
            schema_count=len(self.schemas),
        )

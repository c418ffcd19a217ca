"""The index at the end of an MCAP file: trusted only if its checksum is right."""

import os
import struct
import zlib
from dataclasses import dataclass
from io import BytesIO
from typing import BinaryIO

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, ChunkIndex, MetadataIndex, Schema, Statistics
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from zwidth.logs.records import MEBIBYTE

FOOTER = struct.Struct("<BQQQI")  # opcode, length, summary start, offset start, crc
TAIL = FOOTER.size + len(MCAP0_MAGIC)
LARGEST_SUMMARY = 1024 * MEBIBYTE


@dataclass(frozen=True)
class Summary:
    """Offset of the summary, content of the file, and offsets of its records (ascending)."""

    start: int
    schemas: tuple[Schema, ...]
    channels: tuple[Channel, ...]
    landmarks: tuple[int, ...]
    statistics: Statistics | None


def read_summary(file: BinaryIO) -> Summary | None:
    """Return the summary, or None if there is no reliable one."""
    size = file.seek(0, os.SEEK_END)
    if size < len(MCAP0_MAGIC) + TAIL:
        return None
    file.seek(size - TAIL)
    tail = file.read(TAIL)
    opcode, length, start, _, crc = FOOTER.unpack_from(tail)
    placed = len(MCAP0_MAGIC) <= start <= size - TAIL and size - start <= LARGEST_SUMMARY
    if opcode != Opcode.FOOTER or length != 20 or not placed or tail[-8:] != MCAP0_MAGIC:
        return None
    file.seek(start)
    data = file.read(size - start)
    if crc not in (0, zlib.crc32(data[: -len(MCAP0_MAGIC) - 4])):
        return None
    return _collect(start, data)


def _collect(start: int, data: bytes) -> Summary | None:
    schemas, channels = list[Schema](), list[Channel]()
    landmarks, statistics = list[int](), None
    try:
        for record in StreamReader(BytesIO(data), skip_magic=True).records:
            if isinstance(record, Schema):
                schemas.append(record)
            elif isinstance(record, Channel):
                channels.append(record)
            elif isinstance(record, Statistics):
                statistics = record
            elif isinstance(record, ChunkIndex):
                landmarks.append(record.chunk_start_offset)
            elif isinstance(record, AttachmentIndex | MetadataIndex):
                landmarks.append(record.offset)
    except (McapError, struct.error, UnicodeDecodeError, MemoryError):
        return None
    return Summary(start, tuple(schemas), tuple(channels), tuple(sorted(landmarks)), statistics)

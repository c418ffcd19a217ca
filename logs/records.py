"""The content of one MCAP record, with sizes, checksums and fields checked.

The mcap package decodes all records but two: a chunk, which is decompressed within bounds here, and
the message index, of which only the layout is checked, since this reader does not need it.
"""

import struct
import zlib
from io import BytesIO
from typing import NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, DataEnd, Header, Metadata, Schema

MEBIBYTE = 1 << 20
LARGEST_CHUNK = 64 * MEBIBYTE  # uncompressed; other tools write 1 to 10 MiB, zwidth 256 KiB
LARGEST: dict[int, int] = {Opcode.CHUNK: 2 * LARGEST_CHUNK, Opcode.ATTACHMENT: 1024 * MEBIBYTE}
LARGEST_OTHER = 64 * MEBIBYTE
CHUNK_HEADER = struct.Struct("<QQQII")  # start, end, size, crc, length of the compression's name


class RecordDamaged(Exception):
    """The content of a record is not what its checksum or its own lengths say."""


class Records(NamedTuple):
    """The uncompressed content of a chunk, or one message outside any chunk.

    checked: whether its own checksum confirmed it.
    """

    data: bytes
    checked: bool


Parsed = Header | Schema | Channel | Attachment | Metadata | DataEnd | Records | None


def plausible(opcode: int, length: int) -> bool:
    """Return whether a record of the data section may have this opcode and length [bytes]."""
    known = Opcode.HEADER <= opcode <= Opcode.DATA_END or opcode >= 0x80
    if opcode == Opcode.DATA_END:
        return length == 4
    return known and opcode not in SUMMARY_ONLY and length <= LARGEST.get(opcode, LARGEST_OTHER)


SUMMARY_ONLY = frozenset(
    {
        Opcode.FOOTER,
        Opcode.CHUNK_INDEX,
        Opcode.ATTACHMENT_INDEX,
        Opcode.STATISTICS,
        Opcode.METADATA_INDEX,
        Opcode.SUMMARY_OFFSET,
    }
)
DECODED = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.ATTACHMENT: Attachment,
    Opcode.METADATA: Metadata,
    Opcode.DATA_END: DataEnd,
}


def parse(opcode: int, content: bytes) -> Parsed:
    """Return the record, None if it contains nothing to read; raises RecordDamaged."""
    if opcode == Opcode.CHUNK:
        return _uncompressed(content)
    if opcode == Opcode.MESSAGE:
        return Records(struct.pack("<BQ", opcode, len(content)) + content, checked=False)
    if opcode == Opcode.MESSAGE_INDEX:
        if len(content) < 6 or struct.unpack_from("<I", content, 2)[0] != len(content) - 6:
            raise RecordDamaged("a message index of the wrong size")
        return None
    kind = DECODED.get(Opcode(opcode)) if opcode < 0x80 else None
    if kind is None:
        return None
    stream = ReadDataStream(BytesIO(content))
    try:
        record = kind.read(stream)
    except (McapError, struct.error, UnicodeDecodeError, OverflowError) as error:
        raise RecordDamaged(f"a {kind.__name__.lower()} that cannot be decoded") from error
    return _checked(record, content)


def _checked(record: Parsed, content: bytes) -> Parsed:
    if isinstance(record, Attachment):
        stored = int.from_bytes(content[-4:], "little")
        if stored not in (0, zlib.crc32(content[:-4])):
            raise RecordDamaged(f"the attachment {record.name!r}, whose checksum is wrong")
    return record


def _uncompressed(content: bytes) -> Records:
    try:
        _, _, size, crc, name_length = CHUNK_HEADER.unpack_from(content)
        head = CHUNK_HEADER.size + name_length + 8
        (length,) = struct.unpack_from("<Q", content, head - 8)
    except struct.error:
        raise RecordDamaged("a chunk with a damaged header") from None
    if head + length != len(content) or size > LARGEST_CHUNK:
        raise RecordDamaged("a chunk with a damaged header")
    compression = content[CHUNK_HEADER.size : head - 8]
    data = decompress(compression, memoryview(content)[head:], size)
    if len(data) != size or crc not in (0, zlib.crc32(data)):
        raise RecordDamaged("a chunk whose checksum is wrong")
    return Records(data, checked=crc != 0)


def decompress(compression: bytes, data: memoryview, size: int) -> bytes:
    """Return at most size + 1 bytes of the uncompressed data; raises RecordDamaged."""
    try:
        if compression == b"":
            return bytes(data)
        if compression == b"zstd":
            # No more than this size is allocated, whatever the frame states.
            decompressor = zstandard.ZstdDecompressor(max_window_size=LARGEST_CHUNK)
            if zstandard.frame_content_size(data) == size:
                return decompressor.decompress(data)
            with decompressor.stream_reader(data) as stream:
                return stream.read(size + 1)
        if compression == b"lz4":
            return lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise RecordDamaged("a chunk that cannot be decompressed") from error
    raise RecordDamaged(f"a chunk with compression {compression[:20]!r}, which MCAP does not have")

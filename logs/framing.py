"""Walks from one MCAP record to the next, also across damage.

A record is an opcode, a length and its content. Where that chain is broken, reading resumes at the
next place where a record is known to start: from the file's own summary, or at the next bytes that
look like the head of a zstd chunk (its checksum then decides).
"""

import struct
import zlib
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Attachment, DataEnd

from zwidth.logs.layout import FRAME
from zwidth.logs.records import (
    CHUNK_HEADER,
    MEBIBYTE,
    Parsed,
    RecordDamaged,
    Records,
    parse,
    plausible,
)
from zwidth.logs.unpacked import refuse_bomb

MAGIC_SIZE = 8
SIGNATURE = struct.pack("<I4s", 4, b"zstd")  # the name of the compression, in a chunk's header
BEFORE_SIGNATURE = FRAME + CHUNK_HEADER.size - 4
CHUNK_OVERHEAD = CHUNK_HEADER.size + 4 + 8

# Reading stops after this many times the file's size, so that crafted damage cannot take for ever;
# each place that is examined counts as LOOK bytes.
MOST_WASTED = 8
LOOK = 512
ALWAYS_UNPACKED = 32 * MEBIBYTE  # allowed for any file; decoded messages take 20 times as much


class Damage(NamedTuple):
    """Bytes start to stop - 1 were skipped; reason names what was there."""

    start: int
    stop: int
    reason: str


@dataclass
class Walk:
    """One pass over the data section of a file; after the iteration, its fields say what was found.

    stop: the latest possible end of the data section. landmarks: offsets at which records are known
    to start, ascending.
    """

    file: BinaryIO
    stop: int
    landmarks: Sequence[int] = ()
    damages: list[Damage] = field(default_factory=list[Damage])
    cut_at: int | None = None
    ended: bool = False
    checksum_holds: bool = True
    wasted: int = 0
    unpacked: int = 0

    def __iter__(self) -> Iterator[Parsed]:
        self.file.seek(0)
        crc = zlib.crc32(self.file.read(MAGIC_SIZE))
        offset = previous = MAGIC_SIZE
        while offset < self.stop and not self.ended:
            if self._exhausted:
                self.damages.append(Damage(offset, self.stop, "too much damage before"))
                break
            frame = self._frame(offset)
            if frame is None:
                # The previous record may have stated a wrong length.
                offset = previous = self._resume(previous, offset, "no record that can be read")
                continue
            head, opcode, length = frame
            content = self.file.read(length)
            following = offset + FRAME + length
            try:
                record = parse(opcode, content)
            except RecordDamaged as error:
                self.wasted += length
                whole = following == self.stop or self._frame(following) is not None
                offset = previous = self._resume(
                    offset, offset, str(error), following if whole else None
                )
                continue
            if isinstance(record, Records):
                self._refuse_bomb(len(record.data))
            if isinstance(record, DataEnd):
                self.ended = True
                self.checksum_holds = record.data_section_crc in (0, crc)
            crc = zlib.crc32(content, zlib.crc32(head, crc))
            # A chunk or attachment has been confirmed by its checksum, and its length with it.
            previous = following if isinstance(record, Records | Attachment) else offset
            offset = following
            yield record

    def _refuse_bomb(self, size: int) -> None:
        """Account for a chunk before its messages are decoded; raises RecordingError if too many.

        The size in its header is confirmed by then, and at most LARGEST_CHUNK.
        """
        path = Path(str(getattr(self.file, "name", "the file")))
        self.unpacked += size
        refuse_bomb(path, self.unpacked, self.stop, always=ALWAYS_UNPACKED)

    @property
    def _exhausted(self) -> bool:
        return self.wasted > MOST_WASTED * self.stop + MEBIBYTE

    def _frame(self, offset: int) -> tuple[bytes, int, int] | None:
        """Return (its bytes, opcode, length) where a record can start at offset and fits."""
        self.file.seek(offset)
        head = self.file.read(FRAME)
        if len(head) < FRAME:
            return None
        opcode, length = struct.unpack("<BQ", head)
        fits = offset + FRAME + length <= self.stop
        return (head, opcode, length) if fits and plausible(opcode, length) else None

    def _resume(self, since: int, offset: int, reason: str, following: int | None = None) -> int:
        """Note the damage met at offset; return where to go on.

        That is where the record at offset would end, following, if it is whole: unless another one
        starts before, after since, because a length may be what is damaged.
        """
        resumed = self._next_record(since + 1, self.stop if following is None else following)
        resumed = following if resumed is None else resumed
        if resumed is None and self._cut_off(offset):
            self.cut_at = offset
        else:
            start = offset if resumed is None or resumed > offset else since
            self.damages.append(Damage(start, resumed or self.stop, reason))
        return resumed or self.stop

    def _cut_off(self, offset: int) -> bool:
        """Return whether a record that starts at offset is cut off by the end of the file."""
        self.file.seek(offset)
        head = self.file.read(FRAME)
        opcode, length = struct.unpack("<BQ", head.ljust(FRAME, b"\0"))
        known = Opcode.HEADER <= opcode <= Opcode.DATA_END
        return known and (len(head) < FRAME or plausible(opcode, length))

    def _next_record(self, offset: int, stop: int) -> int | None:
        """Return the first place, offset to stop - 1, where a record is known to start."""
        nearby = self.landmarks[bisect_left(self.landmarks, offset) :]
        landmark = next((known for known in nearby if known >= stop or self._frame(known)), stop)
        chunk = self._next_chunk(offset, min(landmark, stop))
        return chunk if chunk is not None else landmark if landmark < stop else None

    def _next_chunk(self, offset: int, stop: int) -> int | None:
        position, tail = offset, b""
        while position < stop and not self._exhausted:
            self.file.seek(position)
            block = tail + self.file.read(min(MEBIBYTE, stop - position))
            first = position - len(tail)
            hit = block.find(SIGNATURE)
            while hit >= 0:
                start = first + hit - BEFORE_SIGNATURE
                if start >= offset and self._is_chunk(start):
                    return start
                self.wasted += LOOK
                hit = block.find(SIGNATURE, hit + 1)
            position = first + len(block)
            tail = block[-len(SIGNATURE) + 1 :]
        return None

    def _is_chunk(self, start: int) -> bool:
        frame = self._frame(start)
        if frame is None or frame[1] != Opcode.CHUNK:
            return False
        self.file.seek(start + FRAME + CHUNK_OVERHEAD - 8)
        (length,) = struct.unpack("<Q", self.file.read(8).ljust(8, b"\0"))
        return frame[2] == CHUNK_OVERHEAD + length

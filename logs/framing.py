"""From one MCAP record to the next, also through damage.

A record is an opcode, a length and its content. Where that chain is broken, reading resumes at the
next place where a record is known to start: from the file's own summary, or at the next thing that
looks like the head of a zstd chunk (its checksum then decides whether it is one).
"""

import struct
import zlib
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import BinaryIO, NamedTuple

from mcap.opcode import Opcode
from mcap.records import DataEnd

from logs.layout import FRAME
from logs.records import CHUNK_HEADER, MEBIBYTE, Parsed, RecordDamaged, parse, plausible

MAGIC_SIZE = 8
SIGNATURE = struct.pack("<I4s", 4, b"zstd")  # the name of the compression, in a chunk's header
BEFORE_SIGNATURE = FRAME + CHUNK_HEADER.size - 4
CHUNK_OVERHEAD = CHUNK_HEADER.size + 4 + 8


class Damage(NamedTuple):
    """Bytes start to stop - 1 were skipped; reason names what was there."""

    start: int
    stop: int
    reason: str


@dataclass
class Walk:
    """One pass over the data section of a file; iterate, then look at what was met.

    stop: where the data section ends at the latest. landmarks: offsets at which records are known
    to start, ascending.
    """

    file: BinaryIO
    stop: int
    landmarks: Sequence[int] = ()
    damages: list[Damage] = field(default_factory=list[Damage])
    cut_at: int | None = None
    ended: bool = False
    checksum_holds: bool = True

    def __iter__(self) -> Iterator[Parsed]:
        self.file.seek(0)
        crc = zlib.crc32(self.file.read(MAGIC_SIZE))
        offset = MAGIC_SIZE
        while offset < self.stop and not self.ended:
            frame = self._frame(offset)
            if frame is None:
                offset = self._resume(offset, "no record that can be read")
                continue
            head, opcode, length = frame
            content = self.file.read(length)
            following = offset + FRAME + length
            try:
                record = parse(opcode, content)
            except RecordDamaged as error:
                whole = following == self.stop or self._frame(following) is not None
                offset = self._resume(offset, str(error), following if whole else None)
                continue
            if isinstance(record, DataEnd):
                self.ended = True
                self.checksum_holds = record.data_section_crc in (0, crc)
            crc = zlib.crc32(content, zlib.crc32(head, crc))
            offset = following
            yield record

    def _frame(self, offset: int) -> tuple[bytes, int, int] | None:
        """Return (its bytes, opcode, length) where a record can start at offset and fits."""
        self.file.seek(offset)
        head = self.file.read(FRAME)
        if len(head) < FRAME:
            return None
        opcode, length = struct.unpack("<BQ", head)
        fits = offset + FRAME + length <= self.stop
        return (head, opcode, length) if fits and plausible(opcode, length) else None

    def _resume(self, offset: int, reason: str, following: int | None = None) -> int:
        """Note the damage from offset on; return where to go on: following, or the next record."""
        resumed = self._next_record(offset + 1) if following is None else following
        if resumed is None and self._cut_off(offset):
            self.cut_at = offset
        else:
            self.damages.append(Damage(offset, resumed or self.stop, reason))
        return resumed or self.stop

    def _cut_off(self, offset: int) -> bool:
        """Return True where a record starts at offset that the end of the file cuts short."""
        self.file.seek(offset)
        head = self.file.read(FRAME)
        opcode, length = struct.unpack("<BQ", head.ljust(FRAME, b"\0"))
        known = Opcode.HEADER <= opcode <= Opcode.DATA_END
        return known and (len(head) < FRAME or plausible(opcode, length))

    def _next_record(self, offset: int) -> int | None:
        """Return the first place from offset on where a record starts, as far as can be known."""
        landmark = self._next_landmark(offset)
        chunk = self._next_chunk(offset, self.stop if landmark is None else landmark)
        return landmark if chunk is None else chunk

    def _next_landmark(self, offset: int) -> int | None:
        for known in self.landmarks[bisect_left(self.landmarks, offset) :]:
            if self._frame(known) is not None:
                return known
        return None

    def _next_chunk(self, offset: int, stop: int) -> int | None:
        position, tail = offset, b""
        while position < stop:
            self.file.seek(position)
            block = tail + self.file.read(min(MEBIBYTE, stop - position))
            first = position - len(tail)
            hit = block.find(SIGNATURE)
            while hit >= 0:
                start = first + hit - BEFORE_SIGNATURE
                if start >= offset and self._is_chunk(start):
                    return start
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

"""The byte layout of a message record in which every field is present, as a numpy record.

    opcode length channel sequence log_time publish_time  tag_1 double_1  tag_2 double_2 ...

Protobuf may omit a double of 0.0; both forms decode to the same value. Here it is always written,
so all records have the same length, and blocks of samples are encoded and decoded by columns.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

Floats = NDArray[np.float64]
FRAME = 9  # opcode and length, before the content of every record
MESSAGE_HEADER = 22  # channel id, sequence, log time, publish time
FIXED64 = 1  # protobuf wire type of a double
PROBE = 16


class Samples(NamedTuple):
    """Decoded messages of one channel: n of them, in file order.

    sequence (n,) uint32, log_time (n,) uint64 [ns], values (fields, n).
    """

    sequence: NDArray[np.uint32]
    log_time: NDArray[np.uint64]
    values: Floats


class Layout:
    """Encode and decode the message records of one channel with these field numbers."""

    def __init__(self, channel_id: int, numbers: Sequence[int]) -> None:
        self.channel_id = channel_id
        self.tags = [_varint(number << 3 | FIXED64) for number in numbers]
        parts: list[tuple[str, str]] = [
            ("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"),
            ("log_time", "<u8"), ("publish_time", "<u8"),
        ]  # fmt: skip
        for i, tag in enumerate(self.tags):
            parts += [(f"tag{i}", _comparable(len(tag))), (f"value{i}", "<f8")]
        self.dtype = np.dtype(parts)
        self.size = self.dtype.itemsize
        record = np.zeros(1, self.dtype)
        record["opcode"], record["channel"] = Opcode.MESSAGE, channel_id
        record["length"] = self.size - FRAME
        for i, tag in enumerate(self.tags):
            record[f"tag{i}"] = np.frombuffer(tag, _comparable(len(tag)))
        self.template = record
        self.constants = ["opcode", "length", "channel", *(f"tag{i}" for i in range(len(numbers)))]

    def run(self, data: bytes, offset: int) -> int:
        """Return the number of consecutive records of exactly this layout from an offset."""
        most = (len(data) - offset) // self.size
        done, step = 0, PROBE
        while done < most:
            rows = self.rows(data, offset + done * self.size, min(step, most - done))
            fits = np.ones(rows.size, dtype=np.bool_)
            for name in self.constants:
                fits &= rows[name] == self.template[name]
            if not fits.all():
                return done + int(np.argmin(fits))
            done, step = done + rows.size, step * 16
        return done

    def rows(self, data: bytes, offset: int, count: int) -> NDArray[np.void]:
        """View `count` records from an offset, without a copy."""
        return np.ndarray(count, self.dtype, buffer=data, offset=offset)

    def decode(self, data: bytes, offset: int, count: int) -> Samples:
        """Copy `count` records, whose layout `run` has confirmed, into columns."""
        rows = self.rows(data, offset, count)
        values = np.empty((len(self.tags), count))
        for i in range(len(self.tags)):
            values[i] = rows[f"value{i}"]
        return Samples(rows["sequence"].copy(), rows["log_time"].copy(), values)


class Encoder:
    """Encodes blocks of samples as the uncompressed content of a chunk and its message index.

    preamble: records (schema, channel) that open every chunk, so that each can be read alone.
    """

    def __init__(self, layout: Layout, preamble: bytes, most: int) -> None:
        self.layout = layout
        self.head = len(preamble)
        self.buffer = bytearray(preamble) + bytearray(layout.template.tobytes() * most)
        self.records = np.ndarray(most, layout.dtype, buffer=self.buffer, offset=self.head)
        self.index = np.zeros((most, 2), dtype="<u8")
        self.index[:, 1] = self.head + layout.size * np.arange(most)

    def encode(
        self, sequence: int, log_time: NDArray[np.uint64], columns: Sequence[Floats]
    ) -> tuple[memoryview, bytes]:
        """Return (chunk content, entries of its message index), both valid until the next call."""
        count = log_time.size
        rows = self.records[:count]
        rows["sequence"] = np.arange(sequence, sequence + count).astype(np.uint32)
        rows["log_time"] = rows["publish_time"] = log_time
        for i, column in enumerate(columns):
            rows[f"value{i}"] = column
        self.index[:count, 0] = log_time
        content = memoryview(self.buffer)[: self.head + count * self.layout.size]
        return content, self.index[:count].tobytes()


def _comparable(width: int) -> str:
    return {1: "<u1", 2: "<u2", 4: "<u4"}.get(width, f"V{width}")


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])

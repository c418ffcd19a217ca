"""Blocks of samples of one topic, checked and laid out as the chunks of a log."""

from collections.abc import Iterator, Mapping

import numpy as np
from mcap.records import Channel, Schema

from zwidth.logs.clock import to_log_time
from zwidth.logs.container import Content, encode
from zwidth.logs.errors import LogBlockError
from zwidth.logs.layout import Encoder, Floats, Layout
from zwidth.logs.schema import FlatSchema

CHUNK_BYTES = 256 * 1024  # largest uncompressed size: about a second of a run


class Topic:
    """A flat topic of a log being written; counts the samples written into chunks."""

    def __init__(self, flat: FlatSchema, epoch_ns: int, schema: Schema, channel: Channel) -> None:
        layout = Layout(channel.id, flat.numbers)
        self.flat = flat
        self.epoch_ns = epoch_ns
        self.most = max(1, CHUNK_BYTES // layout.size)
        self.channel_id = channel.id
        self.encoder = Encoder(layout, encode(schema, channel), self.most)
        self.written = 0

    def chunks(self, t: Floats, channels: Mapping[str, Floats]) -> Iterator[Content]:
        """Yield the block as chunks; each is valid until the next one is requested.

        Raises LogBlockError if names, shapes or times do not fit, before the first chunk.
        """
        columns = self._columns(t, channels)
        log_time, columns[0] = to_log_time(columns[0], self.epoch_ns)
        for first in range(0, log_time.size, self.most):
            part = slice(first, first + self.most)
            times = log_time[part]
            data, entries = self.encoder.encode(self.written, times, [c[part] for c in columns])
            span = int(times.min()), int(times.max())
            yield Content(self.channel_id, data, *span, times.size, entries)
            self.written += times.size

    def _columns(self, t: Floats, channels: Mapping[str, Floats]) -> list[Floats]:
        """Return [t, one array a channel], checked against what the topic was opened with."""
        names = self.flat.names[1:]
        wrong = sorted(set(channels) ^ set(names))
        if wrong:
            raise LogBlockError(
                f"a block for {self.flat.topic} and the channels of this topic differ in"
                f" {', '.join(wrong)}; the block must have exactly {', '.join(names) or 'none'}"
            )
        arrays = [t, *(channels[name] for name in names)]
        columns = [np.asarray(array, dtype=np.float64) for array in arrays]
        for name, column in zip(("t", *names), columns, strict=True):
            if column.ndim != 1 or column.size != columns[0].size:
                raise LogBlockError(
                    f"{name} has shape {column.shape} in a block of {columns[0].size} samples for"
                    f" {self.flat.topic}; give every channel one value for each time"
                )
        return columns

"""The array path against the mcap package's own reader and writer, which know nothing of it."""

import struct
import zlib
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from log_examples import ATTACHMENTS, EPOCH, EVENTS, METADATA, UNITS, assert_same, bits, example
from log_examples import write_blocks as write
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.reader import make_reader
from mcap.records import Chunk, Message, MessageIndex
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.summary import Summary
from mcap.writer import CompressionType, Writer
from mcap_protobuf.decoder import DecoderFactory

from zwidth.logs.clock import to_log_time
from zwidth.logs.layout import Layout
from zwidth.logs.mcap_reader import read_log
from zwidth.logs.schema import TICK, TIME_RESIDUAL, channel_record, flat_schema, schema_record
from zwidth.sim.trace import Trace

SAMPLES, BLOCK = 2500, 1000


@pytest.fixture(scope="module")
def run() -> Trace:
    return example(SAMPLES)


@pytest.fixture(scope="module")
def path(run: Trace, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs") / "run.mcap"
    write(path, run, BLOCK)
    return path


def summary_of(path: Path) -> Summary:
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    return summary


def test_official_reader_decodes_every_bit(path: Path, run: Trace) -> None:
    """Breaks if a tag, a field's order or a byte order in the array path is wrong."""
    rows, log_times = list[list[float]](), list[int]()
    fields = list[str]()
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, tick in reader.iter_decoded_messages(topics=[TICK]):
            assert channel.topic == TICK
            assert message.sequence == len(rows)
            assert message.publish_time == message.log_time
            log_times.append(message.log_time)
            fields = [field.name for field in tick.DESCRIPTOR.fields]
            rows.append([getattr(tick, field) for field in fields])
    decoded = np.array(rows).T
    assert fields == [
        "time_residual_s", "position_m1_rad", "velocity_m1_rad_s", "command_nm", "contact",
    ]  # fmt: skip
    assert log_times == (EPOCH + np.arange(SAMPLES) * 1_000_000).tolist()
    assert bits((np.array(log_times) - EPOCH) / 1e9 + decoded[0]) == bits(run.t)
    for row, values in zip(decoded[1:], run.channels.values(), strict=True):
        assert bits(row) == bits(values)


def test_official_reader_decodes_events(path: Path) -> None:
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        found = [
            (round((message.log_time - EPOCH) / 1e9, 9), e.kind, e.place, e.value)
            for _, _, message, e in reader.iter_decoded_messages(topics=["/events"])
        ]
    assert found == [tuple(event) for event in EVENTS]


def test_official_reader_confirms_every_checksum(path: Path) -> None:
    """Chunks and the data section; breaks if the data crc leaves out the magic or a record."""
    with path.open("rb") as file:
        assert sum(1 for _ in StreamReader(file, validate_crcs=True).records) > SAMPLES


def test_summary_checksum_and_footer(path: Path) -> None:
    data = path.read_bytes()
    assert data.endswith(b"\x89MCAP0\r\n")
    start, offsets, crc = struct.unpack_from("<QQI", data, len(data) - 28)
    assert crc == zlib.crc32(data[start : len(data) - 12])
    assert data[start] == 0x03
    assert data[offsets] == 0x0E


def test_statistics(path: Path) -> None:
    statistics = summary_of(path).statistics
    assert statistics is not None
    assert statistics.channel_message_counts == {1: SAMPLES, 2: len(EVENTS)}
    assert statistics.message_count == SAMPLES + len(EVENTS)
    assert (statistics.schema_count, statistics.channel_count) == (2, 2)
    assert (statistics.attachment_count, statistics.metadata_count) == (2, 3)
    assert statistics.chunk_count == len(summary_of(path).chunk_indexes)
    assert statistics.message_start_time == EPOCH
    assert statistics.message_end_time == EPOCH + (SAMPLES - 1) * 1_000_000


def test_indexes_lead_to_their_records(path: Path) -> None:
    """Breaks if an offset or length in the summary or in a message index is off by one."""
    data, seen = path.read_bytes(), 0
    for index in summary_of(path).chunk_indexes:
        stream = ReadDataStream(BytesIO(data[index.chunk_start_offset :]))
        assert stream.read1() == 0x06
        assert stream.read8() + 9 == index.chunk_length
        chunk = Chunk.read(stream)
        assert len(chunk.data) == index.compressed_size
        assert chunk.uncompressed_size == index.uncompressed_size
        messages = [r for r in breakup_chunk(chunk, validate_crc=True) if isinstance(r, Message)]
        assert chunk.message_start_time == index.message_start_time == messages[0].log_time
        assert chunk.message_end_time == index.message_end_time == messages[-1].log_time
        ((channel_id, offset),) = index.message_index_offsets.items()
        stream = ReadDataStream(BytesIO(data[offset:]))
        assert stream.read1() == 0x07
        assert stream.read8() + 9 == index.message_index_length
        entries = MessageIndex.read(stream)
        assert entries.channel_id == channel_id
        assert [time for time, _ in entries.records] == [m.log_time for m in messages]
        content = _uncompressed(chunk)
        for (_, at), message in zip(entries.records, messages, strict=True):
            assert content.startswith(_record(message), at)
        seen += len(messages)
    assert seen == SAMPLES + len(EVENTS)


def _uncompressed(chunk: Chunk) -> bytes:
    builder = RecordBuilder()
    for record in breakup_chunk(chunk):
        record.write(builder)
    return builder.end()


def _record(message: Message) -> bytes:
    builder = RecordBuilder()
    message.write(builder)
    return builder.end()


def test_attachments_and_metadata_by_the_official_index(path: Path) -> None:
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert {a.name: a.data for a in reader.iter_attachments()} == ATTACHMENTS
        first, facts, last = reader.iter_metadata()
    assert first.metadata.items() >= METADATA.items()
    assert facts.metadata["substeps"] == "4"
    assert last.metadata["verdict"] == "decays"


def library_log(
    path: Path, run: Trace, compression: CompressionType, *, chunked: bool, interleaved: bool
) -> None:
    """Write the same topic with the package's own writer and protobuf: zeros are left out."""
    flat = flat_schema(TICK, UNITS, EPOCH)
    schema = schema_record(flat, 1)
    pool = DescriptorPool()
    pool.AddSerializedFile(FileDescriptorSet.FromString(schema.data).file[0].SerializeToString())
    message = GetMessageClass(pool.FindMessageTypeByName("zwidth.Tick"))
    log_times, residuals = to_log_time(run.t, EPOCH)
    with path.open("wb") as file:
        writer = Writer(file, 20_000, compression, use_chunking=chunked, enable_data_crcs=True)
        writer.start()
        writer.register_schema(schema.name, schema.encoding, schema.data)
        channel = channel_record(flat, 1)
        writer.register_channel(TICK, "protobuf", 1, channel.metadata)
        other = writer.register_channel("/camera", "json", 0)
        for i, log_time in enumerate(log_times.tolist()):
            values = [float(row[i]) for row in (residuals, *run.channels.values())]
            body = message(**dict(zip(flat.fields, values, strict=True))).SerializeToString()
            writer.add_message(1, log_time, body, log_time, i)
            if interleaved and i % 3 == 0:
                writer.add_message(other, log_time, b"{}", log_time)
        writer.add_metadata("zwidth", {"K": "3.5"})
        writer.finish()


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("interleaved", [False, True])
def test_a_log_by_the_library_reads_the_same(
    tmp_path: Path, compression: CompressionType, interleaved: bool
) -> None:
    """Samples with a zero have another length: both paths are taken, often in turn.

    Breaks if Layout.run counts one record too many, or looks at the lengths alone.
    """
    run = example(300)
    path = tmp_path / "library.mcap"
    library_log(path, run, compression, chunked=True, interleaved=interleaved)
    log = read_log(path)
    assert log.warnings == ()
    assert "mcap" in log.library
    assert log.metadata == {"K": "3.5"}
    assert_same(log.tick, run)


def test_a_run_of_records_ends_where_a_constant_byte_differs() -> None:
    """Breaks if the layout is taken for granted from the lengths, or from the first tag."""
    layout = Layout(3, [1, 15, 16, 2**18, 2**21])
    data = layout.template.tobytes() * 50
    assert layout.run(data, 0) == 50
    assert layout.run(data[:-1], layout.size) == 48
    varies = ("sequence", "log_time", "publish_time", "value")
    free = {at for name, at in _bytes(layout) if name.startswith(varies)}
    for at in range(layout.size):
        changed = bytearray(data)
        changed[30 * layout.size + at] ^= 1
        assert layout.run(bytes(changed), 0) == (50 if at in free else 30)


def _bytes(layout: Layout) -> list[tuple[str, int]]:
    """Return (name of the field, byte) for every byte of a record."""
    fields = layout.dtype.fields
    assert fields is not None
    spans = {name: range(f[1], f[1] + f[0].itemsize) for name, f in fields.items()}
    return [(str(name), at) for name, span in spans.items() for at in span]


def test_a_library_log_without_chunks_reads_the_same(tmp_path: Path) -> None:
    run = example(100)
    library_log(tmp_path / "a.mcap", run, CompressionType.NONE, chunked=False, interleaved=True)
    log = read_log(tmp_path / "a.mcap")
    assert log.warnings == ()
    assert_same(log.tick, run)


def test_array_path_and_protobuf_write_the_same_bytes(tmp_path: Path) -> None:
    """Where no value is zero, protobuf leaves nothing out and the chunks must be equal."""
    run = example(200)
    ones = {name: values + (name == "contact") for name, values in run.channels.items()}
    run = run.with_channels(ones, run.t + 0.3e-9)
    library_log(tmp_path / "a.mcap", run, CompressionType.NONE, chunked=True, interleaved=False)
    write(tmp_path / "b.mcap", run, 50)
    assert ticks(tmp_path / "a.mcap") == ticks(tmp_path / "b.mcap")


def ticks(path: Path) -> list[bytes]:
    with path.open("rb") as file:
        messages = make_reader(file).iter_messages(topics=[TICK])
        return [_record(message) for _, _, message in messages]


def test_schema_stands_alone(path: Path) -> None:
    """Every field is a double scalar with a four-byte tag, described without other files."""
    schema = summary_of(path).schemas[1]
    (file,) = FileDescriptorSet.FromString(schema.data).file
    assert (schema.name, file.package, list(file.dependency)) == ("zwidth.Tick", "zwidth", [])
    (message,) = file.message_type
    assert {field.type for field in message.field} == {1}
    assert all(2**18 <= field.number < 2**25 for field in message.field)
    assert message.field[0].name == TIME_RESIDUAL

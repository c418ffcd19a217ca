import random
import re
import struct
import tracemalloc
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from log_examples import (
    EPOCH,
    EVENTS,
    METADATA,
    UNITS,
    assert_only_true,
    assert_same,
    example,
    write_blocks,
)
from mcap.reader import make_reader
from mcap.writer import Writer

from zwidth.logs import framing, records
from zwidth.logs.errors import (
    ForeignLog,
    LogDamaged,
    LogEmpty,
    LogError,
    LogIsDirectory,
    LogNotFound,
    LogNotReadable,
    NotMcap,
)
from zwidth.logs.mcap_reader import read_log
from zwidth.logs.mcap_writer import LogWriter

SAMPLES, BLOCK = 60, 10
RUN = example(SAMPLES)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs") / "whole.mcap"
    write_blocks(path, RUN, BLOCK)
    assert read_log(path).warnings == ()
    return path


@pytest.fixture(scope="module")
def chunks(whole: Path) -> list[tuple[int, int]]:
    """Where each chunk of `/tick` starts, and where its message index ends."""
    with whole.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    return [
        (c.chunk_start_offset, c.chunk_start_offset + c.chunk_length + c.message_index_length)
        for c in summary.chunk_indexes
        if 1 in c.message_index_offsets
    ]


def unindexed(data: bytes) -> bytes:
    """Return the file as a killed run leaves it: without an end."""
    (start,) = struct.unpack_from("<Q", data, len(data) - 28)
    return data[: start - 13]


def test_truncation_at_a_thousand_positions(
    whole: Path, chunks: list[tuple[int, int]], tmp_path: Path
) -> None:
    """Every chunk that is complete comes back, nothing else does, and a sentence says so.

    Breaks if a frame is read past the end of the file, or the last complete chunk is given up.
    """
    data = whole.read_bytes()
    complete = [struct.unpack_from("<Q", data, start + 1)[0] + 9 + start for start, _ in chunks]
    for size in np.linspace(1, len(data) - 1, 1000).astype(int).tolist():
        cut = tmp_path / "cut.mcap"
        cut.write_bytes(data[:size])
        try:
            log = read_log(cut)
        except LogDamaged:
            assert size < chunks[0][0]
            continue
        assert_only_true(log, RUN)
        assert len(log.tick) == BLOCK * sum(stop <= size for stop in complete)
        assert log.warnings


def test_a_flipped_byte_anywhere(whole: Path, tmp_path: Path) -> None:
    """At most one chunk is lost, nothing false comes back, and no flip goes unnoticed.

    Breaks without the crc of chunks, of the data section or of metadata (logs.seal), and if reading
    does not resume inside a record whose length is damaged.
    """
    data, flipped = whole.read_bytes(), tmp_path / "flipped.mcap"
    choose = random.Random(1)
    for position in np.linspace(0, len(data) - 1, 900).astype(int).tolist():
        damaged = bytearray(data)
        damaged[position] ^= choose.choice([1, 2, 4, 8, 16, 32, 64, 128, 255])
        flipped.write_bytes(damaged)
        log = read_log(flipped)
        assert_only_true(log, RUN)
        assert len(log.tick) >= SAMPLES - BLOCK
        assert log.warnings


@settings(max_examples=250, deadline=None, derandomize=True,
          suppress_health_check=[HealthCheck.function_scoped_fixture])  # fmt: skip
@given(st.data())
def test_a_killed_run_with_mutated_bytes(whole: Path, tmp_path: Path, data: st.DataObject) -> None:
    """Without index and checksum of the whole: still nothing but errors of ours, or the truth.

    Single bytes are changed, stretches removed, doubled and overwritten.
    """
    mutated = bytearray(unindexed(whole.read_bytes()))
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(mutated) - 1))
        length = data.draw(st.integers(1, 300))
        match data.draw(st.sampled_from(["flip", "cut", "double", "overwrite"])):
            case "flip":
                mutated[at] ^= data.draw(st.integers(1, 255))
            case "cut":
                del mutated[at : at + length]
                mutated = mutated or bytearray(b"x")
            case "double":
                mutated[at:at] = mutated[at : at + length]
            case _:
                mutated[at : at + length] = data.draw(st.binary(min_size=1, max_size=50))
    (tmp_path / "mutated.mcap").write_bytes(mutated)
    try:
        log = read_log(tmp_path / "mutated.mcap")
    except LogError:
        return
    assert log.warnings
    rows = {tuple(row) for row in zip(RUN.t, *RUN.channels.values(), strict=True)}
    assert rows >= set(zip(log.tick.t, *log.tick.channels.values(), strict=True))
    assert set(log.events) <= set(EVENTS)


def test_a_wrong_chunk_checksum_is_named(
    whole: Path, chunks: list[tuple[int, int]], tmp_path: Path
) -> None:
    data = bytearray(whole.read_bytes())
    start, _ = chunks[2]
    data[start + 9 + 24] ^= 1
    (tmp_path / "crc.mcap").write_bytes(data)
    log = read_log(tmp_path / "crc.mcap")
    assert len(log.tick) == SAMPLES - BLOCK
    damage, gap = log.warnings
    assert re.fullmatch(
        rf"bytes {start} to \d+ were skipped: a chunk whose checksum is wrong", damage
    )
    assert gap == "/tick: 10 samples are missing between t = 0.019 s and 0.03 s"
    assert log.tick.facts["warnings"] == [damage, gap]


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize(
    ("lost", "sentence"),
    [
        (0, "/tick: 10 samples are missing before t = 0.01 s"),
        (3, "/tick: 10 samples are missing between t = 0.029 s and 0.04 s"),
    ],
)
def test_a_missing_chunk_is_named(
    whole: Path,
    chunks: list[tuple[int, int]],
    tmp_path: Path,
    closed: bool,
    lost: int,
    sentence: str,
) -> None:
    """Cut out without a trace but the counter of samples; breaks without logs.gaps."""
    data = whole.read_bytes() if closed else unindexed(whole.read_bytes())
    start, stop = chunks[lost]
    (tmp_path / "gap.mcap").write_bytes(data[:start] + data[stop:])
    log = read_log(tmp_path / "gap.mcap")
    assert_only_true(log, RUN)
    assert sentence in log.warnings


def test_a_missing_last_chunk_is_missed_by_the_statistics(
    whole: Path, chunks: list[tuple[int, int]], tmp_path: Path
) -> None:
    data = bytearray(whole.read_bytes())
    start, _ = chunks[-1]
    data[start + 60 : start + 100] = bytes(40)
    (tmp_path / "gap.mcap").write_bytes(data)
    assert (
        "/tick: 10 samples are missing after t = 0.049 s"
        in read_log(tmp_path / "gap.mcap").warnings
    )


def test_a_doubled_chunk_is_named(
    whole: Path, chunks: list[tuple[int, int]], tmp_path: Path
) -> None:
    data = whole.read_bytes()
    start, stop = chunks[1]
    (tmp_path / "twice.mcap").write_bytes(data[:stop] + data[start:])
    log = read_log(tmp_path / "twice.mcap")
    assert "/tick: the counter of samples goes back at t = 0.01 s" in log.warnings


def test_a_killed_run_is_read_and_named(whole: Path, tmp_path: Path) -> None:
    (tmp_path / "run.partial.mcap").write_bytes(unindexed(whole.read_bytes()))
    log = read_log(tmp_path / "run.partial.mcap")
    assert_same(log.tick, RUN)
    assert log.metadata.items() >= METADATA.items()
    (warning,) = log.warnings
    assert warning.startswith("the log was not closed: the run was killed or goes on")
    assert warning.endswith("it is here up to t = 0.059 s")
    with pytest.raises(LogNotFound, match=r"run\.partial\.mcap, left there by a run"):
        read_log(tmp_path / "run.mcap")


@pytest.mark.parametrize("field", range(4))
def test_an_enormous_length_allocates_nothing(
    whole: Path, chunks: list[tuple[int, int]], tmp_path: Path, field: int
) -> None:
    """The lengths of a frame, a chunk, its data, and the size its zstd frame claims.

    Breaks if the claim of the frame is believed: 8 GiB, which many a machine would hand out.
    """
    data, enormous = (
        bytearray(whole.read_bytes()),
        struct.pack("<Q", 2**33 if field == 3 else 2**56),
    )
    start, _ = chunks[1]
    if field < 3:
        at = start + (1, 25, 45)[field]
        data[at : at + 8] = enormous
    else:
        frame = data.index(b"\x28\xb5\x2f\xfd", start)
        data[frame + 4 : frame + 13] = b"\xe0" + enormous  # single segment, 8-byte content size
    (tmp_path / "huge.mcap").write_bytes(data)
    tracemalloc.start()
    log = read_log(tmp_path / "huge.mcap")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 10e6
    assert len(log.tick) == SAMPLES - BLOCK
    assert_only_true(log, RUN)


def test_endless_damage_ends_soon(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two megabytes of heads of chunks that are none, each reaching to the end of the file.

    Breaks without Walk.wasted: what is read then grows with the square of the size.
    """
    header = whole.read_bytes()[:8]
    size, head = 40_000, 53
    chunk = struct.pack("<QQQII4s", 0, 0, 1, 1, 4, b"zstd")
    heads = b"".join(
        struct.pack("<BQ", 6, len(chunk) + 8 + left) + chunk + struct.pack("<Q", left)
        for left in range((size - 1) * head, -1, -head)
    )
    (tmp_path / "endless.mcap").write_bytes(header + heads)
    parsed: list[int] = []

    def counting(opcode: int, content: bytes) -> records.Parsed:
        parsed.append(len(content))
        return parse(opcode, content)

    parse = records.parse
    monkeypatch.setattr(framing, "parse", counting)
    with pytest.raises(LogDamaged):
        read_log(tmp_path / "endless.mcap")
    size = (tmp_path / "endless.mcap").stat().st_size
    assert sum(parsed) < 20 * size  # eight times the file, a mebibyte, and the last attempt
    assert sum(parsed) > 4 * size


def test_files_that_are_no_logs(tmp_path: Path) -> None:
    """One class and one sentence a cause, and the sentence names the file."""
    (tmp_path / "empty.mcap").touch()
    (tmp_path / "table.csv").write_text("t [s];x [m]\n0,0;1,5\n")
    (tmp_path / "start.mcap").write_bytes(b"\x89MCAP")
    (tmp_path / "noise.mcap").write_bytes(b"\x89MCAP0\r\n" + random.Random(0).randbytes(5000))
    for name, kind, words in (
        ("missing.mcap", LogNotFound, "does not exist"),
        ("", LogIsDirectory, "is a folder"),
        ("empty.mcap", LogEmpty, "is empty"),
        ("table.csv", NotMcap, "is not an MCAP file: it starts with b't [s];x '"),
        ("start.mcap", LogDamaged, "ends after 5 bytes"),
        ("noise.mcap", LogDamaged, "nothing can be recovered"),
        ("table.csv/x.mcap", LogNotReadable, "not a directory"),
    ):
        with pytest.raises(LogError, match=re.escape(words)) as caught:
            read_log(tmp_path / name)
        assert type(caught.value) is kind
        assert str(tmp_path / name) in str(caught.value)


@pytest.mark.parametrize("indexed", [True, False])
def test_a_log_of_another_tool_is_named(tmp_path: Path, indexed: bool) -> None:
    path = tmp_path / "ros.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="rosbag2 0.26")
        schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", b"float64[] x")
        channel = writer.register_channel("/joint_states", "cdr", schema)
        writer.add_message(channel, 1, b"\0" * 20, 1)
        writer.finish()
    if not indexed:
        path.write_bytes(unindexed(path.read_bytes()))
    with pytest.raises(ForeignLog, match=r"without a run in it \(topics: /joint_states\)"):
        read_log(path)


def test_a_header_that_swallows_chunks_is_seen_through(
    whole: Path, chunks: list[tuple[int, int]], tmp_path: Path
) -> None:
    """Its length is raised to the middle of the fifth chunk; breaks if reading resumes only there.

    The schemas and notes that went with it are lost, but every chunk brings its own.
    """
    data, (start, stop) = bytearray(unindexed(whole.read_bytes())), chunks[4]
    data[9:17] = struct.pack("<Q", (start + stop) // 2 - 17)
    (tmp_path / "swallowed.mcap").write_bytes(data)
    log = read_log(tmp_path / "swallowed.mcap")
    assert_only_true(log, RUN)
    assert len(log.tick) == SAMPLES
    assert log.warnings[0].startswith("bytes 8 to ")


def test_a_chunk_that_swallows_others_is_seen_through(
    whole: Path, chunks: list[tuple[int, int]], tmp_path: Path
) -> None:
    """Its length is raised to where another record ends, so what follows looks whole."""
    data, (start, _), (_, stop) = bytearray(unindexed(whole.read_bytes())), chunks[1], chunks[3]
    data[start + 1 : start + 9] = struct.pack("<Q", stop - start - 9)
    (tmp_path / "swallowed.mcap").write_bytes(data)
    log = read_log(tmp_path / "swallowed.mcap")
    assert_only_true(log, RUN)
    assert len(log.tick) == SAMPLES - BLOCK


def test_a_chunk_of_another_run_is_refused(
    whole: Path, chunks: list[tuple[int, int]], tmp_path: Path
) -> None:
    """Same topic, same fields, another unit: its numbers would be false here."""
    other, data = tmp_path / "other.mcap", whole.read_bytes()
    with LogWriter(other, UNITS | {"command": "mN m"}, epoch_ns=EPOCH) as log:
        log.append(RUN.t, RUN.channels)
    foreign = unindexed(other.read_bytes())
    foreign = foreign[foreign.index(struct.pack("<I4s", 4, b"zstd")) - 37 :]
    (tmp_path / "mixed.mcap").write_bytes(data[: chunks[2][0]] + foreign)
    read = read_log(tmp_path / "mixed.mcap")
    assert_only_true(read, RUN)
    assert len(read.tick) == 2 * BLOCK
    assert "skipped: a second, different description of /tick" in read.warnings


def test_an_index_is_not_mistaken_for_a_message(whole: Path, tmp_path: Path) -> None:
    """One bit makes the message index of `/events` a message: its bytes decode, to nonsense.

    Breaks if samples without a checksum are believed in a file of ours.
    """
    with whole.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    (at,) = (
        c.message_index_offsets[2] for c in summary.chunk_indexes if 2 in c.message_index_offsets
    )
    data = bytearray(whole.read_bytes())
    assert data[at] == 7
    data[at] = 5
    (tmp_path / "index.mcap").write_bytes(data)
    log = read_log(tmp_path / "index.mcap")
    assert log.events == EVENTS
    assert (
        log.warnings[0] == "skipped: samples without a checksum; every log of zwidth has checksums"
    )


def test_a_chunk_that_does_not_add_up_is_given_up_whole(whole: Path, tmp_path: Path) -> None:
    """Its checksum is right, its records are not."""
    data = whole.read_bytes()
    content = struct.pack("<BQ", 5, 2**40) + b"\x01\0"
    chunk = struct.pack("<QQQIIQ", 0, 0, len(content), zlib.crc32(content), 0, len(content))
    record = struct.pack("<BQ", 6, len(chunk) + len(content)) + chunk + content
    (tmp_path / "odd.mcap").write_bytes(unindexed(data) + record)
    log = read_log(tmp_path / "odd.mcap")
    assert "skipped: a chunk whose records do not fill it exactly" in log.warnings
    assert_same(log.tick, RUN)

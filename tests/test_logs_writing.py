"""What is on the disk while a log is written, and whatever way the writing ends."""

import errno
import os
import signal
import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from log_examples import EPOCH, EVENTS, UNITS, assert_same, example, write_blocks

from zwidth.logs.errors import LogBlockError, LogError, LogPathError, LogWriteError
from zwidth.logs.events import Event
from zwidth.logs.mcap_reader import read_log
from zwidth.logs.mcap_writer import LogWriter
from zwidth.sim.trace import Floats, Trace

ROOT = Path(__file__).parents[1]


def part(trace: Trace, first: int, last: int) -> tuple[Floats, dict[str, Floats]]:
    """Return samples first to last - 1 as the arguments of `append`."""
    return trace.t[first:last], {n: v[first:last] for n, v in trace.channels.items()}


KILLED = """
import sys, time
from log_examples import *
run = example(100_000)
with LogWriter(sys.argv[1], UNITS, metadata=METADATA, epoch_ns=EPOCH) as log:
    for first in range(0, len(run), 100):
        rows = slice(first, first + 100)
        log.append(run.t[rows], {n: v[rows] for n, v in run.channels.items()})
        print(first + 100, flush=True)
        time.sleep(1e-3)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="kill -9 is a signal")
def test_kill_9_leaves_every_appended_block(tmp_path: Path) -> None:
    """What append has returned for can be read. Breaks if blocks wait in a buffer of ours."""
    path, search = tmp_path / "run.mcap", os.pathsep.join([str(ROOT), str(ROOT / "tests")])
    process = subprocess.Popen(
        [sys.executable, "-c", KILLED, str(path)],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": search},
    )
    assert process.stdout is not None
    said = [process.stdout.readline() for _ in range(20)]
    process.kill()
    said += process.stdout.read().splitlines()
    appended = int(said[-1])
    assert process.wait() == -signal.SIGKILL
    process.stdout.close()
    assert not path.exists()
    log = read_log(tmp_path / "run.partial.mcap")
    assert len(log.tick) in (appended, appended + 100)
    run = example(100_000)
    t, channels = part(run, 0, len(log.tick))
    assert_same(log.tick, run.with_channels(channels, t))
    assert log.warnings[-1].startswith("the log was not closed")


def test_every_append_can_be_read_at_once(tmp_path: Path) -> None:
    run = example(90)
    with LogWriter(tmp_path / "run.mcap", UNITS) as log:
        for first in range(0, 90, 30):
            log.append(*part(run, first, first + 30))
            assert len(read_log(log.partial).tick) == first + 30
        log.events(EVENTS)
        assert read_log(log.partial).events == EVENTS


def test_a_good_log_is_replaced_only_by_a_complete_one(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    write_blocks(path, example(20), 10)
    good = path.read_bytes()
    with LogWriter(path, UNITS) as log:
        log.append(*part(example(40), 0, 40))
        assert path.read_bytes() == good
    assert len(read_log(path).tick) == 40
    assert list(tmp_path.glob("*.mcap*")) == [path]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ZeroDivisionError, FileNotFoundError])
def test_an_interrupted_run_is_completed_under_its_partial_name(
    tmp_path: Path, error: type[BaseException]
) -> None:
    path, run = tmp_path / "run.mcap", example(40)
    write_blocks(path, example(20), 10)
    good = path.read_bytes()

    def interrupted() -> None:
        with LogWriter(path, UNITS) as log:
            log.append(*part(run, 0, 30))
            raise error

    for name in ("run.partial.mcap", "run.partial-2.mcap"):
        with pytest.raises(error):
            interrupted()
        left = read_log(tmp_path / name)
        assert left.warnings == (f"the run ended early, by {error.__name__}",)
        assert len(left.tick) == 30
    assert path.read_bytes() == good


def test_an_interrupt_within_a_write_leaves_whole_records(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half a chunk is on the disk when Ctrl-C arrives: the next record takes its place.

    Breaks if pieces are appended where the file ends instead of where the last whole one does.
    """
    run, write = example(60), os.write

    def half(descriptor: int, data: memoryview) -> int:
        write(descriptor, data[: len(data) // 2])
        raise KeyboardInterrupt

    def interrupted() -> None:
        with LogWriter(tmp_path / "run.mcap", UNITS) as log:
            log.append(*part(run, 0, 20))
            monkeypatch.setattr(os, "write", half)
            try:
                log.append(*part(run, 20, 60))
            finally:
                monkeypatch.setattr(os, "write", write)

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    log = read_log(tmp_path / "run.partial.mcap")
    assert log.warnings == ("the run ended early, by KeyboardInterrupt",)
    assert len(log.tick) == 20


def test_a_full_disk_keeps_what_was_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk takes 40 blocks and half of the next; the sentence names the file that is left."""
    write, room = os.write, 40 * 1500

    def full(descriptor: int, data: memoryview) -> int:
        nonlocal room
        if room == 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        written = write(descriptor, data[:room])
        room -= written
        return written

    monkeypatch.setattr(os, "write", full)
    run = example(5000)

    def fill() -> None:
        with LogWriter(tmp_path / "run.mcap", UNITS) as log:
            for first in range(0, 5000, 20):
                log.append(*part(run, first, first + 20))

    with pytest.raises(LogWriteError, match="there is no room left; what was logged") as caught:
        fill()
    assert isinstance(caught.value, LogError)
    assert isinstance(caught.value, OSError)
    assert caught.value.errno == errno.ENOSPC
    assert "run.partial.mcap" in str(caught.value)
    log = read_log(tmp_path / "run.partial.mcap")
    assert len(log.tick) > 500
    assert len(log.tick) % 20 == 0
    assert log.warnings[-1].startswith("the log was not closed: the run was killed")


def test_paths_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for path, words in (
        (tmp_path, "is a folder; give a file in it"),
        (tmp_path / "missing" / "run.mcap", "create it first"),
        (tmp_path / "file" / "run.mcap", "not a directory"),
        (tmp_path / ("x" * 300), "file name too long"),
    ):
        with pytest.raises(LogPathError, match=words):
            LogWriter(path, UNITS)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device files here")
def test_a_device_is_no_log() -> None:
    with pytest.raises(LogPathError, match="not a regular file"):
        LogWriter("/dev/full", UNITS)


def test_blocks_that_do_not_fit(tmp_path: Path) -> None:
    """Each is refused with one sentence before a byte of it is written."""
    run = example(10)
    t, channels = part(run, 0, 10)
    with LogWriter(tmp_path / "run.mcap", UNITS, epoch_ns=EPOCH) as log:
        size = log.partial.stat().st_size
        for words, times, block in (
            ("differ in command", t, {n: v for n, v in channels.items() if n != "command"}),
            ("differ in torque", t, channels | {"torque": t}),
            (r"position_m1 has shape \(9,\)", t, channels | {"position_m1": t[:9]}),
            (r"t has shape \(10, 1\)", t[:, None], channels),
            ("a time is nan s", np.where(t == 0.0, np.nan, t), channels),
            ("is not a log time", t - 2e9, channels),
        ):
            with pytest.raises(LogBlockError, match=words):
                log.append(times, block)
        with pytest.raises(LogBlockError, match=r"topic '/tock' is not in this log; it has /tick"):
            log.append(t, channels, "/tock")
        with pytest.raises(LogBlockError, match="does not fit the log"):
            log.events([Event(0.0, "\ud800", "m1", 0.0)])
        with pytest.raises(LogBlockError, match="metadata 'K' is 3; write it as text"):
            log.note({"K": 3})  # pyright: ignore[reportArgumentType]
        assert log.partial.stat().st_size == size
    with pytest.raises(LogBlockError, match="is closed already"):
        log.append(t, channels)
    with pytest.raises(LogBlockError, match="epoch_ns is -1"):
        LogWriter(tmp_path / "run.mcap", UNITS, epoch_ns=-1)


def test_an_hour_needs_no_more_memory_than_a_minute(tmp_path: Path) -> None:
    """Memory grows by an index entry a block (0.6 kB a second), not by the samples (40 kB)."""
    run = example(1000)
    tracemalloc.start()
    with LogWriter(tmp_path / "run.mcap", UNITS) as log:
        peaks: list[int] = []
        for second in range(300):
            log.append(run.t + second, run.channels)
            if second in (99, 299):
                peaks.append(tracemalloc.get_traced_memory()[1])
    tracemalloc.stop()
    assert peaks[1] - peaks[0] < 200 * 2000

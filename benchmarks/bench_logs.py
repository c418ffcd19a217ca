"""Logs: ticks written and read per second, bytes per channel and tick, memory for an hour.

    python -m pytest benchmarks/bench_logs.py --benchmark-only

The figures stand in the column of extra info (--benchmark-json FILE has them too) and are printed
with -s. Run on an idle machine; each benchmark keeps one core busy.
"""

import resource
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory
from pytest_benchmark.fixture import BenchmarkFixture

from zwidth.controllers.wall import wall
from zwidth.logs.clock import to_log_time
from zwidth.logs.mcap_reader import read_log
from zwidth.logs.mcap_writer import LogWriter
from zwidth.logs.schema import TICK, channel_record, flat_schema, schema_record
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.physics import make_physics
from zwidth.sim.run import Start, simulate
from zwidth.sim.trace import Floats, Trace

EPOCH = 1_763_000_000_123_456_789
BLOCK = 1000
SECONDS = 60
HOUR = 3600


def phantom(friction: float, encoder_step: float) -> Device:
    device = load_device("phantom_1_0").with_interface(encoder_step=encoder_step)
    level = make_physics("coulomb_friction", "m1", level=friction)
    return device.with_physics(level) if friction else device


def hand(seconds: int) -> Floats:
    t = np.arange(seconds * 1000, dtype=np.float64) * 0.001
    return 0.05 * np.sin(2 * np.pi * 0.7 * t) + 0.02 * np.sin(2 * np.pi * 2.3 * t + 1.0)


def pushed() -> Trace:
    """A hand pushes into a one-sided wall; friction, encoder step, stored energy: 13 channels."""
    run = simulate(
        phantom(0.005, 2 * np.pi / 100_000),
        wall(10.0, 0.03, one_sided=True),
        duration=SECONDS,
        disturbance=hand(SECONDS),
        substeps=4,
        energy=True,
    )
    return run.trace


def boundary() -> Trace:
    """A run of `zwidth boundary`, just stable: nothing but full mantissas."""
    return simulate(
        phantom(0.0, 0.0), wall(14.97, 0.03), duration=SECONDS, start=Start(1e-3), energy=True
    ).trace


def decaying() -> Trace:
    """The hardest case: every exponent drifts too."""
    return simulate(
        phantom(0.0, 0.0), wall(10.0, 0.03), duration=SECONDS, start=Start(1e-3), energy=True
    ).trace


def with_ledger() -> Trace:
    """The hand's run with the whole ledger: 23 channels."""
    return simulate(
        phantom(0.005, 2 * np.pi / 100_000),
        wall(10.0, 0.03, one_sided=True),
        duration=SECONDS,
        disturbance=hand(SECONDS),
        substeps=4,
        ledger=True,
    ).trace


RUNS: list[Callable[[], Trace]] = [pushed, boundary, decaying, with_ledger]


def blocks(trace: Trace) -> list[tuple[Floats, dict[str, Floats]]]:
    parts = [slice(first, first + BLOCK) for first in range(0, len(trace), BLOCK)]
    return [(trace.t[p], {n: v[p] for n, v in trace.channels.items()}) for p in parts]


def write_arrays(path: Path, trace: Trace) -> None:
    with LogWriter(path, trace.units, epoch_ns=EPOCH) as log:
        for t, channels in blocks(trace):
            log.append(t, channels)


def write_messages(path: Path, trace: Trace) -> None:
    """The mcap package and protobuf alone, one message at a time."""
    flat = flat_schema(TICK, trace.units, EPOCH)
    schema = schema_record(flat, 1)
    pool = DescriptorPool()
    pool.AddSerializedFile(FileDescriptorSet.FromString(schema.data).file[0].SerializeToString())
    message = GetMessageClass(pool.FindMessageTypeByName(schema.name))
    log_times, residuals = to_log_time(trace.t, EPOCH)
    columns = np.array([residuals, *trace.channels.values()])
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.register_schema(schema.name, schema.encoding, schema.data)
        writer.register_channel(TICK, "protobuf", 1, channel_record(flat, 1).metadata)
        for i, log_time in enumerate(log_times.tolist()):
            body = message(**dict(zip(flat.fields, columns[:, i].tolist(), strict=True)))
            writer.add_message(1, log_time, body.SerializeToString(), log_time, i)
        writer.finish()


def read_messages(path: Path) -> int:
    """The mcap package and its protobuf decoder alone, every value looked at."""
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        rows = [
            [getattr(tick, field.name) for field in tick.DESCRIPTOR.fields]
            for _, _, _, tick in reader.iter_decoded_messages()
        ]
    return len(rows)


def report(benchmark: BenchmarkFixture, trace: Trace, path: Path) -> None:
    assert benchmark.stats is not None
    ticks = len(trace)
    benchmark.extra_info["ticks_per_s"] = round(ticks / benchmark.stats["median"])
    size = path.stat().st_size / ticks / len(trace.channels)
    benchmark.extra_info["bytes_per_channel_and_tick"] = round(size, 3)
    benchmark.extra_info["channels"] = len(trace.channels)
    print(f"\n{benchmark.name}: {dict(benchmark.extra_info)}", file=sys.stderr)


@pytest.fixture(scope="module")
def trace() -> Trace:
    return pushed()


@pytest.mark.parametrize("run", RUNS, ids=lambda run: run.__name__)
def test_write_arrays(
    benchmark: BenchmarkFixture, tmp_path: Path, run: Callable[[], Trace]
) -> None:
    written, path = run(), tmp_path / "run.mcap"
    benchmark.pedantic(write_arrays, (path, written), rounds=7, warmup_rounds=1)
    report(benchmark, written, path)


def test_write_messages(benchmark: BenchmarkFixture, tmp_path: Path, trace: Trace) -> None:
    path = tmp_path / "run.mcap"
    benchmark.pedantic(write_messages, (path, trace), rounds=3)
    report(benchmark, trace, path)


@pytest.mark.parametrize("run", RUNS, ids=lambda run: run.__name__)
def test_read_arrays(benchmark: BenchmarkFixture, tmp_path: Path, run: Callable[[], Trace]) -> None:
    written, path = run(), tmp_path / "run.mcap"
    write_arrays(path, written)
    log = benchmark.pedantic(read_log, (path,), rounds=7, warmup_rounds=1)
    assert np.array_equal(log.tick.t, written.t)
    report(benchmark, written, path)


def test_read_messages(benchmark: BenchmarkFixture, tmp_path: Path, trace: Trace) -> None:
    path = tmp_path / "run.mcap"
    write_arrays(path, trace)
    assert benchmark.pedantic(read_messages, (path,), rounds=3) == len(trace)
    report(benchmark, trace, path)


def test_an_hour(benchmark: BenchmarkFixture, tmp_path: Path, trace: Trace) -> None:
    """3.6 million ticks: seconds to write them, and how far the process grew meanwhile."""
    path, pieces = tmp_path / "hour.mcap", blocks(trace)

    def hour() -> None:
        with LogWriter(path, trace.units, epoch_ns=EPOCH) as log:
            for second in range(HOUR):
                t, channels = pieces[second % len(pieces)]
                log.append(t + (second // len(pieces)) * SECONDS, channels)

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    benchmark.pedantic(hour, rounds=1)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    log = read_log(path)
    assert len(log.tick) == HOUR * BLOCK
    assert log.warnings == ()
    assert benchmark.stats is not None
    benchmark.extra_info["ticks_per_s"] = round(HOUR * BLOCK / benchmark.stats["median"])
    benchmark.extra_info["grown_mib"] = round(grown / 1024, 1)
    print(f"\n{benchmark.name}: {dict(benchmark.extra_info)}", file=sys.stderr)

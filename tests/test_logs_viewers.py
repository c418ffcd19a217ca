"""The same log in two readers that share no code with ours; see viewers/README.md."""

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from log_examples import EPOCH, bits

from zwidth.controllers.wall import wall
from zwidth.logs.clock import from_log_time
from zwidth.logs.events import Event
from zwidth.logs.mcap_writer import LogWriter
from zwidth.logs.schema import TIME_RESIDUAL, field_names
from zwidth.sim.device_file import load_device
from zwidth.sim.run import Run, Start, simulate

VIEWERS = Path(__file__).parent / "viewers"
MCAP_CORE, RERUN = os.environ.get("ZWIDTH_MCAP_CORE"), os.environ.get("ZWIDTH_RERUN")
BLOCK = 500
TOUCH = Event(0.5, "contact", "m1", 0.1)


@pytest.fixture(scope="module")
def run() -> Run:
    """A run at the boundary, with substeps."""
    phantom = load_device("phantom_1_0")
    return simulate(
        phantom,
        wall(14.97, 0.03),
        duration=2.0,
        start=Start(1e-3),
        energy=True,
        fine=True,
        substeps=3,
    )


@pytest.fixture(scope="module")
def path(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs") / "run.mcap"
    assert run.fine is not None
    units = run.trace.units, run.fine.units
    with LogWriter(path, units[0], substep_channels=units[1], epoch_ns=EPOCH) as log:
        for first in range(0, len(run.trace), BLOCK):
            for trace, topic, rate in ((run.trace, "/tick", 1), (run.fine, "/substep", 3)):
                part = slice(first * rate, (first + BLOCK) * rate)
                log.append(trace.t[part], {n: v[part] for n, v in trace.channels.items()}, topic)
        log.events([TOUCH])
    return path


def decode(*command: str) -> dict[str, Any]:
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)["topics"]


def assert_seen(topics: dict[str, Any], run: Run) -> None:
    """Fail unless every channel is there by name, with every value equal bit for bit."""
    assert run.fine is not None
    for topic, trace in (("/tick", run.trace), ("/substep", run.fine)):
        seen = topics[topic]
        fields = field_names({name: trace.units[name] for name in trace.channels})
        assert set(seen["fields"]) == {TIME_RESIDUAL, *fields.values()}
        assert seen["messages"] == len(trace)
        for name, values in trace.channels.items():
            assert bits(np.array(seen["fields"][fields[name]], dtype=np.float64)) == bits(values)
        ends = np.array([int(text) for text in seen["log_times"]], dtype=np.uint64)
        residual = np.array(seen["fields"][TIME_RESIDUAL], dtype=np.float64)
        assert bits(from_log_time(ends, residual[[0, -1]], EPOCH)) == bits(trace.t[[0, -1]])
    (kind,), (place,), (value,) = (
        topics["/events"]["fields"][f] for f in ("kind", "place", "value")
    )
    assert (kind, place, value) == TOUCH[1:]


@pytest.mark.skipif(MCAP_CORE is None, reason="ZWIDTH_MCAP_CORE names no folder with @mcap/core")
def test_mcap_core_sees_every_bit(path: Path, run: Run) -> None:
    script = VIEWERS / "decode_log.mjs"
    assert_seen(decode("node", str(script), str(MCAP_CORE), str(path)), run)


@pytest.mark.skipif(RERUN is None, reason="ZWIDTH_RERUN names no python with rerun-sdk")
def test_rerun_sees_every_bit(path: Path, run: Run) -> None:
    script = VIEWERS / "decode_in_rerun.py"
    assert_seen(decode(str(RERUN), str(script), str(path)), run)


@pytest.mark.skipif(RERUN is None, reason="ZWIDTH_RERUN names no python with rerun-sdk")
def test_rerun_recovers_a_killed_run(path: Path, run: Run, tmp_path: Path) -> None:
    data = path.read_bytes()
    start = int.from_bytes(data[-28:-20], "little")
    killed = tmp_path / "run.partial.mcap"
    killed.write_bytes(data[: start - 13])
    assert_seen(decode(str(RERUN), str(VIEWERS / "decode_in_rerun.py"), str(killed)), run)

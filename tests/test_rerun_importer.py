"""`rerun-importer-zwidth`, driven by Rerun's own SDK."""

import os
import subprocess
import sys
import tomllib
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from zwidth.logs.annotations import Annotation
from zwidth.logs.mcap_writer import write_log
from zwidth.sim.trace import Trace

ROOT = Path(__file__).parents[1]
T = 0.001 * np.arange(2000, dtype=np.float64)
POSITION, COMMAND = 0.1 * np.sin(9.0 * T), 0.01 * np.cos(9.0 * T)
LOG = """
import sys, rerun
rerun.init("bench", recording_id="one"); rerun.save(sys.argv[2])
rerun.log_file_from_path(sys.argv[1], entity_path_prefix="arm")
"""


@pytest.fixture(scope="module", autouse=True)
def rerun() -> Any:
    return pytest.importorskip("rerun", reason="rerun-sdk is not installed")


@pytest.fixture
def on_path(tmp_path: Path) -> dict[str, str]:
    """An environment in which the importer stands on PATH as its entry point does."""
    program = tmp_path / "bin" / "rerun-importer-zwidth"
    program.parent.mkdir()
    text = "import sys; from zwidth.rerun_importer import main; sys.exit(main())"
    program.write_text(f"#!{sys.executable}\n{text}\n")
    program.chmod(0o755)
    paths = os.pathsep.join([str(program.parent), os.environ["PATH"]])
    return {**os.environ, "PATH": paths, "PYTHONPATH": str(ROOT)}


def read_back(path: Path) -> dict[str, list[Any]]:
    """What a file of Rerun holds: "ENTITY:COMPONENT" and its time [s], each value in order."""
    found: dict[str, list[Any]] = {}
    reader = "rerun.chunk" if find_spec("rerun.chunk") else "rerun.experimental"  # as it was first
    for chunk in import_module(reader).RrdReader(path).stream():
        batch = chunk.to_record_batch()
        timed = "time" in batch.schema.names
        times = batch.column("time").cast("int64").to_numpy() / 1e9 if timed else []
        for name in batch.schema.names:
            if ":" in name:
                key = f"{chunk.entity_path}:{name.rpartition(':')[2]}"
                found.setdefault(key, []).extend(batch.column(name).flatten().to_pylist())
                found.setdefault(f"{key} at", []).extend(times)
    return found


def test_the_entry_point_is_declared():
    """Rerun finds importers by this name from 0.32 on, and runs one of the old name besides.

    Mutations: a function renamed; an older Rerun allowed; a second script that opens a file twice.
    """
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    scripts = project["scripts"]
    module, _, function = scripts["rerun-importer-zwidth"].partition(":")
    assert callable(getattr(import_module(module), function))
    assert not any(name.startswith("rerun-loader") for name in scripts)
    (needed,) = project["optional-dependencies"]["rerun"]
    _, _, lowest = needed.partition("rerun-sdk>=")
    assert tuple(map(int, lowest.split("."))) >= (0, 32)
    assert f"Rerun {lowest}" in (ROOT / "docs" / "viewers.md").read_text(encoding="utf-8")


def test_rerun_opens_a_recording_of_another_tool(tmp_path: Path, on_path: dict[str, str]):
    """A CSV, which Rerun itself cannot open. Mutation: the prefix that Rerun asks for left out."""
    table = np.column_stack([T, COMMAND, POSITION])
    file = tmp_path / "bench.csv"
    header = "time [s],torque [N m],angle [rad]"
    np.savetxt(file, table, "%.17g", ",", header=header, comments="")
    saved = tmp_path / "bench.rrd"
    line = [sys.executable, "-c", LOG, str(file), str(saved)]
    subprocess.run(line, env=on_path, check=True, timeout=120)
    found = read_back(saved)
    assert np.array_equal(found["/arm/position_m1:scalars"], POSITION)
    assert np.array_equal(found["/arm/command:scalars"], COMMAND)
    assert found["/arm/position_m1:scalars at"] == pytest.approx(T, abs=1e-9)


def test_a_diagnosis_stands_beside_what_was_measured(tmp_path: Path, on_path: dict[str, str]):
    """Mutations: residuals among the motions; texts at time zero."""
    channels = {
        "command": COMMAND, "position_m1": POSITION, "before_free_position_m1": 2.0 * POSITION,
        "found_position_m1": POSITION, "found_residual_position_m1": 0.0 * T,
    }  # fmt: skip
    trace = Trace(T, channels, dict.fromkeys(channels, "rad") | {"command": "N m"}, "recorded")
    log = tmp_path / "bench.diagnosis.mcap"
    said = Annotation(0.5, 1.0, "warning", "mark_1", "a hand", {"effect": "touch"})
    write_log(log, trace, annotations=[said])
    saved = tmp_path / "bench.rrd"
    line = ["rerun-importer-zwidth", str(log), "--application-id", "bench"]
    done = subprocess.run(line, env=on_path, check=True, timeout=120, stdout=subprocess.PIPE)
    saved.write_bytes(done.stdout)
    found = read_back(saved)
    assert np.array_equal(found["/position_m1/measured:scalars"], POSITION)
    assert np.array_equal(found["/position_m1/before_free:scalars"], 2.0 * POSITION)
    assert np.array_equal(found["/position_m1_residual/found:scalars"], 0.0 * T)
    assert found["/annotations:text"] == ["mark_1, 0.5 to 1 s: a hand (effect touch)"]
    assert found["/annotations:text at"] == [0.5]
    assert found["/annotations:level"] == ["WARN"]


def test_a_file_of_others_is_left_to_others(tmp_path: Path, on_path: dict[str, str]):
    """Mutation: an error in place of Rerun's status for a file that is not known."""
    (tmp_path / "notes.txt").write_text("Dear diary\n")
    (tmp_path / "device.toml").write_text('name = "x"\n')
    for name in ("notes.txt", "device.toml", "nothing.csv"):
        done = subprocess.run(
            ["rerun-importer-zwidth", str(tmp_path / name)], env=on_path, check=False,
            timeout=60, capture_output=True,
        )  # fmt: skip
        assert (done.returncode, done.stdout) == (66, b"")

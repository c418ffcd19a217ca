"""The GitHub Action in `action/`: its own steps, run as a runner runs them, without a container."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from test_check import banded, bench, heavier, recorded, write_csv

from zwidth.sim.device_file import save_device
from zwidth.sim.jit import cache_folder

yaml = pytest.importorskip("yaml", reason="PyYAML, which mkdocs brings, is not installed")
ACTION = Path(__file__).parents[1] / "action" / "action.yml"
if not ACTION.is_file():
    pytest.skip("not a clone: the wheel has no action", allow_module_level=True)
if shutil.which("bash") is None:
    pytest.skip("there is no bash", allow_module_level=True)


def _of(known: Mapping[str, str | None]) -> Callable[[re.Match[str]], str]:
    return lambda found: str(known[found.group(1)])


def step(
    name: str, given: dict[str, str], folder: Path, kernels: Path | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a step with these inputs, as a runner does: expressions in `env`, bash -e -o pipefail.

    What is run is the zwidth of these tests, and not another that this Python has installed: its
    kernels would be others. kernels: the folder that the step "Kernels" gives, by default that of
    these tests.
    """
    action: Any = yaml.safe_load(ACTION.read_text())
    inputs = {key: given.get(key, own.get("default", "")) for key, own in action["inputs"].items()}
    (own,) = (s for s in action["runs"]["steps"] if s["name"] == name)
    assert "${{" not in own["run"]  # an input in the text of a script would be run as one
    known = {f"inputs.{k}": v for k, v in inputs.items()} | {
        "github.action_path": str(ACTION.parent),
        "runner.os": "Linux",
        "steps.kernels.outputs.folder": str(kernels or cache_folder().parents[1]),
    }
    env = {
        key: re.sub(r"\$\{\{ *([\w.]+) *\}\}", _of(known), value)
        for key, value in own["env"].items()
    }
    (folder / "temp").mkdir(exist_ok=True)
    (folder / "bin").mkdir(exist_ok=True)
    runner = {
        "RUNNER_TEMP": str(folder / "temp"),
        "GITHUB_OUTPUT": str(folder / "output"),
        "GITHUB_STEP_SUMMARY": str(folder / "summary"),
        "PATH": f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
    }
    return subprocess.run(
        ["bash", "-e", "-o", "pipefail", "-c", own["run"]], cwd=folder, check=False,
        env=os.environ | runner | env, capture_output=True, text=True, timeout=1200,
    )  # fmt: skip


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    """A repository with a device and recordings, and this zwidth as what pip installed."""
    (tmp_path / "bin").mkdir()
    for name, line in (("zwidth", "-m zwidth"), ("python", "")):
        script = tmp_path / "bin" / name
        script.write_text(f'#!/bin/sh\nexec "{sys.executable}" {line} "$@"\n')
        script.chmod(0o755)
    save_device(banded(), tmp_path / "bench.toml")
    (tmp_path / "logs").mkdir()
    write_csv(tmp_path / "logs" / "monday.csv", recorded(bench(), 70))
    write_csv(tmp_path / "logs" / "a b.csv", recorded(bench(), 72))
    return tmp_path


def test_a_true_simulation_passes_and_every_recording_that_a_pattern_names_is_checked(rig: Path):
    """Mutation: `$LOGS` quoted, so that the pattern is a name."""
    done = step("Check", {"device": "bench.toml", "logs": "logs/*.csv"}, rig)
    assert done.returncode == 0, done.stderr
    suite = ElementTree.parse(rig / "zwidth-check.xml").getroot()
    assert sorted(case.attrib["name"] for case in suite) == ["a b.csv", "monday.csv"]
    assert (rig / "output").read_text().startswith("sentence=device 'bench' still describes")
    assert outputs(rig)["status"] == "0"
    assert "still describes all 2 recordings" in (rig / "summary").read_text()


def test_a_machine_that_changed_fails_and_says_how(rig: Path):
    """Mutation: the status of the check lost behind the summary."""
    write_csv(rig / "logs" / "tuesday.csv", recorded(heavier(bench()), 71))
    done = step("Check", {"device": "bench.toml", "logs": "logs/*.csv"}, rig)
    assert done.returncode == 1
    assert outputs(rig)["status"] == "1"
    assert "the inertia m1 +5 %" in (rig / "summary").read_text()


def test_a_check_that_fails_itself_is_no_machine_that_changed(rig: Path):
    """Nor is what fails around it: bash ends with 1 there.

    Mutations: the sentence read from an answer alone; no trap.
    """
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    given = {"device": "bench.toml", "logs": "logs/monday.csv"}
    done = step("Check", given | {"junit": "/dev/full"}, rig)
    assert done.returncode == 3
    assert outputs(rig)["status"] == "3"
    assert "no answer: /dev/full: No space left" in (rig / "summary").read_text()
    (rig / "summary").unlink()
    (rig / "summary").mkdir()
    assert step("Check", given, rig).returncode == 3


def test_bad_input_fails_with_status_2(rig: Path):
    save_device(replace(banded(), band=None), rig / "bare.toml")
    done = step("Check", {"device": "bare.toml", "logs": "logs/monday.csv"}, rig)
    assert done.returncode == 2
    assert outputs(rig)["status"] == "2"
    assert "has no [band]" in done.stderr
    done = step("Check", {"device": "bench.toml", "logs": "none/*.csv"}, rig)
    assert done.returncode == 2
    assert "no recording matches" in done.stderr


def outputs(folder: Path) -> dict[str, str]:
    """What the steps have given so far."""
    lines = (folder / "output").read_text().splitlines()
    return {key: value for key, _, value in (line.partition("=") for line in lines)}


def test_kernels_are_cached_by_system_python_version_and_source(rig: Path):
    """Mutations: the version or the processor left out of the key; another folder cached."""
    action: Any = yaml.safe_load(ACTION.read_text())
    steps = action["runs"]["steps"]
    assert [s["name"] for s in steps] == ["Install", "Kernels", "Cache", "Check"]
    cache = steps[2]
    assert cache["uses"] == "actions/cache@v4"
    assert cache["with"] == {
        "path": "${{ steps.kernels.outputs.folder }}",
        "key": "${{ steps.kernels.outputs.key }}",
    }
    assert steps[3]["env"]["ZWIDTH_CACHE_DIR"] == cache["with"]["path"]
    assert steps[1]["id"] == "kernels"
    done = step("Kernels", {}, rig)
    assert done.returncode == 0, done.stderr
    said = outputs(rig)
    assert said["folder"] == str(rig / "temp" / "zwidth-kernels")
    python = ".".join(map(str, sys.version_info[:3]))
    assert said["key"].startswith(f"zwidth-Linux-{python}-{version('zwidth')}-")
    assert said["key"].endswith(cache_folder().name)


@pytest.mark.truth
def test_the_first_check_compiles_into_the_cached_folder_and_the_second_does_not(rig: Path):
    """Slow: minutes. It runs the simulation's compiler as a runner's first job does."""
    assert step("Kernels", {}, rig).returncode == 0
    folder = Path(outputs(rig)["folder"])
    given = {"device": "bench.toml", "logs": "logs/monday.csv"}
    first = step("Check", given, rig, folder)
    assert first.returncode == 0, first.stderr
    assert "compiling the parts of the simulation that are not in" in first.stderr
    kept = {f: f.stat().st_mtime for f in folder.rglob("*.nbc")}
    assert kept
    again = step("Check", given, rig, folder)
    assert again.returncode == 0, again.stderr
    assert "compiling" not in again.stdout + again.stderr
    assert {f: f.stat().st_mtime for f in folder.rglob("*.nbc")} == kept


def test_an_input_is_never_run_as_a_command(rig: Path):
    given = {"device": "$(touch stolen).toml", "logs": "logs/monday.csv", "joint": "`touch stolen`"}
    assert step("Check", given, rig).returncode == 2
    assert not (rig / "stolen").exists()


@pytest.mark.parametrize(
    ("given", "asked"),
    [
        ({}, [f"{ACTION.parent}/.."]),
        ({"package": "zwidth==1.0.0"}, ["zwidth==1.0.0"]),
        ({"model": "robot.xml"}, [f"{ACTION.parent}/..", "mujoco"]),
    ],
)
def test_the_install_step_asks_pip_for_this_version_and_nothing_else(
    given: dict[str, str], asked: list[str], rig: Path
):
    """With a python in the way that writes down what it is asked."""
    (rig / "bin" / "python").write_text('#!/bin/sh\nprintf "%s\\n" "$@" > asked\n')
    assert step("Install", given, rig).returncode == 0
    assert (rig / "asked").read_text().splitlines() == ["-m", "pip", "install", "--quiet", *asked]

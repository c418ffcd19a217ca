"""What a first diagnosis has compiled beforehand, by two processes at once."""

import subprocess
import sys
from pathlib import Path

import pytest

from zwidth.diagnosis import compiled as first

AT_WORK = """
import numpy as np
from zwidth.diagnosis import compiled
from zwidth.diagnosis.diagnose import diagnose
from zwidth.diagnosis.noise import steady
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.sim import predict
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface

KERNELS = predict.predict, predict.run_freely, steady.held_motion_each

def known():
    return [set(kernel.signatures) for kernel in KERNELS]

for part in compiled.PARTS:
    compiled.run(part)
before = known()
assert all(before), before
random = np.random.default_rng(1)
u = 0.05 * np.convolve(random.standard_normal(1500), np.ones(8) / 8.0, "same")
x, v, y = 0.0, 0.0, np.zeros(1500)
for k in range(1500):
    y[k] = x
    v += 1e-3 * (u[k] - 2e-3 * v - 0.004 * np.tanh(v / 0.01)) / 1e-3
    x += 1e-3 * v
y += 1e-5 * random.standard_normal(1500)
device = Device("one", "", True, make_chain([1e-3], [2e-3], 0.0, [], []), Interface(period=1e-3))
e = Experiment(1e-3, u, y[:, None], (Output("position", 0),), "one", float(y.std()))
found = diagnose(device, [e], effort=QUICK)
assert not found.errors, found.errors
for one, more, kernel in zip(before, known(), KERNELS):
    assert more == one, (kernel.py_func.__name__, more - one)
"""


def test_a_diagnosis_compiles_no_kernel_besides() -> None:
    """Mutation: `run` without the free runs, the many, or their gains."""
    ended = subprocess.run(
        [sys.executable, "-c", AT_WORK], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stderr[-2000:]


class Process:
    """A process that ends with a status, or is interrupted."""

    def __init__(self, status: int | None) -> None:
        self.status, self.killed = status, False

    def wait(self) -> int:
        if self.status is None:
            raise KeyboardInterrupt
        return self.status

    def kill(self) -> None:
        self.killed = True


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[list[str]]:
    """The command lines that are run; the cache is an empty folder."""
    lines: list[list[str]] = []
    monkeypatch.setattr(first, "cache_folder", lambda: tmp_path / "cache")
    monkeypatch.setattr(first.os, "cpu_count", lambda: 2)
    monkeypatch.delenv("NUMBA_DISABLE_JIT", raising=False)

    def popen(line: list[str], **_: object) -> Process:
        lines.append(line)
        return Process(0)

    monkeypatch.setattr(subprocess, "Popen", popen)
    return lines


def test_every_part_is_compiled_once(asked: list[list[str]], tmp_path: Path) -> None:
    """For each place of zwidth. Mutations: no mark; a mark that holds for every place."""
    first.compiled()
    assert [line[-1] for line in asked] == list(first.PARTS)
    first.compiled()
    assert len(asked) == len(first.PARTS)
    mark = tmp_path / "cache" / first.DONE
    assert mark.read_text() == f"{first.HERE}\n"
    mark.write_text("/another/zwidth/diagnosis/compiled.py\n")
    first.compiled()
    assert len(asked) == 2 * len(first.PARTS)
    assert len(mark.read_text().splitlines()) == 2


def test_a_part_that_fails_is_compiled_when_it_is_needed(
    asked: list[list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And is tried again by the next diagnosis. Mutation: the mark is set anyway."""
    monkeypatch.setattr(subprocess, "Popen", lambda *_, **__: Process(1))
    first.compiled()
    assert not (tmp_path / "cache" / first.DONE).exists()


def test_an_interruption_leaves_no_process_behind(
    asked: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Mutation: nothing is killed."""
    made: list[Process] = []

    def popen(*_: object, **__: object) -> Process:
        made.append(Process(None))
        return made[-1]

    monkeypatch.setattr(subprocess, "Popen", popen)
    with pytest.raises(KeyboardInterrupt):
        first.compiled()
    assert [one.killed for one in made] == [True, True]


@pytest.mark.parametrize("why", ["one core", "interpreted", "no folder"])
def test_it_is_left_out(
    why: str, asked: list[list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where a second process gains nothing, or could hand nothing over."""
    if why == "one core":
        monkeypatch.setattr(first.os, "cpu_count", lambda: 1)
    elif why == "interpreted":
        monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    else:
        (tmp_path / "cache").write_text("a file in the place of the folder")
    first.compiled()
    assert asked == []

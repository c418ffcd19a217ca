"""Maps on a Dask cluster: the same bits as here, whoever dies on the way."""

import errno
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from executor_examples import die, refuse, square
from map_examples import COARSE, LEVELS, plane, same

from zwidth.cli import run
from zwidth.jobs import cluster, store
from zwidth.jobs.cluster import Cluster
from zwidth.jobs.only_driver import only_driver
from zwidth.stability import fate_map
from zwidth.stability.fate_map import FateMap, make_map

distributed = pytest.importorskip("distributed", reason="the extra zwidth[cluster] is missing")
QUIET = {
    "host": "127.0.0.1", "dashboard_address": "127.0.0.1:0", "worker_dashboard_address": None,
    "scheduler_kwargs": {"dashboard": False},
}  # fmt: skip
ROOT = Path(__file__).parents[1]
PATIENCE = 300.0  # [s] for workers that start again on a busy machine
MAP = ["map", "phantom_1_0", "--encoder-step", "1e-4", "--seconds", "0.5", "--levels", "0"]


posix = pytest.mark.skipif(os.name != "posix", reason="kill -9 is POSIX")


@pytest.fixture(autouse=True)
def small_and_impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fate_map, "CHUNK", 4)
    monkeypatch.setattr(cluster, "ANSWER_WITHIN", 300.0)
    monkeypatch.setattr(cluster, "LOOK_EVERY", 0.1)


@pytest.fixture(scope="module")
def two() -> Iterator[Any]:
    """A cluster of two processes on this machine."""
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, **QUIET) as found:
        yield found


def in_this_process() -> Any:
    """A cluster of one thread."""
    return distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, protocol="tcp", **QUIET
    )


@pytest.fixture(scope="module")
def whole() -> FateMap:
    """The map made here at one go."""
    return make_map(plane(), COARSE, LEVELS)


def parts(folder: Path) -> dict[Path, int]:
    """When each part was written."""
    return {p: p.stat().st_mtime_ns for p in folder.glob("part-*.npz")}


class Interference:
    """Does something once, after a number of progress reports; keeps what was there before."""

    def __init__(self, folder: Path, deed: Callable[[], None], after: int = 3) -> None:
        self.folder, self.deed, self.after = folder, deed, after
        self.before: dict[Path, int] = {}

    def __call__(self, share: float, runs: int) -> None:
        self.after -= 1
        if self.after == 0:
            self.before = parts(self.folder)
            self.deed()


@posix
def test_a_worker_killed_on_the_way_costs_its_part_only(
    tmp_path: Path, two: Any, whole: FateMap
) -> None:
    """Same result, bit for bit; nothing that was kept is written again.

    Mutation: results paired with the parts in the order of the tasks.
    """
    victim = two.workers[0].pid
    kill = Interference(tmp_path, lambda: os.kill(victim, signal.SIGKILL))
    with Cluster(two.scheduler_address, PATIENCE) as runner:
        assert runner.cores == 2
        found = make_map(plane(), COARSE, LEVELS, tmp_path, kill, runner=runner)
    assert same(found, whole)
    assert two.workers[0].pid != victim, "nobody died"
    assert kill.before
    assert kill.before.items() <= parts(tmp_path).items()
    assert same(make_map(plane(), COARSE, LEVELS, tmp_path), whole)
    assert kill.before.items() <= parts(tmp_path).items()


def test_the_command_runs_on_a_cluster(
    tmp_path: Path, two: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    """The same file, byte for byte, and the parts are those that a rerun here takes up."""
    for name, more in (("far", ["--cluster", two.scheduler_address]), ("near", [])):
        assert run([*MAP, "--coarse", "9", "--out", str(tmp_path / name), *more]) == 0
    far, near = ((tmp_path / name / "map.nc").read_bytes() for name in ("far", "near"))
    assert far == near
    assert "error" not in capsys.readouterr().err


def test_a_full_disk_at_the_driver_keeps_what_was_finished(
    tmp_path: Path, two: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One sentence, status 1; with room again only what is missing is run."""
    arguments = [*MAP, "--coarse", "9", "--out", str(tmp_path)]
    arguments += ["--cluster", two.scheduler_address]
    written: list[Path] = []

    def full_after_five(file: Path, content: bytes, **options: bool) -> None:
        written.append(file)
        if len(written) > 5:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(file))
        whole_file(file, content, **options)

    whole_file = store.write_bytes
    with monkeypatch.context() as patch:
        patch.setattr(store, "write_bytes", full_after_five)
        assert run(arguments) == 1
    error = capsys.readouterr().err.strip()
    assert "No space left on device; what is finished is kept, make room" in error
    assert len(error.splitlines()) == 1
    kept = parts(tmp_path / "parts")
    assert len(kept) == 4  # and plane.json
    assert run(arguments) == 0
    assert kept.items() <= parts(tmp_path / "parts").items()


def test_a_second_driver_on_the_same_output_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One sentence; the first one is not disturbed, and killed it lets go of the folder.

    Mutation: `make_map` without `only_driver`.
    """
    code = (
        "import sys; from pathlib import Path; from zwidth.jobs.only_driver import only_driver\n"
        "with only_driver(Path(sys.argv[1])): print('held', flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "parts")]
    with subprocess.Popen(
        command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as first:
        assert first.stdout is not None
        assert first.stdout.readline() == "held\n"
        assert run([*MAP, "--coarse", "3", "--out", str(tmp_path)]) == 2
        error = capsys.readouterr().err.strip()
        assert "another program is filling" in error
        assert len(error.splitlines()) == 1
        assert not list((tmp_path / "parts").glob("part*"))
        first.kill()
    with only_driver(tmp_path / "parts"):
        pass


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def start(port: int, workers: int) -> list[subprocess.Popen[bytes]]:
    """Start a scheduler and its workers as an administrator does."""
    local = ["--host", "127.0.0.1", "--no-dashboard"]
    commands: list[Sequence[str]] = [["dask_scheduler", "--port", str(port), *local]]
    worker = ["dask_worker", f"tcp://127.0.0.1:{port}", *local, "--no-nanny", "--nthreads", "1"]
    commands += [worker] * workers
    return [
        subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.{name}", *rest],
            cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )
        for name, *rest in commands
    ]  # fmt: skip


def stop(processes: list[subprocess.Popen[bytes]]) -> None:
    """Kill processes, as a power cut does."""
    for process in processes:
        process.kill()
        process.wait()


def test_a_scheduler_that_is_restarted_costs_what_was_in_work(
    tmp_path: Path, whole: FateMap
) -> None:
    """Killed with its workers and started anew at the same address: the run goes on by itself.

    Mutation: `run` without `_reconnect`.
    """
    port = free_port()
    processes = start(port, 1)

    def restart() -> None:
        stop(processes)
        processes[:] = start(port, 1)

    interference = Interference(tmp_path, restart)
    try:
        with Cluster(f"tcp://127.0.0.1:{port}") as runner:
            found = make_map(plane(), COARSE, LEVELS, tmp_path, interference, runner=runner)
    finally:
        stop(processes)
    assert same(found, whole)
    assert interference.before
    assert interference.before.items() <= parts(tmp_path).items()


def test_a_scheduler_that_does_not_come_back_is_one_sentence(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """What came back is kept, and Dask's own tracebacks are not shown.

    Mutation: "distributed.client" left out of `NOISY`.
    """
    with in_this_process() as one:
        end = Interference(tmp_path, one.close)
        with (
            Cluster(one.scheduler_address, patience=0.5) as runner,
            pytest.raises(
                OSError, match=r"has not answered for 0\.5 s; finished parts are kept: start it"
            ),
        ):
            make_map(plane(), COARSE, LEVELS, tmp_path, end, runner=runner)
    assert end.before
    assert end.before.items() <= parts(tmp_path).items()
    assert [r.getMessage() for r in caplog.records if r.name == "distributed.client"] == []


def test_workers_that_all_leave_are_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with in_this_process() as one:
        leave = Interference(tmp_path, lambda: one.scale(0))
        with (
            Cluster(one.scheduler_address, patience=0.5) as runner,
            pytest.raises(OSError, match=r"all workers of tcp://.* have been gone for 0\.5 s"),
        ):
            make_map(plane(), COARSE, LEVELS, tmp_path, leave, runner=runner)
        monkeypatch.setattr(cluster, "ANSWER_WITHIN", 1.0)
        with pytest.raises(ValueError, match="has no workers; start some"):
            Cluster(one.scheduler_address).__enter__()


def test_what_a_task_raises_is_raised_here(two: Any) -> None:
    """Also an OSError, which is no lost scheduler; and the next run is not disturbed by it."""
    tasks = {str(i): i for i in range(8)}
    with Cluster(two.scheduler_address, PATIENCE) as runner:
        with pytest.raises(FileNotFoundError, match="no file for 3"):
            list(runner.run(refuse, tasks))
        found = dict(runner.run(square, tasks))
    assert {key: result for key, (result, _) in found.items()} == {str(i): i * i for i in range(8)}


@posix
def test_a_task_that_kills_every_worker_is_named() -> None:
    """On four of its own: one that dies while it starts again is not always started once more."""
    says = "4 workers died while computing 'a'; they may need more memory"
    with (
        distributed.LocalCluster(n_workers=4, threads_per_worker=1, **QUIET) as four,
        Cluster(four.scheduler_address, PATIENCE) as runner,
        pytest.raises(ChildProcessError, match=says),
    ):
        list(runner.run(die, {"a": 0}))


def test_workers_with_other_code_are_refused(two: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutation: digests not compared."""
    monkeypatch.setattr(cluster, "code_digest", lambda _: "other")
    says = r"runs different code from this program .*, not other"
    with Cluster(two.scheduler_address, PATIENCE) as runner, pytest.raises(ValueError, match=says):
        list(runner.run(square, {"a": 1}))


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense://x", "no/such/file.json", ""])
def test_an_address_where_no_scheduler_is(
    address: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Status 2, one sentence, nothing written."""
    monkeypatch.setattr(cluster, "ANSWER_WITHIN", 1.0)
    out = tmp_path / "out"
    assert run([*MAP, "--coarse", "3", "--out", str(out), "--cluster", address]) == 2
    error = capsys.readouterr().err.strip()
    assert "does not answer as a scheduler; see docs/scale.md" in error
    assert len(error.splitlines()) == 1
    assert not out.exists()

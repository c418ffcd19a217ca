"""Tasks here and in processes of their own: each comes back once, whatever dies on the way."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from executor_examples import die, die_once, refuse, square, threads_allowed

from zwidth.jobs.choose import executor
from zwidth.jobs.executor import Executor, Local, Processes

TASKS = {f"task-{i}": i for i in range(12)}
posix = pytest.mark.skipif(os.name != "posix", reason="kill -9 is POSIX")


@pytest.mark.parametrize("runner", [Local(), Processes(2)])
def test_every_key_comes_back_once_with_its_own_result(runner: Executor) -> None:
    """Mutation: results paired with the keys in the order of the tasks (`zip`)."""
    found = list(runner.run(square, TASKS))
    assert sorted(key for key, _ in found) == sorted(TASKS)
    assert {key: result for key, (result, _) in found} == {k: i * i for k, i in TASKS.items()}
    here = {pid for _, (_, pid) in found} == {os.getpid()}
    assert here == isinstance(runner, Local)


@pytest.mark.parametrize("runner", [Local(), Processes(2)])
def test_what_a_task_raises_is_raised_here(runner: Executor) -> None:
    """Also an OSError, which is no lost worker."""
    with pytest.raises(FileNotFoundError, match="no file for 3"):
        list(runner.run(refuse, TASKS))


def test_no_tasks_are_no_work() -> None:
    assert list(Processes(2).run(square, {})) == []


def test_processes_take_a_thread_each() -> None:
    """Mutation: the pool without `_as_worker`."""
    assert dict(Processes(1).run(threads_allowed, {"a": 0})) == {"a": "1"}


@posix
def test_a_process_that_dies_costs_what_was_in_work(tmp_path: Path) -> None:
    """Mutation: `left` not reduced, so that everything is run and yielded again."""
    tasks = {f"task-{i}": (i, str(tmp_path)) for i in range(12)}
    found = list(Processes(2).run(die_once, tasks))
    assert (tmp_path / "died").exists()
    assert sorted(found) == sorted((f"task-{i}", i * i) for i in range(12))


@posix
def test_a_task_that_kills_every_process_is_named() -> None:
    """Mutation: losses borne without end."""
    with pytest.raises(ChildProcessError, match="processes died 4 times while computing 'a'"):
        list(Processes(1).run(die, {"a": 0}))


@posix
def test_workers_end_with_a_process_that_is_killed(tmp_path: Path) -> None:
    """Which can end nobody itself. Mutation: `_end_with_parent` does nothing."""
    beats = tmp_path / "beats"
    script = (
        "from executor_examples import beat\n"
        "from zwidth.jobs.executor import Processes\n"
        "if __name__ == '__main__':\n"
        f"    list(Processes(1).run(beat, {{'a': {str(beats)!r}}}))\n"
    )
    (tmp_path / "main.py").write_text(script)
    where = os.pathsep.join([str(Path(__file__).parent), *filter(None, sys.path)])
    line = [sys.executable, str(tmp_path / "main.py")]
    parent = subprocess.Popen(line, env={**os.environ, "PYTHONPATH": where})
    until = time.monotonic() + 120.0
    while not beats.exists():
        assert time.monotonic() < until
        time.sleep(0.05)
    parent.kill()
    parent.wait()
    before, now = -1, beats.stat().st_size
    while now > before:  # a beat is 20 ms; a minute of them is what the worker has to go
        time.sleep(2.0)
        before, now = now, beats.stat().st_size
    assert now < 1500


def test_choices_that_exclude_each_other_are_refused() -> None:
    with pytest.raises(ValueError, match="processes and a cluster are given; give only one"):
        executor("tcp://127.0.0.1:1", 2)
    with pytest.raises(ValueError, match="processes is 0; it must be a whole number of 1 or more"):
        executor(processes=0)


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ValueError, match=r"needs the package distributed; pip install 'zwidth"):
        executor("tcp://127.0.0.1:1").__enter__()

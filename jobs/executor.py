"""Where many independent tasks run: in this process, in several, or on a cluster (`cluster.py`).

A task is a key and a value. The function gives the same result for a value wherever and however
often it runs, so only tasks whose worker was lost are run again, and each key is returned once. A
caller that keeps results by their keys continues from there the next time.
"""

import errno
import os
import signal
from collections.abc import Callable, Generator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from multiprocessing import get_context, parent_process
from threading import Thread
from typing import Protocol, TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")
AHEAD = 4  # tasks a core that wait for it, so that it never waits for one
PATIENCE = 3  # losses of workers in a row, with nothing finished between, that are borne


class Executor(Protocol):
    """What runs tasks. Opened by `executor`, closed with its `with` block."""

    @property
    def cores(self) -> int:
        """How many tasks run side by side."""
        ...

    def run(
        self, function: Callable[[Task], Result], tasks: Mapping[str, Task]
    ) -> Generator[tuple[str, Result]]:
        """Yield (key, function(task)) of every task once, in the order in which they finish.

        function, tasks and results can be pickled. An exception in `function` is raised here, and
        no further tasks are started; closing the generator stops it in the same way. Raises OSError
        where all workers are lost for good.
        """
        ...


class Local:
    """One task after another in this process; a task takes all threads (`jobs.parallel`)."""

    cores = 1

    def run(
        self, function: Callable[[Task], Result], tasks: Mapping[str, Task]
    ) -> Generator[tuple[str, Result]]:
        """Yield (key, function(task)) in the order of the tasks."""
        for key, task in tasks.items():
            yield key, function(task)


class Processes:
    """Tasks in processes of their own on this machine, one thread each: for work in Python.

    If a process dies, the tasks of the other processes are lost, too, at most one per core; they
    are run again. Raises ValueError for a count below 1.
    """

    def __init__(self, count: int) -> None:
        if count < 1:
            raise ValueError(f"{count} processes cannot work; give a whole number from 1 on")
        self.cores = count

    def run(
        self, function: Callable[[Task], Result], tasks: Mapping[str, Task]
    ) -> Generator[tuple[str, Result]]:
        """Yield (key, function(task)) as they finish; raises OSError (see `Executor.run`)."""
        left, losses = dict(tasks), 0
        while left:
            try:
                for key, result in self._in_one_pool(function, dict(left)):
                    del left[key]
                    losses = 0
                    yield key, result
            except BrokenProcessPool:
                losses += 1
                if losses > PATIENCE:
                    raise ChildProcessError(
                        errno.ECHILD,
                        f"processes died {losses} times while computing {next(iter(left))!r} and"
                        " its neighbours; check the memory that they need, or use fewer processes",
                    ) from None

    def _in_one_pool(
        self, function: Callable[[Task], Result], tasks: Mapping[str, Task]
    ) -> Generator[tuple[str, Result]]:
        waiting = iter(tasks.items())
        spawn = get_context(
            "spawn"
        )  # a fork would take along locks that its threads do not release
        pool = ProcessPoolExecutor(self.cores, spawn, _as_worker)
        flying: dict[Future[Result], str] = {}
        try:
            while True:
                for key, task in islice(waiting, AHEAD * self.cores - len(flying)):
                    flying[pool.submit(function, task)] = key
                if not flying:
                    return
                for future in wait(flying, return_when=FIRST_COMPLETED).done:
                    yield flying.pop(future), future.result()
        finally:
            pool.shutdown(cancel_futures=True)


def _as_worker() -> None:
    os.environ["ZWIDTH_THREADS"] = "1"
    for ends in (signal.SIGINT, signal.SIGTERM):  # Ctrl-C reaches all: end at once, say nothing
        signal.signal(ends, signal.SIG_DFL)
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process when the one that began it has gone: killed, it ends nobody itself.

    A task may have an hour to go, and nobody would read its result.
    """
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)

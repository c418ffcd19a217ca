"""Executors of many independent tasks: this process, several, or a cluster (`cluster.py`).

A task is a key and a value. The function gives the same result for a value on every run and
machine, so a task is run again only if its worker was lost, and each key is returned once. A caller
that stores results by their keys can continue from them.
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
AHEAD = 4  # waiting tasks per core, so that no core is idle
PATIENCE = 3  # tolerated losses of workers in a row with nothing finished between them


class Executor(Protocol):
    """Runs tasks. Opened by `executor`, closed at the end of its `with` block."""

    @property
    def cores(self) -> int:
        """How many tasks run side by side."""
        ...

    def run(
        self, function: Callable[[Task], Result], tasks: Mapping[str, Task]
    ) -> Generator[tuple[str, Result]]:
        """Yield (key, function(task)) once per task, in the order in which they finish.

        function, tasks and results must be picklable. An exception in `function` is raised here,
        and no further tasks are started; closing the generator also starts no more. Raises OSError
        if all workers are lost for good.
        """
        ...


class Local:
    """Tasks one after another in this process; each uses all threads (`jobs.parallel`)."""

    cores = 1

    def run(
        self, function: Callable[[Task], Result], tasks: Mapping[str, Task]
    ) -> Generator[tuple[str, Result]]:
        """Yield (key, function(task)) in the order of the tasks."""
        for key, task in tasks.items():
            yield key, function(task)


class Processes:
    """Tasks in separate processes on this machine, one thread each: for work in Python.

    If a process dies, the other processes' running tasks are lost too, at most one per core; all
    these are run again. Raises ValueError for a count below 1.
    """

    def __init__(self, count: int) -> None:
        if count < 1:
            raise ValueError(f"processes is {count}; it must be a whole number of 1 or more")
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
                        f"worker processes died {losses} times while computing {next(iter(left))!r}"
                        " and tasks beside it; they may need more memory: use fewer processes",
                    ) from None

    def _in_one_pool(
        self, function: Callable[[Task], Result], tasks: Mapping[str, Task]
    ) -> Generator[tuple[str, Result]]:
        waiting = iter(tasks.items())
        spawn = get_context(
            "spawn"
        )  # a fork would copy locks without the threads that release them
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
    for ends in (signal.SIGINT, signal.SIGTERM):  # Ctrl-C reaches all: end silently
        signal.signal(ends, signal.SIG_DFL)
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process when its parent is gone: a killed parent cannot end its children.

    Otherwise a task might run on for an hour, and nobody would read its result.
    """
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)

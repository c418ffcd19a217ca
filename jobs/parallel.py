"""Tasks on the threads of this process, for kernels that release the interpreter's lock."""

import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from functools import cache
from typing import TypeVar

Result = TypeVar("Result")
MOST = 1024  # threads, far more than are ever needed at once


def threads() -> int:
    """Return the number of threads for batches: ZWIDTH_THREADS, else all cores.

    Raises ValueError if ZWIDTH_THREADS is not a whole number from 1 on.
    """
    wanted = os.environ.get("ZWIDTH_THREADS")
    if not wanted:
        return os.cpu_count() or 1
    if not wanted.isdecimal() or int(wanted) < 1:
        raise ValueError(f"ZWIDTH_THREADS is {wanted!r}; it must be a whole number of 1 or more")
    return int(wanted)


def in_parallel(tasks: Sequence[Callable[[], Result]], workers: int) -> list[Result]:
    """Run tasks on threads (kernels release the interpreter's lock); results in task order.

    Each task sees the context variables of the caller. The calling thread works too, so tasks may
    themselves call `in_parallel` without waiting for a task that no thread has started. After a
    failure no further task is started, and the exception of the first failed task is raised.
    """
    if workers == 1 or len(tasks) <= 1:
        return [task() for task in tasks]
    open_tasks, over = iter(range(len(tasks))), threading.Event()
    found: dict[int, Result] = {}
    broken: dict[int, BaseException] = {}
    lock = threading.Lock()

    def work() -> None:
        while not over.is_set():
            with lock:
                i = next(open_tasks, None)
            if i is None:
                return
            try:
                found[i] = copy_context().run(tasks[i])
            except BaseException as error:
                broken[i] = error
                over.set()

    helpers = [
        _pool().submit(copy_context().run, work) for _ in range(min(workers, len(tasks)) - 1)
    ]
    try:
        work()
        for helper in helpers:
            if not helper.cancel():
                helper.result()
    finally:
        over.set()  # also after an interrupt, no more tasks are started
    if broken:
        raise broken[min(broken)]
    return [found[i] for i in range(len(tasks))]


@cache
def _pool() -> ThreadPoolExecutor:
    """Return the process-wide pool, which starts a thread if none is idle."""
    return ThreadPoolExecutor(MOST, thread_name_prefix="zwidth")


if hasattr(os, "register_at_fork"):  # a forked process does not have its parent's threads
    os.register_at_fork(after_in_child=_pool.cache_clear)

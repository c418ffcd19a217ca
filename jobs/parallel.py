"""Tasks on the threads of this process, for kernels that release the interpreter's lock."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from typing import TypeVar

Result = TypeVar("Result")


def threads() -> int:
    """Return the number of threads for batches: ZWIDTH_THREADS, else all cores.

    Raises ValueError where ZWIDTH_THREADS is no whole number from 1 on.
    """
    wanted = os.environ.get("ZWIDTH_THREADS")
    if not wanted:
        return os.cpu_count() or 1
    if not wanted.isdecimal() or int(wanted) < 1:
        raise ValueError(f"ZWIDTH_THREADS is {wanted!r}; a whole number from 1 on is needed")
    return int(wanted)


def in_parallel(tasks: Sequence[Callable[[], Result]], workers: int) -> list[Result]:
    """Run tasks on threads (kernels release the interpreter's lock); results in task order.

    Each sees the context variables of the caller.
    """
    if workers == 1 or len(tasks) == 1:
        return [task() for task in tasks]
    with ThreadPoolExecutor(workers) as pool:
        futures = [pool.submit(copy_context().run, task) for task in tasks]
        try:
            return [future.result() for future in futures]
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise

"""Tasks on many machines, by Dask (`pip install 'zwidth[cluster]'`).

If a worker dies, Dask gives its task to another worker. In addition, results that a restarted
scheduler has forgotten are requested again; workers with other code than the driver's are refused,
since their results would differ; and only as many tasks are submitted as keep all cores busy.
"""

import errno
import logging
import os
import platform
import queue
import time
from collections.abc import Callable, Generator, Mapping
from concurrent.futures import CancelledError
from contextlib import suppress
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from uuid import uuid4

from zwidth.files.protection import reading
from zwidth.jobs.digest import code_digest
from zwidth.jobs.executor import AHEAD

if TYPE_CHECKING:
    from distributed import Client, Future

Task = TypeVar("Task")
Result = TypeVar("Result")
NOISY = ("distributed", "distributed.client", "tornado.application")
PROCESS = uuid4().hex  # identifies this process; a worker has another identifier
LOOK_EVERY = 0.5  # [s] between checks for lost workers and a lost scheduler
ANSWER_WITHIN = 10.0  # [s] to wait for a scheduler and its first worker when connecting


def _work(function: Callable[[Task], Result], wanted: str, driver: str, task: Task) -> Result:
    """Run one task on the worker."""
    if driver != PROCESS:
        os.environ["ZWIDTH_THREADS"] = "1"  # one task per core
    found = code_digest(function)
    if found != wanted:
        raise ValueError(
            f"the worker on {platform.node()} runs different code from this program ({found}, not"
            f" {wanted}); install the same zwidth, numpy, scipy, numba and Python there"
        )
    return function(task)


class Cluster:
    """The workers of a Dask scheduler, as a context manager; see `jobs.executor.Executor`.

    address: tcp://host:8786, or the JSON file to which the scheduler wrote it. patience [s]: how
    long a scheduler or the last worker may be away before the run ends with OSError. Entering
    raises ValueError if the package is missing, no scheduler answers or there is no worker.
    """

    def __init__(self, address: str, patience: float = 60.0) -> None:
        self.address = address
        self.patience = patience
        self._client: Client | None = None

    def __enter__(self) -> "Cluster":
        try:
            import distributed  # noqa: F401  # pyright: ignore[reportUnusedImport]
        except ModuleNotFoundError:
            raise ValueError(
                "a cluster needs the package distributed; pip install 'zwidth[cluster]'"
            ) from None
        for name in NOISY:  # our own messages contain the important parts
            logging.getLogger(name).setLevel(logging.CRITICAL)
        file = self.address.endswith(".json")
        try:
            if not self.address or (file and not reading(Path(self.address)).is_file()):
                raise ValueError(self.address)
            self._client = self._connect(ANSWER_WITHIN)
            self._client.wait_for_workers(1, timeout=ANSWER_WITHIN)
        except (OSError, ValueError, TypeError, TimeoutError) as error:
            found = self._client is not None
            self.__exit__()
            what = "has no workers; start some" if found else "does not answer as a scheduler"
            raise ValueError(
                f"{self.address!r} {what}; see docs/scale.md for how to start a cluster"
            ) from error
        return self

    def __exit__(self, *_: object) -> None:
        client, self._client = self._client, None
        if client is not None:
            with suppress(Exception):  # the scheduler may be gone; results are here already
                client.close()

    @property
    def cores(self) -> int:
        """How many tasks run side by side: the present number of threads of all workers."""
        return max(1, _cores(self._opened()))

    def run(
        self, function: Callable[[Task], Result], tasks: Mapping[str, Task]
    ) -> Generator[tuple[str, Result]]:
        """Yield (key, function(task)) as they finish; raises OSError (see `Executor.run`)."""
        left = dict(tasks)
        work = partial(_work, function, code_digest(function), PROCESS)
        while left:
            yield from self._until_lost(work, left)
            if left:
                self._reconnect()

    def _until_lost(
        self, work: Callable[[Any], Any], left: dict[str, Any]
    ) -> Generator[tuple[str, Any]]:
        """Take tasks off `left` as they finish, until none is left or the scheduler lost them."""
        from distributed import KilledWorker

        client, mark = self._opened(), uuid4().hex
        waiting = iter(list(left.items()))
        finished: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
        flying: dict[Future[Any], str] = {}
        watch = _Watch(client, self.address, self.patience)
        try:
            while watch.scheduler_knows(flying):
                for key, task in islice(waiting, max(0, AHEAD * watch.cores - len(flying))):
                    future = client.submit(work, task, key=f"{key}+{mark}", pure=False)
                    flying[future] = key
                    future.add_done_callback(finished.put)
                if not flying:
                    return
                try:
                    future = finished.get(timeout=LOOK_EVERY)
                except queue.Empty:
                    continue
                if future.status == "error":
                    failure: Any = future.exception(self.patience)
                    raise failure
                try:
                    result = future.result(self.patience)
                except TimeoutError:  # finished, but lost with the last worker
                    finished.put(future)
                    continue
                except (CancelledError, OSError):
                    return
                key = flying.pop(future)
                del left[key]
                yield key, result
        except KilledWorker as error:
            raise ChildProcessError(
                errno.ECHILD,
                f"{error.allowed_failures + 1} workers died while computing"
                f" {str(error.task).split('+')[0]!r}; they may need more memory; finished parts are"
                " kept",
            ) from None
        finally:
            with suppress(Exception):  # the scheduler may be gone, and with it the tasks to cancel
                client.cancel(list(flying), force=True)

    def _opened(self) -> "Client":
        if self._client is None:
            raise RuntimeError("a Cluster runs tasks inside its `with` block")
        return self._client

    def _connect(self, seconds: float) -> "Client":
        from distributed import Client

        if self.address.endswith(".json"):
            return Client(scheduler_file=self.address, timeout=seconds, set_as_default=False)
        return Client(self.address, timeout=seconds, set_as_default=False)

    def _reconnect(self) -> None:
        """Wait for the scheduler to come back; raises OSError when patience is at its end."""
        end = time.monotonic() + self.patience
        self.__exit__()
        while self._client is None:
            try:
                self._client = self._connect(min(5.0, self.patience))
            except (OSError, ValueError):
                if time.monotonic() > end:
                    raise ConnectionResetError(
                        errno.ECONNRESET,
                        f"the scheduler {self.address} has not answered for {self.patience:g} s;"
                        " finished"
                        " parts are kept: start it and give the same command again",
                    ) from None
                time.sleep(LOOK_EVERY)


def _cores(client: "Client") -> int:
    threads: Any = client.nthreads()  # a coroutine only in an asynchronous client
    return sum(threads.values())


class _Watch:
    """Periodic check that scheduler and workers are present, and count of cores."""

    def __init__(self, client: "Client", address: str, patience: float) -> None:
        self.client, self.address, self.patience = client, address, patience
        self.cores = 1
        self.seen = time.monotonic()
        self.next = 0.0

    def scheduler_knows(self, flying: "Mapping[Future[Any], str]") -> bool:
        """Whether the scheduler still has the running tasks; raises OSError if all workers left."""
        now = time.monotonic()
        if now < self.next:
            return True
        self.next = now + LOOK_EVERY
        if self.client.status != "running" or any(future.cancelled() for future in flying):
            return False
        try:
            cores = _cores(self.client)
        except OSError:
            return False
        if cores:
            self.cores, self.seen = cores, now
        elif now - self.seen > self.patience:
            raise ConnectionResetError(
                errno.ECONNRESET,
                f"all workers of {self.address} have been gone for {self.patience:g} s; finished"
                " parts"
                " are kept: start workers and give the same command again",
            )
        return True

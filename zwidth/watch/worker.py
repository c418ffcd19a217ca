"""Background work for the loop that follows a log: a process that does one task at a time."""

import os
import signal
from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, NamedTuple, Protocol

from zwidth.heartbeat import HEART
from zwidth.sim.compiling import watched


class _Compiles(NamedTuple):
    """Whether the process of a worker begins to compile kernels, or has ended."""

    begins: bool


class Works(Protocol):
    """Runs one task at a time beside its caller; `busy` until `take` returns the result."""

    busy: bool

    def give(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Start a task."""
        ...

    def take(self) -> Any:
        """Return a finished result, None if there is none; raises the error of the task."""
        ...


class Worker:
    """A separate process, so that a fit does not delay the gate.

    `give` it a task while it is not `busy`, and `take` the result.
    """

    def __init__(self, nice: int = 0) -> None:
        """Start it; nice: its niceness, on systems that have one."""
        spawn = get_context("spawn")  # a fork would copy locks that no thread releases
        self._here, there = spawn.Pipe()
        self._process = spawn.Process(target=_work, args=(there, nice), daemon=True)
        self._process.start()
        there.close()
        self.busy = False

    def give(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Start a task; function, arguments and result can be pickled."""
        self._here.send((function, arguments))
        self.busy = True

    def take(self) -> Any:
        """Return a finished result, None if there is none; raises the error of the task.

        Raises OSError if the process died.
        """
        if not self.busy or not self._here.poll():
            return None
        try:
            result = self._here.recv()
        except EOFError:
            self.busy = False
            raise ChildProcessError(
                "the process of the fit died; it may need more memory"
            ) from None
        if isinstance(result, _Compiles):
            HEART.compiles(result.begins)
            return None
        self.busy = False
        if isinstance(result, BaseException):
            raise result
        return result

    def close(self) -> None:
        """End the process, whatever it is doing."""
        self._process.kill()
        self._process.join()
        self._here.close()


def _work(orders: Connection, nice: int) -> None:
    if nice and hasattr(os, "nice"):
        os.nice(nice)
    os.environ["ZWIDTH_THREADS"] = "1"
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all: the caller ends this process
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    with watched(lambda begins: orders.send(_Compiles(begins))):
        _obey(orders)


def _obey(orders: Connection) -> None:
    while True:
        try:
            function, arguments = orders.recv()
        except (EOFError, OSError):  # the calling process has ended
            return
        try:
            result = function(*arguments)
        except ValueError as error:
            result = ValueError(str(error))
        except Exception as error:  # an error that cannot be sent would end the process
            result = RuntimeError(f"{type(error).__name__}: {error}")
        try:
            orders.send(result)
        except (BrokenPipeError, ConnectionResetError):
            return

"""Whether kernels are being compiled right now, for displays of progress.

Progress may be shown before numba is loaded, so this does not load it: numba reports to a listener
in `sim/jit.py`, which calls `tell`.
"""

from collections.abc import Callable, Generator
from contextlib import contextmanager

Watcher = Callable[[bool], object]
"""Takes True when compiling begins, and False when it has ended, on the thread that compiles."""

_watchers: list[Watcher] = []


@contextmanager
def watched(by: Watcher) -> Generator[None]:
    """Call a watcher when compiling begins and ends within the block."""
    _watchers.append(by)
    try:
        yield
    finally:
        _watchers.remove(by)


def tell(begins: bool) -> None:
    """Tell every watcher that compiling begins or has ended."""
    for watcher in tuple(_watchers):
        watcher(begins)

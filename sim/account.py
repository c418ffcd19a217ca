"""A count of the kernel's calls, which measures the cost of a computation.

A member-tick is one tick of one device. To count, set `BOOK`; calls on other threads count too,
since `jobs.parallel` passes the context on.
"""

import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from contextvars import ContextVar

Book = Callable[[int, int, float], None]
"""Takes members, ticks and CPU seconds of a call."""

BOOK: ContextVar[Book | None] = ContextVar("book", default=None)


@contextmanager
def counted(members: int, ticks: int) -> Generator[None]:
    """Count a call of the kernel for a number of members over a number of ticks."""
    book = BOOK.get()
    if book is None:
        yield
        return
    begun = time.thread_time()
    yield
    book(members, ticks, time.thread_time() - begun)

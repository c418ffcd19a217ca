"""Background work of a page: only the newest request, abandoned when there is a newer one."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from threading import Lock


class Newest:
    """One thread that does one kind of work for one page.

    A piece of work is an iterator: between its steps it is abandoned if a newer one was requested
    or the page was closed. `failed` is called, on the thread, with an unexpected error.
    """

    def __init__(self, failed: Callable[[Exception], None]) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="explore")
        self._lock = Lock()
        self._ticket = 0
        self._closed = False
        self._failed = failed

    def ask(self, work: Callable[[], Iterator[None]]) -> None:
        """Do this work instead of any earlier request."""
        with self._lock:
            if self._closed:
                return
            self._ticket += 1
            self._pool.submit(self._run, self._ticket, work)

    def close(self) -> None:
        """Abandon the present work, and accept no more."""
        with self._lock:
            self._closed = True
            self._ticket += 1
            self._pool.shutdown(wait=False, cancel_futures=True)

    def _run(self, ticket: int, work: Callable[[], Iterator[None]]) -> None:
        if ticket != self._ticket:
            return
        try:
            for _ in work():
                if ticket != self._ticket:
                    return
        except Exception as error:
            if ticket == self._ticket:
                self._failed(error)

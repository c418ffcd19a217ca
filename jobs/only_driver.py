"""One program at a time fills a folder: two would do all work twice and write over each other."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

NAME = (
    ".lock"  # stays there, empty; held by the operating system, so a killed program lets go of it
)


@contextmanager
def only_driver(folder: Path) -> Generator[None]:
    """Hold a folder (it is made) for this program alone.

    Raises ValueError where another program holds it, OSError where it cannot be made.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lock = FileLock(folder / NAME, blocking=False)
    try:
        lock.acquire()
    except Timeout:
        raise ValueError(
            f"another program is filling {folder}; wait until it has ended, or choose another"
            " folder"
        ) from None
    try:
        yield
    finally:
        lock.release()

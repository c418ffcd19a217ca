"""A lock on a folder, so that two programs do not repeat work or overwrite each other's results."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

NAME = ".lock"  # an empty file that stays; the system releases a killed program's lock


@contextmanager
def only_driver(folder: Path) -> Generator[None]:
    """Lock a folder, created if necessary, for this program alone.

    Raises ValueError if another program has locked it, OSError if it cannot be created.
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

"""Tasks that processes of their own can import."""

import os
import signal
import time
from pathlib import Path


def square(value: int) -> tuple[int, int]:
    """Return value^2 and who computed it; the first ones take longer."""
    time.sleep(0.1 if value < 2 else 0.01)
    return value * value, os.getpid()


def refuse(value: int) -> int:
    """Fail for 3."""
    if value == 3:
        raise FileNotFoundError(f"no file for {value}")
    return value


def threads_allowed(_: int) -> str | None:
    """Return how many threads a task may take."""
    return os.environ.get("ZWIDTH_THREADS")


def die_once(task: tuple[int, str]) -> int:
    """End the process like a crash when 3 comes for the first time."""
    value, folder = task
    mark = Path(folder) / "died"
    if value == 3 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return value * value


def die(_: int) -> None:
    """End the process like a crash."""
    os.kill(os.getpid(), signal.SIGKILL)


def beat(file: str) -> None:
    """Write a letter to a file every 20 ms, for a minute."""
    for _ in range(3000):
        with Path(file).open("a") as beats:
            beats.write(".")
        time.sleep(0.02)

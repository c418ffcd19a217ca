"""Progress in a notebook: one line that is rewritten, unless the caller gave another function."""

import sys
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from zwidth.heartbeat import COMPILING
from zwidth.sim.compiling import watched

PROGRESS = {"zwidth": "progress"}  # metadata of the line, so that a page leaves it out
Say = Callable[[str], None]


@contextmanager
def telling(say: Say | None, title: str) -> Generator[Say]:
    """Yield `say`; if None, a function that writes a line in Jupyter or marimo, else nothing."""
    if say is not None:
        yield say
    elif _in_jupyter():
        display: Any = import_module("IPython.display").display
        handle = display({"text/plain": title}, raw=True, display_id=True, metadata=PROGRESS)

        def line(text: str) -> None:
            handle.update({"text/plain": _words(title, text)}, raw=True, metadata=PROGRESS)

        try:
            with _compiling_too(line) as tell:
                yield tell
        except BaseException:
            line("stopped")
            raise
        line("done")
    elif _in_marimo():
        status: Any = import_module("marimo").status
        with (
            status.spinner(title=title, remove_on_exit=True) as spinner,
            _compiling_too(lambda text: spinner.update(subtitle=_words("", text))) as tell,
        ):
            yield tell
    else:
        yield _silent


@contextmanager
def _compiling_too(say: Say) -> Generator[Say]:
    """Yield `say`, and in between have it say that kernels are being compiled, while they are."""
    last = ""

    def tell(text: str) -> None:
        nonlocal last
        last = text
        say(text)

    with watched(lambda begins: say(COMPILING if begins else last)):
        yield tell


def shares(say: Say | None) -> Callable[[float], None] | None:
    """Return a function that reports a share done with `say`."""
    return None if say is None or say is _silent else lambda share: say(f"{100.0 * share:.0f} %")


def counted(say: Say, total: int) -> Callable[..., None]:
    """Return a function to call after each of `total` steps, from any thread.

    It reports the share done, and the name of the step if it is called with one.
    """
    lock, done = threading.Lock(), 0

    def step(name: str = "") -> None:
        nonlocal done
        with lock:
            done = min(done + 1, total)
            share = f"{100.0 * done / total:.0f} %"
            say(f"{share}, {name}" if name else share)

    return step


def _silent(_: str) -> None:
    pass


def _words(title: str, text: str) -> str:
    from zwidth.diagnosis_report import in_words  # a boundary does not need it

    said = in_words(text.replace("@", " at "))
    return ": ".join(filter(None, (title, said)))


def _in_jupyter() -> bool:
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    return shell is not None and hasattr(shell, "kernel")


def _in_marimo() -> bool:
    return "marimo" in sys.modules and bool(sys.modules["marimo"].running_in_notebook())

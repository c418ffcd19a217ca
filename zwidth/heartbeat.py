"""Messages on standard error whenever a command would otherwise be silent for some seconds.

A terminal gets one line that is overwritten each second, anything else a line after every 2.7 s of
silence. It says how long the command has run, and the present step, or that kernels are being
compiled, which happens within any step if numba has not stored them. One line explains this once,
as soon as it takes a second.
"""

import sys
import threading
import time
from collections.abc import Generator
from contextlib import ExitStack, contextmanager

from zwidth.sim.compiling import watched

SILENCE = 2.7  # [s] after which a line is written without a terminal
REFRESH = 1.0  # [s] after which a terminal's line is written again
LASTING = 1.0  # [s] of compiling after which it is explained
LONGEST = 60  # characters of a step's description
COMPILING = "compiling the simulation (once for each version)"


class Heartbeat:
    """The last message, and its time. There is one for each process, `HEART`."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._over: threading.Event | None = None
        self._watching = ExitStack()
        self._begun = time.monotonic()
        self._doing, self._said = "", 0.0
        self._held, self._width = 0, 0
        self._compiling: float | None = None
        self._explained = False

    def start(self) -> None:
        """Start the heartbeat."""
        self._begun = self._said = time.monotonic()
        self._doing, self._over = "starting", threading.Event()
        self._watching.enter_context(watched(self.compiles))
        threading.Thread(target=self._beat, args=(self._over,), daemon=True).start()

    def stop(self) -> None:
        """Stop the heartbeat: the command waits for its user, or has ended."""
        self._watching.close()
        if self._over is not None:
            self._over.set()
        self.said()

    def begins(self, doing: str) -> None:
        """Note a step that begins, which is printed only if it lasts."""
        self._doing = doing

    def said(self, doing: str = "") -> None:
        """Note that something is about to be printed; clears the terminal's line.

        doing: the step that begins, if this is printed.
        """
        with self._lock:
            if doing:
                self._doing = doing
            self._said = time.monotonic()
            self._clear()

    def compiles(self, begins: bool) -> None:
        """Note that compiling begins or has ended, here or in a process that works for this one."""
        self._compiling = time.monotonic() if begins else None

    def elapsed(self) -> float:
        """How long the command has run [s]."""
        return time.monotonic() - self._begun

    @contextmanager
    def held(self) -> Generator[None]:
        """Write nothing within the block, except why it is slow: a progress bar moves."""
        self.said()
        self._held += 1
        try:
            yield
        finally:
            self._held -= 1
            self.said()

    def _beat(self, over: threading.Event) -> None:
        terminal = sys.stderr.isatty()
        while not over.wait(0.25):
            with self._lock:
                now, since = time.monotonic(), self._compiling
                if since is not None and now - since >= LASTING and not self._explained:
                    self._explain()
                if self._held or now - self._said < (REFRESH if terminal else SILENCE):
                    continue
                self._said = now
                doing = _short(self._doing) if since is None else COMPILING
                text = f"... {now - self._begun:4.0f} s  still {doing}"
                if terminal:
                    print("\r" + text.ljust(self._width), end="", file=sys.stderr, flush=True)
                    self._width = len(text)
                else:
                    print(text, file=sys.stderr, flush=True)

    def _explain(self) -> None:
        """Say why the first call of a version takes longer than all later ones."""
        from zwidth.sim.jit import cache_folder  # already loaded, since it compiles

        self._explained, self._said = True, time.monotonic()
        self._clear()
        text = (
            f"compiling the parts of the simulation that are not in {cache_folder()} yet (up to a"
            " few minutes, once for each version)"
        )
        print(text, file=sys.stderr, flush=True)

    def _clear(self) -> None:
        if self._width:
            print("\r" + " " * self._width, end="\r", file=sys.stderr, flush=True)
            self._width = 0


def _short(text: str) -> str:
    return text if len(text) <= LONGEST else text[: LONGEST - 4] + " ..."


HEART = Heartbeat()

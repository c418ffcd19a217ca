"""A sign of life on standard error, wherever a command would say nothing for some seconds.

A terminal gets one line that is overwritten each second, anything else a line after every 2.7 s of
silence. It says how long the command has run, and which step was begun last.
"""

import sys
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager

SILENCE = 2.7  # [s], after which a line is due where no terminal reads
REFRESH = 1.0  # [s], after which a terminal's line is written anew
LONGEST = 60  # characters of what is being done


class Heartbeat:
    """The last message, and its time. There is one for each process, `HEART`."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._over: threading.Event | None = None
        self._begun = time.monotonic()
        self._doing, self._said = "", 0.0
        self._held, self._width = 0, 0

    def start(self) -> None:
        """Start the heartbeat."""
        self._begun = self._said = time.monotonic()
        self._doing, self._over = "starting", threading.Event()
        threading.Thread(target=self._beat, args=(self._over,), daemon=True).start()

    def stop(self) -> None:
        """Stop the heartbeat: the command waits for its user, or has ended."""
        if self._over is not None:
            self._over.set()
        self.said()

    def said(self, doing: str = "") -> None:
        """Note that something is about to be printed; clears the terminal's line.

        doing: what is begun, where that is what is printed.
        """
        with self._lock:
            now = time.monotonic()
            if doing:
                self._doing = doing
            self._said = now
            if self._width:
                print("\r" + " " * self._width, end="\r", file=sys.stderr, flush=True)
                self._width = 0

    def elapsed(self) -> float:
        """How long the command has run [s]."""
        return time.monotonic() - self._begun

    @contextmanager
    def held(self) -> Generator[None]:
        """Write nothing within the block: a progress bar already moves."""
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
                now = time.monotonic()
                if self._held or now - self._said < (REFRESH if terminal else SILENCE):
                    continue
                self._said = now
                text = f"... {now - self._begun:4.0f} s  still {_short(self._doing)}"
                if terminal:
                    self._width = len(text)
                    print("\r" + text, end="", file=sys.stderr, flush=True)
                else:
                    print(text, file=sys.stderr, flush=True)


def _short(text: str) -> str:
    return text if len(text) <= LONGEST else text[: LONGEST - 4] + " ..."


HEART = Heartbeat()

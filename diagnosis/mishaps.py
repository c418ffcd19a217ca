"""Limits an internal error to one candidate, recording or picture; the rest continues.

A diagnosis takes minutes, and an error in a later step must not lose the earlier results. So
everything that can be spared runs inside `isolated`, which names the stage and what is lost if it
fails:

    with isolated("separation", "coulomb_friction at m1"):
        ...

An error in there is reported in one line and kept for report and JSON by the nearest `collecting`,
and the next step continues. Without `collecting`, or with ZWIDTH_DEBUG=1, errors propagate. An
interruption (KeyboardInterrupt) always does. `NoObserver`, by which a model reports a state of
affairs, is caught where it is expected and never comes this far.
"""

import os
from collections.abc import Callable, Generator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import TypeVar

Result = TypeVar("Result")
Say = Callable[[str], None]


def silent(_: str) -> None:
    """Report nothing."""


@dataclass(frozen=True)
class Mishap:
    """An error that lost `what`, a part of a stage ("" for all of it); error: its kind and text.

    cause: the error itself.
    """

    stage: str
    what: str
    error: str
    cause: BaseException = field(compare=False, repr=False)

    @property
    def sentence(self) -> str:
        """Say it in one line."""
        return f"{self.stage}{f' ({self.what})' if self.what else ''} failed: {self.error}"

    def as_json(self) -> dict[str, str]:
        """Return the JSON form."""
        return {"stage": self.stage, "what": self.what, "error": self.error}


class Mishaps:
    """The errors of one piece of work, in order."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self.say = say
        self.found: list[Mishap] = []

    def add(self, stage: str, what: str, error: BaseException) -> None:
        """Keep an error and report it; a repetition, as of a second try, is not reported again."""
        known = len(self.found)
        mishap = self.keep(stage, what, error)
        if len(self.found) > known:
            self.say(mishap.sentence)

    def keep(self, stage: str, what: str, error: BaseException) -> Mishap:
        """Keep an error, once, without reporting it, and return it."""
        text = " ".join(str(error).split())
        kind = type(error).__name__
        mishap = Mishap(stage, what, f"{kind}: {text}" if text else kind, error)
        if mishap not in self.found:
            self.found.append(mishap)
        return mishap

    def of(self, *stages: str) -> list[Mishap]:
        """Return the errors of some stages."""
        return [m for m in self.found if m.stage in stages]


_COLLECTOR: ContextVar[Mishaps | None] = ContextVar("collector", default=None)


@contextmanager
def collecting(say: Callable[[str], None]) -> Generator[Mishaps]:
    """Collect the errors of `isolated`; inside another `collecting`, the outer one continues.

    say: receives one line per error.
    """
    outer = _COLLECTOR.get()
    if outer is not None:
        yield outer
        return
    token = _COLLECTOR.set(Mishaps(say))
    try:
        mishaps = _COLLECTOR.get()
        assert mishaps is not None
        yield mishaps
    finally:
        _COLLECTOR.reset(token)


def debugging() -> bool:
    """Whether errors propagate, so that their traceback shows."""
    return os.environ.get("ZWIDTH_DEBUG") == "1"


def attempt(stage: str, what: str, task: Callable[[], Result]) -> Result | None:
    """Return the result of a task, None if an error lost it (`isolated`)."""
    with isolated(stage, what):
        return task()
    return None


@contextmanager
def isolated(stage: str, what: str = "") -> Generator[None]:
    """Limit an error in the block to the block, if anybody collects errors."""
    try:
        yield
    except Exception as error:
        mishaps = _COLLECTOR.get()
        if mishaps is None or debugging():
            raise
        mishaps.add(stage, what, error)

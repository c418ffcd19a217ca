"""Limits an internal error to one candidate, recording or picture; the rest continues.

A diagnosis takes minutes, and an error in a later step must not lose the earlier results. So every
dispensable step runs inside `isolated`, with its stage and the part that an error would lose:

    with isolated("separation", "coulomb_friction at m1"):
        ...

The outermost `collecting` reports an error in the block in one line and keeps it for report and
JSON, and the next step continues. Without `collecting`, or with ZWIDTH_DEBUG=1, errors propagate.
An interruption (KeyboardInterrupt) always does. `NoObserver`, which is a result and not an error,
is caught where it is expected.
"""

import os
from collections.abc import Callable, Generator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import TypeVar

from zwidth.shown import Valued

Result = TypeVar("Result")
SAID = {"augmented device": "improved device"}  # stages that a reader knows by another name
Say = Callable[[str], None]


def silent(_: str) -> None:
    """Report nothing."""


@dataclass(frozen=True)
class Mishap(Valued):
    """An error that lost `what`, a part of a stage ("" for all); error: text of `cause`."""

    stage: str
    what: str
    error: str
    cause: BaseException = field(compare=False, repr=False)

    @property
    def sentence(self) -> str:
        """The error in one line."""
        stage = SAID.get(self.stage, self.stage)
        return f"{stage}{f' ({self.what})' if self.what else ''} failed: {self.error}"

    def as_json(self) -> dict[str, str]:
        """Return the JSON form."""
        return {"stage": self.stage, "what": self.what, "error": self.error}


class Mishaps:
    """The errors of one piece of work, in order."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self.say = say
        self.found: list[Mishap] = []

    def add(self, stage: str, what: str, error: BaseException) -> None:
        """Keep an error and report it; a repetition is not reported again."""
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
    """Collect the errors of `isolated` and `say` each; inside another, the outer one continues."""
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
    """Whether errors propagate, to show their traceback."""
    return os.environ.get("ZWIDTH_DEBUG") == "1"


def attempt(stage: str, what: str, task: Callable[[], Result]) -> Result | None:
    """Return the result of a task, None if an error lost it (`isolated`)."""
    with isolated(stage, what):
        return task()
    return None


@contextmanager
def isolated(stage: str, what: str = "") -> Generator[None]:
    """Limit an error to the block, if errors are collected."""
    try:
        yield
    except Exception as error:
        mishaps = _COLLECTOR.get()
        if mishaps is None or debugging():
            raise
        mishaps.add(stage, what, error)

"""Counts the simulations of a diagnosis by stage and reason.

    with keeping() as account:
        with stage("adding effects"):
            with reason("slopes"):
                ...                 # each kernel call in here is booked on both

A simulation is one device over all recordings of the fit: member-ticks divided by `Account.ticks`.
Counts are the same on every machine, so tests may assert them. CPU seconds of the kernel are not.
"""

import threading
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any

from zwidth.sim.account import BOOK

Key = tuple[str, str]


@dataclass
class Entry:
    """Calls of the kernel, member-ticks, and its CPU seconds."""

    calls: int = 0
    member_ticks: int = 0
    kernel_s: float = 0.0


@dataclass
class Account:
    """The simulations, by (stage, reason). ticks: of the fitted recordings."""

    ticks: int = 0
    entries: dict[Key, Entry] = field(default_factory=dict[Key, Entry])
    stages: dict[str, float] = field(default_factory=dict[str, float])
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def book(self, members: int, ticks: int, seconds: float) -> None:
        """Book a call of the kernel on the current stage and reason."""
        with self._lock:
            entry = self.entries.setdefault((_STAGE.get(), _REASON.get()), Entry())
            entry.calls += 1
            entry.member_ticks += members * ticks
            entry.kernel_s += seconds

    @property
    def total(self) -> Entry:
        """All entries together."""
        every = list(self.entries.values())
        return Entry(
            sum(e.calls for e in every),
            sum(e.member_ticks for e in every),
            sum(e.kernel_s for e in every),
        )

    @property
    def simulations(self) -> float:
        """How many times the recordings were simulated from the first sample to the last."""
        return self.total.member_ticks / max(1, self.ticks)

    def rows(self) -> Iterator[dict[str, Any]]:
        """Yield the entries, the most expensive first."""
        for (at, why), e in sorted(self.entries.items(), key=lambda i: -i[1].member_ticks):
            yield {
                "stage": at,
                "reason": why,
                "calls": e.calls,
                "member_ticks": e.member_ticks,
                "simulations": e.member_ticks / max(1, self.ticks),
                "kernel_cpu_s": e.kernel_s,
            }

    def as_json(self) -> dict[str, Any]:
        """Return the JSON form."""
        total = self.total
        return {
            "fitted_ticks": self.ticks,
            "simulations": self.simulations,
            "calls": total.calls,
            "member_ticks": total.member_ticks,
            "kernel_cpu_s": total.kernel_s,
            "stages_cpu_s": self.stages,
            "by": list(self.rows()),
        }


def counts(cost: dict[str, Any]) -> dict[str, Any]:
    """Return an account's JSON without its seconds: the part that is the same on every run."""
    found = {k: v for k, v in cost.items() if k not in ("kernel_cpu_s", "stages_cpu_s", "by")}
    rows = ({k: v for k, v in row.items() if k != "kernel_cpu_s"} for row in cost.get("by", ()))
    return {**found, "by": list(rows)} if found else {}


_ACCOUNT: ContextVar[Account | None] = ContextVar("account", default=None)
_STAGE: ContextVar[str] = ContextVar("stage", default="other")
_REASON: ContextVar[str] = ContextVar("reason", default="other")


@contextmanager
def keeping() -> Generator[Account]:
    """Keep an account of the simulations in the block; inside another, the outer one continues."""
    outer = _ACCOUNT.get()
    if outer is not None:
        yield outer
        return
    account = Account()
    tokens = _ACCOUNT.set(account), BOOK.set(account.book)
    try:
        yield account
    finally:
        BOOK.reset(tokens[1])
        _ACCOUNT.reset(tokens[0])


def spent() -> int:
    """Return the member-ticks booked so far, 0 if no account is kept."""
    account = _ACCOUNT.get()
    return 0 if account is None else account.total.member_ticks


@contextmanager
def stage(name: str) -> Generator[None]:
    """Book the simulations of the block on a stage, with its CPU seconds of all threads."""
    token, begun = _STAGE.set(name), time.process_time()
    try:
        yield
    finally:
        _STAGE.reset(token)
        account = _ACCOUNT.get()
        if account is not None:
            spent = time.process_time() - begun
            account.stages[name] = account.stages.get(name, 0.0) + spent


@contextmanager
def reason(name: str) -> Generator[None]:
    """Book the simulations of the block on a reason."""
    token = _REASON.set(name)
    try:
        yield
    finally:
        _REASON.reset(token)

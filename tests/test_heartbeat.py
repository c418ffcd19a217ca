"""A command that works is never silent for long, and one that waits for its user is."""

import sys
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numba
import pytest
from numba.core.errors import TypingError
from numba.extending import overload

from zwidth import heartbeat
from zwidth.api import notebook
from zwidth.console import Console, progress
from zwidth.sim.compiling import watched
from zwidth.sim.jit import cache_folder
from zwidth.watch import worker

LATE = 2.0  # [s] that a kernel takes to compile
ADVICE = (
    f"compiling the parts of the simulation that are not in {cache_folder()} yet (up to a few"
    " minutes, once for each version)"
)
COMPILING = "still compiling the simulation (once for each version)"


@pytest.fixture
def heart(monkeypatch: pytest.MonkeyPatch) -> heartbeat.Heartbeat:
    monkeypatch.setattr(heartbeat, "SILENCE", 0.4)
    monkeypatch.setattr(heartbeat, "LASTING", 0.5)
    kernel(seconds=0.0)(1.0)  # numba itself takes some time when it is first asked
    found = heartbeat.Heartbeat()
    monkeypatch.setattr("zwidth.console.HEART", found)
    return found


def test_what_was_begun_last_is_said_again(
    heart: heartbeat.Heartbeat, capsys: pytest.CaptureFixture[str]
):
    """Mutations: no thread is started; what is begun is not taken notice of."""
    heart.start()
    Console().doing("fitting", 3.0)
    time.sleep(1.3)
    heart.stop()
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "...    3 s  fitting"
    assert len(lines) >= 2
    assert all(line.endswith(" s  still fitting") for line in lines[1:])


def test_what_begins_without_a_line_of_its_own_does_not_put_off_the_next_one(
    heart: heartbeat.Heartbeat, capsys: pytest.CaptureFixture[str]
):
    """Mutation: `begins` counts as said, so that steps of 2 s each are silent for ever."""
    heart.start()
    for step in range(8):
        with progress(f"step {step}", 1):
            time.sleep(0.2)
    heart.stop()
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) >= 2
    assert all("  still step " in line for line in lines)


def test_nothing_is_said_while_it_is_held_or_has_stopped(
    heart: heartbeat.Heartbeat, capsys: pytest.CaptureFixture[str]
):
    """Mutations: `held` does nothing; the thread does not end."""
    heart.start()
    with heart.held():
        time.sleep(1.0)
    heart.stop()
    time.sleep(1.0)
    assert capsys.readouterr().err == ""


def kernel(during: Callable[[], object] = lambda: None, seconds: float = LATE) -> Any:
    """A function that takes its time to compile; during: what else is done in that time."""

    def late(x: float) -> float:
        raise NotImplementedError(x)  # only compiled code calls it

    @overload(late)
    def _(x: Any) -> Any:  # pyright: ignore[reportUnusedFunction]  # numba calls it to compile
        during()
        time.sleep(seconds)

        def compiled(x: Any) -> Any:
            return x + 1.0

        return compiled

    @numba.njit
    def part(x: Any) -> Any:
        return late(x)

    return numba.njit(lambda x: 2.0 * part(x))


def test_compiling_is_explained_once_and_said_until_it_ends(
    heart: heartbeat.Heartbeat, capsys: pytest.CaptureFixture[str]
):
    """Mutations: explained for each kernel; what begins meanwhile overrides it; said after it."""
    heart.start()
    kernel(lambda: heart.said("fitting"))(1.0)
    heart.said("drawing")
    time.sleep(1.0)
    heart.stop()
    lines = capsys.readouterr().err.splitlines()
    lines.remove(ADVICE)
    count = sum(line.endswith(COMPILING) for line in lines)
    assert 0 < count < len(lines)
    assert all(line.endswith(COMPILING) for line in lines[:count])
    assert all(line.endswith("still drawing") for line in lines[count:])
    heart.start()
    with heart.held():
        kernel()(1.0)
    heart.stop()
    assert capsys.readouterr().err == ""


def test_compiling_is_explained_beside_a_bar_that_stands_still(
    heart: heartbeat.Heartbeat, capsys: pytest.CaptureFixture[str]
):
    """Mutation: nothing at all is said while it is held."""
    heart.start()
    with heart.held():
        kernel()(1.0)
    heart.stop()
    assert capsys.readouterr().err.splitlines() == [ADVICE]


def test_a_kernel_that_compiles_at_once_is_not_worth_a_word(
    heart: heartbeat.Heartbeat,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
):
    """Mutation: explained where compiling begins."""
    monkeypatch.setattr(heartbeat, "LASTING", 60.0)
    heart.start()
    kernel(seconds=1.0)(1.0)
    heart.stop()
    lines = capsys.readouterr().err.splitlines()
    assert lines
    assert all(line.endswith(COMPILING) for line in lines)


def test_only_the_outermost_of_nested_compilings_counts_and_an_error_ends_it():
    """Mutations: every event is told; an error leaves it compiling for ever."""
    told: list[bool] = []
    found = kernel(seconds=0.0)
    with watched(told.append):
        found(1.0)
        assert told == [True, False]
        found(2.0)  # is there already
        assert told == [True, False]
        with pytest.raises(TypingError):
            numba.njit(lambda: no_such_thing)()  # pyright: ignore[reportUndefinedVariable]  # noqa: F821
        assert told == [True, False, True, False]
    kernel(seconds=0.0)(1.0)
    assert told == [True, False, True, False]


def one_kernel() -> float:
    return float(kernel(seconds=0.0)(1.0))


def test_a_worker_of_watch_tells_that_it_compiles(monkeypatch: pytest.MonkeyPatch):
    """Mutation: what it tells is taken for its result."""
    told: list[bool] = []
    monkeypatch.setattr(worker.HEART, "compiles", told.append)
    works = worker.Worker()
    try:
        works.give(one_kernel)
        found = None
        while works.busy:
            found = works.take()
            time.sleep(0.05)
    finally:
        works.close()
    assert found == 4.0
    assert told == [True, False]


class Line:
    """What Jupyter's display gives, to write a line anew."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def update(self, data: dict[str, str], **_: Any) -> None:
        self.texts.append(data["text/plain"])


def test_a_notebook_says_that_it_compiles_and_then_what_it_did_before(
    monkeypatch: pytest.MonkeyPatch,
):
    """Mutations: it says nothing of it; it goes on saying so."""
    line = Line()
    shown = SimpleNamespace(display=lambda *_, **__: line)
    monkeypatch.setitem(sys.modules, "IPython.display", shown)
    monkeypatch.setattr(notebook, "_in_jupyter", lambda: True)
    with notebook.telling(None, "fitting") as tell:
        kernel(seconds=0.0)(1.0)
        tell("50 %")
        kernel(seconds=0.0)(1.0)
    compiling = "fitting: compiling the simulation (once for each version)"
    assert line.texts == [
        compiling, "fitting", "fitting: 50 %", compiling, "fitting: 50 %", "fitting: done",
    ]  # fmt: skip

"""A command that works is never silent for long, and one that waits for its user is."""

import time

import pytest

from zwidth import heartbeat
from zwidth.console import Console


@pytest.fixture
def heart(monkeypatch: pytest.MonkeyPatch) -> heartbeat.Heartbeat:
    monkeypatch.setattr(heartbeat, "SILENCE", 0.4)
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

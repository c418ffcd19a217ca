"""The server of `zwidth explore`: who gets in, what it gives away, what a page leaves behind."""

import asyncio
import base64
import gc
import socket
import threading
import time
from collections.abc import Generator
from contextlib import closing
from dataclasses import replace
from http.client import HTTPConnection
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("bokeh", reason="needs the extra zwidth[explore]")

from bokeh.document import Document
from bokeh.server.callbacks import NextTickCallback

from zwidth.cli import run
from zwidth.explore import session as sessions
from zwidth.explore.background import Newest
from zwidth.explore.bench import Bench
from zwidth.explore.dropped import read_dropped
from zwidth.explore.server import listen
from zwidth.explore.session import Session
from zwidth.explore.view import View, read_query
from zwidth.logs.recording import read_recording
from zwidth.scenarios.replay import replay
from zwidth.scenarios.scenario_file import load_scenario
from zwidth.sim.device_file import load_device
from zwidth.sim.trace import Trace
from zwidth.stability.plane import Plane
from zwidth.stability.sketch import Sketch, sketch

BENCH = Bench([load_device("phantom_1_0")])
WALL = "K=12&B=0.04&encoder_step=0.0001"


@pytest.fixture(scope="module")
def port() -> Generator[int]:
    """A server in a thread of its own."""
    ready = threading.Event()
    found: dict[str, object] = {}

    async def serve() -> None:
        stop = asyncio.Event()
        server, url = listen(BENCH)
        server.start()
        found.update(
            port=int(url.rsplit(":", 1)[1].strip("/")),
            stop=lambda: loop.call_soon_threadsafe(stop.set),
        )
        loop = asyncio.get_running_loop()
        ready.set()
        await stop.wait()
        server.stop()
        server.unlisten()
        await asyncio.sleep(0.05)  # in which the connections are closed

    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    assert ready.wait(60)
    number, stop = found["port"], found["stop"]
    assert isinstance(number, int)
    assert callable(stop)
    yield number
    stop()
    thread.join(60)
    assert not thread.is_alive()


def get(
    port: int, path: str, headers: dict[str, str] | None = None, body: bool = True
) -> tuple[int, bytes]:
    """Status and body; the path goes out as it stands, without being tidied up."""
    headers = headers or {}
    with closing(HTTPConnection("127.0.0.1", port, timeout=60)) as connection:
        connection.putrequest("GET", path, skip_host="Host" in headers)
        for name, value in headers.items():
            connection.putheader(name, value)
        connection.endheaders()
        with closing(connection.getresponse()) as answer:
            return answer.status, answer.read() if body else b""


@pytest.mark.parametrize(
    "path",
    [
        "/static/../../../../../../../../etc/passwd",
        "/static/%2e%2e/%2e%2e/%2e%2e/%2e%2e/%2e%2e/%2e%2e/%2e%2e/etc/passwd",
        "/static/..%2f..%2f..%2f..%2f..%2f..%2f..%2fetc/passwd",
        "/static//etc/passwd",
        "/static/extensions/../../../../../../etc/passwd",
        "/static/js/../../../../../../../../../../etc/passwd",
        "//etc/passwd", "/etc/passwd", "/../../etc/passwd", "/run.mcap/../../etc/passwd",
        "/run.toml/%2e%2e/%2e%2e/etc/passwd", "/pyproject.toml", "/run.py", "/run.mcapx",
    ],
)  # fmt: skip
def test_no_file_but_its_own_is_served(port: int, path: str):
    status, body = get(port, path)
    assert status in (403, 404)
    assert b"root:" not in body


def test_it_listens_on_this_machine_only(port: int):
    own = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None)}
    for address in sorted(str(a) for a in own if not str(a).startswith(("127.", "::1"))):
        family = socket.AF_INET6 if ":" in address else socket.AF_INET
        with closing(socket.socket(family)) as outside:
            outside.settimeout(2)
            assert outside.connect_ex((address, port)) != 0


@pytest.mark.parametrize(
    ("origin", "enters"),
    [("http://localhost:{port}", True), ("http://127.0.0.1:{port}", True),
     ("http://evil.example", False), ("http://evil.example:{port}", False),
     ("http://localhost:1", False)],
)  # fmt: skip
def test_only_its_own_page_opens_a_connection(port: int, origin: str, enters: bool):
    status, page = get(port, "/")
    assert status == 200
    token = page.split(b'"token":"')[1].split(b'"')[0].decode()
    upgrade = {
        "Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": base64.b64encode(bytes(16)).decode(),
        "Sec-WebSocket-Protocol": f"bokeh, {token}", "Origin": origin.format(port=port),
    }  # fmt: skip
    status, _ = get(port, "/ws", headers=upgrade, body=False)
    assert status == (101 if enters else 403)


def test_a_log_is_given_to_its_own_page_only_and_replays(port: int, tmp_path: Path):
    status, _ = get(port, f"/run.mcap?{WALL}", {"Host": f"evil.example:{port}"})
    assert status == 403
    status, log = get(port, f"/run.mcap?{WALL}")
    assert status == 200
    (tmp_path / "run.mcap").write_bytes(log)
    assert replay(tmp_path / "run.mcap").identical
    status, text = get(port, f"/run.toml?{WALL}")
    assert status == 200
    (tmp_path / "run.toml").write_bytes(text)
    assert load_scenario(tmp_path / "run.toml").device.interface.encoder_step == 1e-4


@pytest.mark.parametrize(
    ("query", "said"),
    [("", b"gives no wall"), ("K=1", b"gives no wall"), ("K=x&B=0", b"it must be a number"),
     ("K=1&B=0&colour=1", b"unknown part"), ("K=1&B=0&device=3", b"there are 1")],
)  # fmt: skip
def test_a_link_that_asks_for_nothing_is_refused_in_a_sentence(port: int, query: str, said: bytes):
    status, body = get(port, f"/run.mcap?{query}")
    assert status == 400
    assert said in body
    assert body.count(b"\n") == 1


def test_every_address_opens_a_page(port: int):
    """A view that cannot be is left out, not a page that fails."""
    for query in (
        "delay_s=1000", "K=1e14&B=1e14", "K_range=0,1e-300", "%ff=%ff", "start=1e14",
        "t_range=0,1&recording_from_s=3&layer=frequency&one_sided=1",
    ):  # fmt: skip
        status, _ = get(port, f"/?{query}")
        assert status == 200, query


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_port_in_use_is_one_sentence(port: int, capsys: pytest.CaptureFixture[str]):
    assert run(["explore", "phantom_1_0", "--port", str(port), "--no-browser"]) == 2
    said = capsys.readouterr().err.splitlines()
    assert said[-1] == (
        f"error: port {port} is in use; give another with --port, or 0 for any that is free"
    )
    assert run(["explore", "phantom_1_0", "--address", "192.0.2.1", "--no-browser"]) == 2
    assert "give one of this machine's own" in capsys.readouterr().err
    gc.collect()  # tornado leaves the socket that it could not bind to the collector


def shown(document: Document) -> None:
    """Do what waits to be shown on a page without a browser."""
    for callback in document.session_callbacks:
        assert isinstance(callback, NextTickCallback)
        document.remove_next_tick_callback(callback)
        callback.callback()


def settled(session: Session, document: Document) -> None:
    """Wait until a page without a browser has shown everything."""
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        shown(document)
        if session.drawn and session.drawn.finished and session.page.wall.html:
            return
        time.sleep(0.01)
    pytest.fail("the page did not settle")


def test_two_pages_know_nothing_of_each_other():
    one, other = Document(), Document()
    first = Session(one, BENCH, View(), [])
    second = Session(other, BENCH, View(stiffness=30.0, damping=0.01), [])
    first.page.put_on(one)
    second.page.put_on(other)
    settled(first, one)
    settled(second, other)
    before = second.view, second.page.wall.html
    first.change(encoder_step=1e-3, stiffness=20.0)
    settled(first, one)
    assert (second.view, second.page.wall.html) == before
    assert first.view.encoder_step == 1e-3
    first.close()
    second.close()


def test_a_stiffness_below_zero_is_refused_in_a_sentence():
    """And what holds is shown again. Breaks where it is ignored without a word."""
    document = Document()
    session = Session(document, BENCH, View(stiffness=5.0, damping=0.01), [])
    session.page.put_on(document)
    settled(session, document)
    session.page.controls.stiffness.value = -3.0
    assert "is -3; give a number above 0" in session.page.trouble.text
    assert session.view.stiffness == 5.0
    assert session.page.controls.stiffness.value == 5.0
    session.choose(0.01, -2.0)
    assert "K above 0" in session.page.trouble.text
    session.page.controls.stiffness.value = 6.0
    assert session.view.stiffness == 6.0
    assert not session.page.trouble.text
    session.close()


def test_the_time_axis_ends_where_a_run_was_lost():
    """A wall far too stiff without a limit is lost in a fraction of a second.

    Breaks where its axis goes on to the end of time, which is empty.
    """
    document = Document()
    session = Session(document, BENCH, View(stiffness=100.0, damping=0.01), [])
    session.page.put_on(document)
    settled(session, document)
    runs = session.page.runs
    ended = float(runs.runs["run"]["t"][-1])
    assert ended < 1.0
    assert runs.axis.end == ended
    assert "grows without bound" in session.page.wall.html
    assert "; lost after " in session.page.wall.html
    session.close()


def test_a_page_shows_the_recording_it_was_started_with_and_says_what_it_left_out():
    """What stands in an address is text, whatever it looks like."""
    t = np.linspace(0.0, 5.0, 5001, dtype=np.float64)
    recorded = Trace(t, {"position_m1": np.sin(t)}, {"position_m1": "rad"}, "recorded")
    document = Document()
    view, complaints = read_query({"layer": ["<b>"]})
    bench = Bench(BENCH.devices, recorded)
    session = Session(document, bench, replace(view, recording_from=2.0), complaints)
    session.page.put_on(document)
    settled(session, document)
    shown = session.page.runs.runs["recorded"]
    assert shown["t"][0] == 0.0
    assert shown["position"][0] == np.sin(2.0)
    assert "recording" in session.page.whose.text
    assert "layer = &#x27;&lt;b&gt;&#x27;" in session.page.trouble.text
    session.close()


def test_a_page_that_is_closed_while_it_computes_leaves_no_work_behind(
    monkeypatch: pytest.MonkeyPatch,
):
    """Mutation: `close` that does not change the ticket."""
    started, ended = threading.Event(), threading.Event()
    deadline = time.monotonic() + 120

    def endless(plane: Plane) -> Generator[Sketch]:
        one = next(iter(sketch(plane)))
        try:
            while time.monotonic() < deadline:
                started.set()
                yield one
        finally:
            ended.set()

    monkeypatch.setattr(sessions, "sketch", endless)
    document = Document()
    session = Session(document, BENCH, View(), [])
    session.page.put_on(document)
    assert started.wait(60)
    session.close()
    session.change(friction=3e-3)  # what was on its way from the browser
    assert ended.wait(60)
    assert time.monotonic() < deadline


def test_a_picture_that_comes_late_does_not_replace_a_newer_one():
    """Mutation: `older_than` always false."""
    document = Document()
    session = Session(document, BENCH, View(), [])
    session.page.put_on(document)
    settled(session, document)
    newest = session.drawn
    assert newest is not None
    late = newest._replace(finished=False, seconds=0.5 * newest.seconds)
    session._show_plane(late)
    assert session.drawn is newest
    session._show_plane(late._replace(seconds=2.0 * newest.seconds))
    assert session.drawn is not newest
    session.close()


def test_a_slider_moved_and_back_is_computed_anew():
    """However fast it is then. Mutation: `older_than` compares without the request."""
    document = Document()
    session = Session(document, BENCH, View(), [])
    session.page.put_on(document)
    settled(session, document)
    assert session.drawn is not None
    session.drawn = session.drawn._replace(finished=False, seconds=1e9)  # as at a busy moment
    session.change(encoder_step=1e-3)
    session.change(encoder_step=None)
    settled(session, document)
    assert session.drawn.seconds < 1e9
    session.close()


def test_only_the_newest_request_is_finished():
    """Mutation: no look at the ticket between steps."""
    done, started, go_on = list[int](), threading.Event(), threading.Event()
    newest = Newest(lambda error: pytest.fail(str(error)))

    def slow(number: int):
        def work():
            started.set()
            assert go_on.wait(60)
            yield
            done.append(number)

        return work

    newest.ask(slow(1))
    assert started.wait(60)
    for number in (2, 3, 4):
        newest.ask(slow(number))
    go_on.set()
    deadline = time.monotonic() + 60
    while 4 not in done and time.monotonic() < deadline:
        time.sleep(0.005)
    newest.close()
    assert done == [4]


def test_an_error_in_the_background_is_told(monkeypatch: pytest.MonkeyPatch):
    def fails(*_: object) -> object:
        raise ZeroDivisionError("of what")

    monkeypatch.setattr(sessions, "look", fails)
    document = Document()
    session = Session(document, BENCH, View(), [])
    session.page.put_on(document)
    deadline = time.monotonic() + 60
    while not session.page.trouble.text and time.monotonic() < deadline:
        shown(document)
        time.sleep(0.01)
    session.close()
    assert "internal error, ZeroDivisionError: of what" in session.page.trouble.text


def encoded(content: bytes) -> str:
    return base64.b64encode(content).decode()


DESCRIPTION = """
file = "{file}"
period_s = 0.001
[input]
signal = "u"
unit = "N m"
[[output]]
signal = "y"
unit = "rad"
quantity = "position"
at = "m1"
"""
TABLE = b"u,y\n" + b"".join(b"%d,%d\n" % (k % 3, k % 5) for k in range(40))
UNNAMED = b"a,b\n" + b"".join(b"%d,%d\n" % (k * k % 7, k * k % 11) for k in range(40))


def test_a_recording_is_read_from_what_was_dropped(port: int, tmp_path: Path):
    trace, said = read_dropped(
        ["r.toml", "data.csv"], [encoded(DESCRIPTION.format(file="data.csv").encode()),
                                 encoded(TABLE)],
    )  # fmt: skip
    assert np.array_equal(trace["position_m1"], np.arange(40) % 5)
    assert said == []
    _, log = get(port, f"/run.mcap?{WALL}")
    (tmp_path / "run.mcap").write_bytes(log)
    dropped, _ = read_dropped(["run.mcap"], [encoded(log)])
    assert np.array_equal(dropped["command"], read_recording(tmp_path / "run.mcap")["command"])


def test_a_table_of_another_tool_is_taken_for_what_it_seems():
    """Mutation: a drop that says nothing of what it assumed."""
    trace, said = read_dropped(["data.csv"], [encoded(TABLE)])
    assert np.array_equal(trace["command"], np.arange(40) % 3)
    assert any(line.startswith("assumed: no column seems to be time") for line in said)


def test_the_page_says_how_a_dropped_file_is_read():
    """Mutation: only the doubts are shown, and not which column and unit is what."""
    session = Session(Document(), BENCH, View(), [])
    try:
        session.take(["data.csv"], [encoded(TABLE)])
        page = session.page
        assert page.read.visible
        assert page.read.text.startswith("data.csv is read as ")
        assert "command: " in page.read.text
        assert page.trouble.text.startswith('<b style="color:#8b0000">assumed: no column seems')
    finally:
        session.close()


@pytest.mark.parametrize("named", ["/etc/passwd", "../../../etc/passwd", "other.csv"])
def test_a_dropped_description_opens_no_other_file(named: str):
    """Mutation: `_chosen` without its look at the names. A file of that name does exist."""
    description = encoded(DESCRIPTION.format(file=named).encode())
    with pytest.raises(ValueError, match="not dropped with it"):
        read_dropped(["r.toml", "data.csv"], [description, encoded(TABLE)])


@pytest.mark.parametrize(
    ("names", "contents", "said"),
    [
        ([], [], "no file arrived"),
        (["run.csv"], ["!"], "did not arrive whole"),
        (["a.csv", "b.csv"], [encoded(TABLE)] * 2, "drop one recording"),
        (["data.csv"], [encoded(UNNAMED)], "shows which of"),
        ([".."], [encoded(TABLE)], "is not a file name"),
    ],
)
def test_what_is_no_recording_is_refused(names: list[str], contents: list[str], said: str):
    with pytest.raises(ValueError, match=said) as refused:
        read_dropped(names, contents)
    assert "/tmp" not in str(refused.value)


def test_a_name_with_folders_stays_in_its_own(tmp_path: Path):
    target = tmp_path / "outside.csv"
    for name in (str(target), f"..\\..\\{target.name}", f"../../{target.name}"):
        read_dropped([name], [encoded(TABLE)])
    assert not target.exists()

"""`zwidth watch`: a log that grows says what is wrong with it, and ends with the offline answer."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from io import StringIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mcap.writer import MCAP0_MAGIC

from tests.diagnosis_examples import record
from zwidth import cli
from zwidth.errors import Status
from zwidth.logs.mcap_writer import write_log
from zwidth.logs.source import RecordingError
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_file import save_device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.trace import Trace
from zwidth.watch.growing import Growing, of_file
from zwidth.watch.quick import Quick
from zwidth.watch.searched import Searched
from zwidth.watch.state import Gate, gate, read
from zwidth.watch.updates import Update
from zwidth.watch.watching import Asked, follow

MOTOR = Device("motor", "", True, make_chain([1.2e-3], [6e-3]), Interface(period=0.001))
HEAD = "t [s],u [N m],q [rad]\n"
PATIENCE = 240.0  # s that a process may take for its kernels and a search


def rows(device: Device, seconds: float = 2.0) -> list[str]:
    """The lines of a recording."""
    e = record(device, seconds, seed=1)
    t = np.arange(e.ticks) * 1e-3
    return [
        f"{a:.6f},{b:.10g},{c:.10g}\n"
        for a, b, c in zip(t, e.command, e.measured[:, 0], strict=True)
    ]


class Pipe:
    """What has come of a log, bit by bit."""

    def __init__(self, *blocks: bytes) -> None:
        self.blocks, self.over = list(blocks), False

    def __call__(self) -> tuple[bytes, bool]:
        new = self.blocks.pop(0) if self.blocks else b""
        return new, self.over and not self.blocks


def test_a_line_is_copied_when_it_is_whole(tmp_path: Path):
    """Mutation: the copy of all that has come."""
    log = Growing(Pipe(b"u,q\n1,2\n3,4.5", b"6\n7"), "a.csv", tmp_path)
    log.poll()
    assert log.spool.read_bytes() == b"u,q\n1,2\n"
    log.poll()
    assert log.spool.read_bytes() == b"u,q\n1,2\n3,4.56\n"
    assert log.rest() == b"7"


def test_lines_of_two_bytes_a_letter_are_cut_where_they_end(tmp_path: Path):
    """Mutation: cut at the byte of a line's end, in the middle of a letter."""
    for code, mark in (("utf-16-le", b"\xff\xfe"), ("utf-16-be", b"\xfe\xff")):
        data = mark + "u,q\n1,\u010a\n2,\u0a01\u0100\u0a01".encode(code)
        log = Growing(Pipe(*(data[k : k + 3] for k in range(0, len(data), 3))), code, tmp_path)
        for _ in range(len(data)):
            log.poll()
        assert log.spool.read_bytes() == mark + "u,q\n1,\u010a\n".encode(code)


def test_a_file_that_is_begun_anew_is_said(tmp_path: Path):
    path = tmp_path / "a.csv"
    path.write_text("u,q\n1,2\n")
    log = Growing(of_file(path), "copy.csv", tmp_path)
    assert log.poll() == 8
    assert log.poll() == 0
    path.write_text("u\n")
    with pytest.raises(RecordingError, match="was started again"):
        log.poll()


def test_a_file_that_gets_its_last_name_has_ended(tmp_path: Path):
    """As a run's NAME.partial.mcap does. Mutation: an error of the operating system."""
    path = tmp_path / "a.csv"
    path.write_text("u,q\n1,2\n")
    log = Growing(of_file(path), "copy.csv", tmp_path)
    log.poll()
    assert not log.ended
    path.rename(tmp_path / "b.csv")
    assert log.poll() == 0
    assert log.ended


def test_what_is_written_as_a_whole_cannot_be_followed(tmp_path: Path):
    with pytest.raises(RecordingError, match="when it is complete"):
        Growing(Pipe(b"PK\x03\x04more"), "a.npz", tmp_path).poll()


def test_an_mcap_file_ends_with_its_magic(tmp_path: Path):
    log = Growing(Pipe(MCAP0_MAGIC + b"\x01", b"records", MCAP0_MAGIC), "a.mcap", tmp_path)
    ended = []
    for _ in range(3):
        log.poll()
        ended.append(log.ended)
    assert ended == [False, False, True]


class Idle:
    """A worker that keeps what it was given, and answers when told."""

    def __init__(self) -> None:
        self.given: list[tuple[Any, ...]] = []
        self.answers: list[Any] = []
        self.busy = False

    def give(self, function: Any, *arguments: Any) -> None:
        self.given.append((function.__name__, *arguments))
        self.busy = True

    def take(self) -> Any:
        if not self.busy or not self.answers:
            return None
        self.busy = False
        return self.answers.pop(0)


@pytest.fixture(scope="module")
def lines() -> list[str]:
    """With dry friction."""
    return rows(MOTOR.with_physics(make_physics("coulomb_friction", "m1", level=0.02)))


def asked(pipe: Pipe, folder: Path) -> Asked:
    return Asked(Growing(pipe, "log.csv", folder), None, "log", MOTOR, 0.0, None, None)


def found_in(samples: int) -> Searched:
    """What a search says of so many samples."""
    from zwidth.diagnosis.model.parameters import Model

    return Searched(samples, 1e-3 * samples, MOTOR, Model(MOTOR), np.zeros(2), "nothing_missing",
                    "nothing is missing", "", ())  # fmt: skip


def fit_of(samples: int, stands: bool) -> Quick:
    return Quick(samples, 0.0, 1e-3 * samples, (), {}, stands, 0.0, 1.0, np.zeros(2), None, 0.1)


def test_it_is_searched_when_there_is_twice_as_much_or_it_no_longer_stands(
    tmp_path: Path, lines: list[str], monkeypatch: pytest.MonkeyPatch
):
    """Mutations: searched at every look; never again after the first; a fit that does not stand
    begins no search; one that stands begins one.
    """
    for wait in ("READ_EVERY", "GATE_EVERY", "FIT_EVERY", "BUSY", "GATE_BUSY"):
        monkeypatch.setattr(f"zwidth.watch.watching.{wait}", 0.0)
    searches, fits, told = Idle(), Idle(), list[Update]()
    searched_at, upto = list[int](), [0]
    pipe = Pipe(HEAD.encode())

    def look(samples: int, stands: bool) -> None:
        pipe.blocks.append("".join(lines[upto[-1] : samples]).encode())
        upto.append(samples)
        fits.answers = [fit_of(samples, stands)]
        for _ in range(3):
            before = len(searches.given)
            watch.look()
            if len(searches.given) > before:
                searched_at.append(watch.found.samples)
                searches.answers = [found_in(watch.found.samples)]

    from zwidth.watch.watching import _Watch  # pyright: ignore[reportPrivateUsage]

    watch = _Watch(asked(pipe, tmp_path), told.append, fits, searches)
    for samples, stands in ((500, True), (900, True), (1000, True), (1150, False), (1300, False)):
        look(samples, stands)
    assert searched_at == [500, 1000, 1300]
    assert {u.kind for u in told} == {"gate", "quick", "searched"}


def test_a_fit_of_the_structure_before_is_no_start_for_the_next(
    tmp_path: Path, lines: list[str], monkeypatch: pytest.MonkeyPatch
):
    """A search that ends while a fit is under way has parameters that this fit does not know.

    Mutation: what the fit found is kept, so that each later one begins with too few numbers and
    fails.
    """
    for wait in ("READ_EVERY", "GATE_EVERY", "FIT_EVERY", "BUSY", "GATE_BUSY"):
        monkeypatch.setattr(f"zwidth.watch.watching.{wait}", 0.0)
    searches, fits, told = Idle(), Idle(), list[Update]()
    pipe = Pipe(HEAD.encode())

    from zwidth.watch.watching import _Watch  # pyright: ignore[reportPrivateUsage]

    watch = _Watch(asked(pipe, tmp_path), told.append, fits, searches)
    pipe.blocks.append("".join(lines[:500]).encode())
    watch.look()  # a fit and a search begin
    richer = replace(found_in(500), x=np.zeros(3))
    searches.answers, fits.answers = [richer], []
    watch.look()
    fits.answers = [fit_of(500, True)]  # of what was known before
    watch.look()
    order = fits.given[-1][1]
    assert order.found is richer
    assert order.x is None
    assert [u.kind for u in told if u.kind == "quick"] == []
    fits.answers = [replace(fit_of(500, True), x=np.ones(3))]
    watch.look()
    pipe.blocks.append("".join(lines[500:600]).encode())
    watch.look()
    assert np.array_equal(fits.given[-1][1].x, np.ones(3))


def test_the_gate_tells_each_fault_once_and_within_a_second(tmp_path: Path, lines: list[str]):
    """Mutation: the gate waits for a fit."""
    cut = [",".join((a, f"{min(max(float(b), -0.1), 0.1):.10g}", c))
           for a, b, c in (row.split(",") for row in lines)]  # fmt: skip
    pipe = Pipe(HEAD.encode() + "".join(cut[:1500]).encode())
    told: list[tuple[float, Update]] = []
    watch = asked(pipe, tmp_path)
    gate(read(_warm(tmp_path, cut), None), MOTOR, "warm")  # kernels
    begun = time.monotonic()

    def tell(update: Update) -> None:
        told.append((time.monotonic() - begun, update))
        pipe.blocks, pipe.over = ["".join(cut[1500:]).encode()], True

    found = follow(watch, tell, (Idle(), Idle()))
    assert found.samples == len(lines)
    clipped = [(at, u) for at, u in told if "it was clipped before" in u.sentence]
    assert len(clipped) == 1
    assert clipped[0][0] < 5.0  # a second where nobody else computes
    assert all("cut short" not in u.sentence for _, u in told)


def test_what_reading_shows_is_told_before_the_gate_has_looked(
    tmp_path: Path, lines: list[str], monkeypatch: pytest.MonkeyPatch
):
    """A gap does not wait for signs and units. Mutation: told with what the gate finds."""
    gap = [*lines[:700], *lines[760:1500]]
    pipe = Pipe(HEAD.encode() + "".join(gap).encode())
    told: list[Update] = []
    looked = list[int]()

    def slow(*asked: Any) -> Gate:
        looked.append(len(told))
        return gate(*asked)

    monkeypatch.setattr("zwidth.watch.watching.gate", slow)
    pipe.over = True
    follow(asked(pipe, tmp_path), told.append, (Idle(), Idle()))
    first = next(i for i, u in enumerate(told) if "missing in a gap" in u.sentence)
    assert first < looked[0]


def _warm(folder: Path, lines: list[str]) -> Path:
    path = folder / "warm.csv"
    path.write_text(HEAD + "".join(lines[:1000]))
    return path


def test_a_log_that_has_too_little_waits(tmp_path: Path, lines: list[str]):
    path = tmp_path / "a.csv"
    assert read(path, None).wanting == "nothing has come yet"
    path.write_text(HEAD)
    assert read(path, None).wanting
    path.write_text(HEAD + "".join(lines[:50]))
    found = gate(read(path, None), MOTOR, "a")
    assert found.problem == "50 samples so far, of 200 that are needed"


# --- processes


class Followed:
    """A process that follows a log, and the lines of JSON that it has written."""

    def __init__(self, folder: Path, *line: str, stdin: Any = subprocess.DEVNULL) -> None:
        self.file = folder / "lines.jsonl"
        words = [sys.executable, "-m", "zwidth", "watch", *line]
        words += ["--device", "known.toml", "--effort", "quick", "--json", "lines.jsonl"]
        self.process = subprocess.Popen(
            words, cwd=folder, stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )  # fmt: skip

    def updates(self) -> list[dict[str, Any]]:
        """The updates so far; each line is whole whenever it is read."""
        if not self.file.exists():
            return []
        return [json.loads(line) for line in self.file.read_text().splitlines()]

    def has(self, kind: str) -> bool:
        """Whether an update of a kind is there."""
        return any(u["kind"] == kind for u in self.updates())

    def wait_for(self, kind: str) -> None:
        """Wait until an update of a kind is there."""
        until = time.monotonic() + PATIENCE
        while not self.has(kind):
            assert time.monotonic() < until, self.updates()
            assert self.process.poll() is None, self.process.stderr and self.process.stderr.read()
            time.sleep(0.1)

    def end(self) -> tuple[int, str, str]:
        """Wait for the end: exit status and what was said."""
        out, err = self.process.communicate(timeout=PATIENCE)
        return self.process.returncode, out.decode(), err.decode()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "live").mkdir()
    save_device(MOTOR, tmp_path / "live" / "known.toml")
    return tmp_path / "live"


def offline(folder: Path, name: str, content: bytes, monkeypatch: pytest.MonkeyPatch) -> Any:
    """What `zwidth diagnose` says of the finished log, in a folder of its own."""
    other = folder.parent / "offline"
    other.mkdir()
    save_device(MOTOR, other / "known.toml")
    (other / name).parent.mkdir(exist_ok=True)
    (other / name).write_bytes(content)
    monkeypatch.chdir(other)
    line = ["diagnose", name, "--device", "known.toml", "--effort", "quick", "--json", "r.json"]
    assert cli.run(line) == Status.DONE
    return json.loads((other / "r.json").read_text())


@pytest.mark.truth
def test_a_growing_table_ends_with_the_offline_answer(
    folder: Path, lines: list[str], monkeypatch: pytest.MonkeyPatch
):
    """Mutations: the end answered from the last search; a last line that lacks its end left out."""
    content = (HEAD + "".join(lines)).encode()
    grows = folder / "log.csv"
    grows.write_bytes(content[:30_000])
    followed, done = Followed(folder, "log.csv", "--idle", "6"), 30_000
    with grows.open("ab", buffering=0) as file:
        while done < len(content):
            slowly = len(content) - done > 30_000 and not followed.has("quick")
            step = 61 if slowly else 4_001  # no whole lines
            file.write(content[done : done + step])
            done += step
            time.sleep(0.2 if slowly else 0.02)
    status, out, err = followed.end()
    assert (status, "Traceback" in err) == (Status.DONE, False), err
    updates = followed.updates()
    assert updates[0]["kind"] == "gate"
    assert {"quick", "final"} <= {u["kind"] for u in updates}
    assert [u["samples"] for u in updates] == sorted(u["samples"] for u in updates)
    last = updates[-1]
    assert last["samples"] == len(lines)
    assert last["diagnosis"] == offline(folder, "log.csv", content, monkeypatch)
    assert last["diagnosis"]["findings"]
    walls = [u["wall"] for u in updates if u["kind"] == "quick"]
    assert all(w and w["stable_up_to"] > 1.0 for w in walls)
    assert "is stable up to K = " in out
    fits = [u for u in updates if u["kind"] == "quick" and u["structure"]]
    assert all(u["searched_s"] is not None for u in fits)
    assert (folder / "runs" / "log.diagnosis.html").is_file()


def test_a_pipe_is_kept_and_diagnosed_as_the_file_that_it_became(
    folder: Path, lines: list[str], monkeypatch: pytest.MonkeyPatch
):
    """Mutations: the last line, which has no end, lost; the final answer not among the updates."""
    content = (HEAD + "".join(lines[:150])).encode().rstrip(b"\n")
    asked: list[tuple[Any, ...]] = []

    def diagnosed(console: Any, *given: Any) -> None:
        asked.append(given[:4])
        console.result({"headline": "all is well"})

    monkeypatch.chdir(folder)
    monkeypatch.setattr("zwidth.commands.watch.diagnose_files", diagnosed)
    reads, writes = os.pipe()
    with os.fdopen(reads, "rb") as stream, os.fdopen(writes, "wb") as pipe:
        pipe.write(content)
        pipe.close()
        monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=stream))
        line = ["watch", "-", "--device", "known.toml", "--effort", "quick", "--json", "l.jsonl"]
        assert cli.run(line) == Status.DONE
    assert Path("runs", "stdin.csv").read_bytes() == content
    assert asked == [((Path("runs", "stdin.csv"),), "known.toml", (), "quick")]
    *_, last = [json.loads(line) for line in Path("l.jsonl").read_text().splitlines()]
    assert (last["kind"], last["sentence"]) == ("final", "all is well")
    assert last["diagnosis"] == {"headline": "all is well"}


@pytest.mark.truth
def test_a_pipe_is_kept_and_ends_with_the_offline_answer(
    folder: Path, monkeypatch: pytest.MonkeyPatch
):
    """That nothing is missing, which takes least. Mutation: the last line, without an end, lost."""
    content = (HEAD + "".join(rows(MOTOR, 1.2))).encode().rstrip(b"\n")
    followed = Followed(folder, "-", stdin=subprocess.PIPE)
    pipe = followed.process.stdin
    assert pipe is not None
    pipe.write(content[:30_000])
    pipe.flush()
    followed.wait_for("quick")
    pipe.write(content[30_000:])
    pipe.close()
    followed.process.stdin = None
    status, _, err = followed.end()
    assert status == Status.DONE, err
    assert (folder / "runs" / "stdin.csv").read_bytes() == content
    mine = followed.updates()[-1]["diagnosis"]
    assert mine == offline(folder, "runs/stdin.csv", content, monkeypatch)


@pytest.mark.truth
def test_a_growing_mcap_ends_by_itself_with_the_offline_answer(
    folder: Path, lines: list[str], monkeypatch: pytest.MonkeyPatch
):
    """Mutations: followed beyond its magic; told that it was not closed while it is written."""
    t, u, q = np.array([[float(c) for c in row.split(",")] for row in lines]).T
    units = {"command": "N m", "position_m1": "rad"}
    whole = folder.parent / "whole.mcap"
    write_log(whole, Trace(t, {"command": u, "position_m1": q}, units, "recorded", {}))
    content = whole.read_bytes()
    grows = folder / "log.mcap"
    grows.write_bytes(content[:-10_000])
    followed = Followed(folder, "log.mcap")
    followed.wait_for("quick")
    with grows.open("ab", buffering=0) as file:
        file.write(content[-10_000:])
    status, _, err = followed.end()
    assert status == Status.DONE, err
    updates = followed.updates()
    assert not any("was not closed" in u["sentence"] for u in updates)
    assert updates[-1]["diagnosis"] == offline(folder, "log.mcap", content, monkeypatch)


@pytest.mark.skipif(os.name == "nt", reason="Ctrl-C reaches a whole console there")
def test_a_ctrl_c_that_a_callback_swallowed_ends_it_all_the_same(tmp_path: Path) -> None:
    """Mutation: nobody asks whether one came."""
    with pytest.raises(KeyboardInterrupt):
        follow(asked(Pipe(), tmp_path), lambda _: None, (Idle(), Idle()), lambda: True)


def test_ctrl_c_ends_it_quietly(folder: Path, lines: list[str]):
    (folder / "log.csv").write_text(HEAD + "".join(lines[:1000]))
    followed = Followed(folder, "log.csv")
    followed.wait_for("gate")
    followed.process.send_signal(signal.SIGINT)
    status, out, err = followed.end()
    assert status == Status.DONE
    assert "Traceback" not in err
    assert out.splitlines()[-1].startswith("ended; 'zwidth diagnose log.csv --device known")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (["nowhere.csv"], "does not exist yet"),
        (["."], "is a folder"),
        (["known.toml"], "device"),
        (["log.csv", "--idle", "0"], "give a number above 0"),
        (["log.csv", "--device", "phantom"], "phantom"),
    ],
)
def test_what_cannot_be_followed_is_one_sentence(
    folder: Path,
    line: list[str],
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.chdir(folder)
    (folder / "log.csv").write_text(HEAD)
    assert cli.run(["watch", *line]) == Status.BAD_INPUT
    err = capsys.readouterr().err
    assert said in err
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("empty.csv", b"", "is empty"),
        ("head.csv", HEAD.encode(), "no line of numbers"),
        ("prose.csv", b"this is prose\nand no table\n" * 30, "no line of numbers"),
        ("noise.mcap", b"\x89MCAP0\r\n" + bytes(range(256)) * 9, "damaged or cut short"),
        ("which.csv", b"a,b,c\n" + b"1.5,2.5,3.5\n4.5,5.1,6.2\n" * 200, "a recording TOML"),
    ],
)
def test_what_holds_no_recording_is_one_sentence_in_the_end(
    tmp_path: Path,
    name: str,
    content: bytes,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    """It may still come, so it is waited for; the folder of its copy is named to nobody."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).write_bytes(content)
    assert cli.run(["watch", name, "--idle", "0.3"]) == Status.BAD_INPUT
    err = capsys.readouterr().err
    assert said in err
    assert "zwidth-watch-" not in err
    assert "Traceback" not in err
    assert [line for line in err.splitlines() if line.startswith("error:")] == err.splitlines()[-1:]


def test_a_file_of_the_users_stops_it_at_once(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(folder)
    (folder / "log.csv").write_text(HEAD)
    (folder / "o").mkdir()
    mine = folder / "o" / "log.diagnosis.html"
    mine.write_text("mine\n")
    assert cli.run(["watch", "log.csv", "--out", "o"]) == Status.BAD_INPUT
    assert "was not written by" in capsys.readouterr().err
    assert mine.read_text() == "mine\n"


def test_the_terminal_has_the_last_of_each_kind():
    from rich.console import Console

    from zwidth.watch.display import table

    one = Update("gate", 1.0, 1000, "no fault is seen in the recording")
    two = Update("quick", 2.5, 2500, "coulomb_friction at m1 explains it")
    screen = Console(width=100, record=True, file=StringIO())
    screen.print(table("log.csv", {u.kind: u for u in (one, two, replace(two, seconds=3.0))}))
    text = screen.export_text()
    assert "log.csv: 3.0 s" in text or "log.csv: 2.5 s, 2500 samples" in text
    assert text.count("quick fit") == 1


def test_an_error_that_refuses_nothing_says_why():
    """Mutation: said of every ratio, or of none."""
    x = np.zeros(2)

    def said(ahead: float, stands: bool) -> str:
        return Quick(900, 0.0, 1.0, (), {}, stands, 0.0, ahead, x, None, 0.1).sentence

    assert "3.29 times their noise, which may be chance" in said(3.29, True)
    assert "chance" not in said(1.2, True) + said(3.29, False)

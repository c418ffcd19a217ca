"""`zwidth convert` as a user meets it: what it says, what it writes, what it never destroys."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
import recording_examples as examples
from hypothesis import given, settings
from hypothesis import strategies as st
from log_examples import assert_same, example

from zwidth.cli import run
from zwidth.logs.csv_file import read_csv
from zwidth.logs.export import write_csv
from zwidth.logs.guess import draft, look
from zwidth.logs.mcap_reader import read_log
from zwidth.logs.mcap_writer import write_log
from zwidth.logs.open_source import open_source, read_own
from zwidth.logs.recording import read_recording
from zwidth.logs.source import RecordingError, Signal, Source
from zwidth.sim.trace import Trace

FILES = {
    "a.csv": examples.csv_bytes(200),
    "b.csv": examples.german_csv_bytes(200),
    "a.npz": examples.npz_bytes(200),
    "a.npy": examples.npy_bytes(200),
    "a.mat": examples.mat_bytes(200),
    "b.mat": examples.mat73_bytes(200),
    "a.h5": examples.hdf5_bytes(200),
    "a.parquet": examples.parquet_bytes(200),
    "a.mcap": examples.ros2_bytes(200),
    "b.mcap": examples.json_mcap_bytes(200),
    "c.mcap": examples.protobuf_bytes(200),
}


def written(folder: Path, name: str) -> Path:
    (folder / name).write_bytes(FILES[name])
    return folder / name


@pytest.mark.parametrize("name", FILES)
def test_a_foreign_file_is_listed_and_a_toml_drafted(
    tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, name)
    assert run(["convert", str(path), "--json", "-"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert [s["signal"] for s in result["signals"]] == list(open_source(path).signals)
    assert run(["convert", str(path), str(tmp_path / "draft.toml")]) == 0
    assert (tmp_path / "draft.toml").read_text() == result["toml"]


@pytest.mark.parametrize("name", ["a.csv", "a.h5", "a.mcap", "b.mcap", "c.mcap", "a.parquet"])
def test_a_draft_that_needs_no_answer_reads_the_motion(tmp_path: Path, name: str) -> None:
    path = written(tmp_path, name)
    (tmp_path / "draft.toml").write_text(draft(open_source(path), look(open_source(path))))
    trace = read_recording(tmp_path / "draft.toml")
    t, u, x = examples.wave(200)
    if name == "b.mcap":
        np.testing.assert_allclose(trace["position_m1"], 0.01 * np.cos(40.0 * trace.t), atol=1e-12)
        return
    np.testing.assert_allclose(trace.t, t, atol=1e-12)
    np.testing.assert_allclose(trace["command"], u)
    np.testing.assert_allclose(trace["position_m1"], x, rtol=1e-6)


def test_a_draft_asks_for_what_no_file_tells(tmp_path: Path) -> None:
    source = read_csv(tmp_path / "a.csv", b"t [ms],u [V],q [counts]\n0,1,2\n1,2,4\n2,1,5\n")
    (tmp_path / "a.csv").write_bytes(b"t [ms],u [V],q [counts]\n0,1,2\n1,2,4\n2,1,5\n")
    text = draft(source, look(source))
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(RecordingError, match="give counts_per_rev"):
        read_recording(tmp_path / "a.toml")
    text = text.replace("# counts_per_rev =", "counts_per_rev = 4000")
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(RecordingError, match="give scale, in N m or N per V"):
        read_recording(tmp_path / "a.toml")
    (tmp_path / "a.toml").write_text(text.replace("# scale =", "scale = 0.5"))
    trace = read_recording(tmp_path / "a.toml")
    np.testing.assert_allclose(trace["position_m1"], np.array([2, 4, 5]) * 2 * np.pi / 4000)
    np.testing.assert_allclose(trace.t, [0.0, 0.001, 0.002])


@settings(max_examples=25)
@given(st.dictionaries(st.text(max_size=8), st.text(max_size=4), min_size=1, max_size=5))
def test_a_draft_is_toml_whatever_signals_are_called(names: dict[str, str]) -> None:
    import tomllib

    rng = np.random.default_rng(0)
    signals = {name: Signal(name, rng.normal(size=9), unit) for name, unit in names.items()}
    source = Source(Path("a.npz"), "NPZ", signals)
    assert tomllib.loads(draft(source, look(source)))["file"] == "a.npz"


def test_the_step_of_the_encoder_is_listed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    t = 0.001 * np.arange(2000)
    step = 2.0 * np.pi / 4096
    np.savez(tmp_path / "a.npz", t=t, angle=np.rint(0.3 * np.sin(9.0 * t) / step) * step)
    assert run(["convert", str(tmp_path / "a.npz")]) == 0
    line = next(x for x in capsys.readouterr().out.splitlines() if x.startswith("angle"))
    assert f"{step:.6g}" in line
    assert " 1000 " in line
    assert line.rstrip().endswith("position")


@pytest.mark.parametrize("suffix", [".mcap", ".npz", ".parquet", ".csv"])
def test_ours_through_every_format(
    tmp_path: Path, suffix: str, capsys: pytest.CaptureFixture[str]
) -> None:
    trace = example(50)
    write_log(tmp_path / "run.mcap", trace, attachments={"device.toml": b"x"}, epoch_ns=0)
    other = tmp_path / f"other{suffix}"
    assert run(["convert", str(tmp_path / "run.mcap"), str(other)]) == 0
    said = capsys.readouterr().out
    assert ("device.toml" in said) == (suffix == ".csv")
    assert run(["convert", str(other), str(tmp_path / "back.mcap")]) == 0
    assert_same(read_log(tmp_path / "back.mcap").tick, trace)
    assert_same(read_own(other).tick, trace)
    assert run(["convert", str(other)]) == 0
    assert "position_m1" in capsys.readouterr().out


def test_a_recording_becomes_a_log_that_tells_its_conversion(tmp_path: Path) -> None:
    path = written(tmp_path, "a.csv")
    text = draft(open_source(path), look(open_source(path)))
    (tmp_path / "a.toml").write_text(text)
    assert run(["convert", str(tmp_path / "a.toml"), str(tmp_path / "run.mcap")]) == 0
    log = read_log(tmp_path / "run.mcap")
    assert_same(log.tick, read_recording(tmp_path / "a.toml"))
    assert log.tick.facts == read_recording(tmp_path / "a.toml").facts
    assert log.attachments == {"a.toml": text.encode()}


def test_extremes_are_those_of_what_is_finite(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Mutation that breaks it: least and most of all values."""
    holes, none = np.array([np.nan, -1.0, 2.0, np.inf]), np.full(4, np.nan)
    channels, units = {"holes": holes, "none": none}, {"holes": "m", "none": "m"}
    write_log(tmp_path / "a.mcap", Trace(np.arange(4.0), channels, units, "recorded"), epoch_ns=0)
    assert run(["convert", str(tmp_path / "a.mcap"), "--json", "-"]) == 0
    seen = json.loads(capsys.readouterr().out)["channels"]
    assert [c["least"] for c in seen[:1]] == [-1.0]
    assert [c["most"] for c in seen[:1]] == [2.0]
    assert seen[1]["least"] == seen[1]["most"]


@pytest.mark.parametrize(
    ("source", "target", "words"),
    [
        ("none.csv", None, "does not exist"),
        (".", None, "is a folder"),
        ("a.csv", "b.xlsx", "a log is written as .mcap, .csv, .parquet, .npz"),
        ("a.csv", "b.mcap", "describe it in a recording TOML"),
        ("a.csv", "here.toml", "was not written by 'zwidth convert'"),
        ("run.mcap", "run.mcap", "is an input; give another file to write"),
        ("run.mcap", "run.toml", "needs no TOML"),
        ("empty.csv", None, "is empty"),
        ("words.json", "out.toml", "words.json holds no array of numbers"),
        ("words.json", None, "words.json holds no array of numbers"),
    ],
)
def test_mistakes_are_one_sentence_and_exit_2(
    tmp_path: Path,
    source: str,
    target: str | None,
    words: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    written(tmp_path, "a.csv")
    Path("here.toml").write_text("mine")
    Path("empty.csv").write_text("")
    Path("words.json").write_text('{"a": "b"}')
    write_log("run.mcap", example(5), epoch_ns=0)
    assert run(["convert", source, *([target] if target else [])]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert Path("here.toml").read_text() == "mine"


@pytest.mark.parametrize("made", ["cut short", "never begun", "as a table"])
def test_a_log_without_a_sample_is_one_sentence_and_exit_2(
    tmp_path: Path, made: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whoever reads recordings refuses it, with why there is none.

    Mutation: `_with_samples` left out for either kind of file.
    """
    log = tmp_path / "run.mcap"
    write_log(log, example(500 if made == "cut short" else 0), epoch_ns=0)
    if made == "cut short":
        log.write_bytes(log.read_bytes()[: log.stat().st_size // 2])  # within its only chunk
    assert len(read_log(log).tick) == 0
    if made == "as a table":
        table = tmp_path / "run.csv"
        with table.open("wb") as stream:
            write_csv(stream, read_log(log))
        log = table
    target = tmp_path / "target.npz"
    out = ["--out", str(tmp_path / "out")]
    for command in (
        ["convert", str(log)],
        ["convert", str(log), str(target)],
        ["diagnose", str(log), "--device", "phantom_1_0", *out],
        ["identify", str(log), *out],
    ):
        assert run(command) == 2, command
        error = capsys.readouterr().err
        assert "holds no sample" in error
        assert error.count("\n") == 1
    assert not target.exists()


@pytest.mark.parametrize("suffix", [".mcap", ".npz", ".parquet", ".csv"])
def test_a_crash_while_writing_leaves_the_older_file(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Mutation that breaks it: writing to the target itself instead of `replacing` it."""
    old = tmp_path / f"old{suffix}"
    write_log(tmp_path / "run.mcap", example(5), epoch_ns=0)
    assert run(["convert", str(tmp_path / "run.mcap"), str(old)]) == 0
    before = old.read_bytes()

    def no_room(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", no_room)
    assert run(["convert", str(tmp_path / "run.mcap"), str(old)]) == 1
    assert old.read_bytes() == before

"""Replay: the same bits from the log alone, or the first tick and channel that differ."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from physics_examples import example

from zwidth import cli
from zwidth.controllers.none import none
from zwidth.controllers.recorded import recorded
from zwidth.controllers.wall import wall
from zwidth.heartbeat import HEART
from zwidth.logs.errors import LogError, LogWriteError
from zwidth.logs.mcap_reader import read_log
from zwidth.logs.mcap_writer import write_log
from zwidth.scenarios.disturbance import Disturbance
from zwidth.scenarios.logged_run import logged_run
from zwidth.scenarios.replay import ReplayError, replay
from zwidth.scenarios.scenario import Scenario
from zwidth.scenarios.scenario_file import ScenarioError, scenario_to_text
from zwidth.sim import equations
from zwidth.sim.controller import user_controller
from zwidth.sim.device_file import load_device
from zwidth.sim.physics import make_physics
from zwidth.sim.run import Outcome, Start
from zwidth.sim.trace import Trace

PHANTOM = load_device("phantom_1_0")
FRICTION = make_physics("coulomb_friction", "m1", level=0.004)
ROUGH = PHANTOM.with_physics(FRICTION, make_physics("actuator_lag", "command", time_constant=4e-4))


def integral(k, t, y, v, p, m):  # pyright: ignore
    m[1] += y
    return -p[0] * y - p[1] * m[1] - 0.02 * v


def other(k, t, y, v, p, m):  # pyright: ignore
    m[1] += y
    return -p[0] * y - p[1] * m[1] - 0.03 * v


SCENARIOS = {
    "wall": Scenario(PHANTOM, wall(20.0, 0.05), 1.5, Start(1e-3)),
    "one-sided": Scenario(
        PHANTOM.with_interface(delay=0.00237, encoder_step=2e-4, command_step=1e-3),
        wall(15.0, 0.02, 0.0, True), 1.2, Start((-0.01, -0.011, -0.009), 0.4),
    ),
    "friction": Scenario(ROUGH, wall(15.0, 0.02), 0.4, Start(2e-3), substeps=7, fine=True),
    "recorded": Scenario(
        PHANTOM, recorded(np.random.default_rng(1).normal(size=300) * 0.1), 0.5, energy="none"
    ),
    "user": Scenario(PHANTOM, user_controller(integral, np.array([8.0, 0.1]), 2), 0.5, Start(1e-3)),
    "disturbed": Scenario(
        PHANTOM, none(), 1.1, Start(),
        (Disturbance("noise", 0.1), Disturbance("sine", 0.1, "m3", 0.2, frequency_hz=20.0)),
        seed=7, energy="stored",
    ),
    "random": Scenario(
        PHANTOM.with_physics(make_physics("dropped_samples", "clock", rate=0.2)),
        wall(10.0, 0.02), 0.3, Start(1e-3), seed=2**40 + 3,
    ),
    "over time": Scenario(
        PHANTOM.with_physics(example("free_force", "m2"), example("free_product", "m2")),
        wall(10.0, 0.02), 0.3, Start(1e-3),
    ),
    "escaping": Scenario(PHANTOM, wall(80.0, 0.0), 9.0, Start(1e-3), bound=10.0),
    "overflowing": Scenario(PHANTOM, wall(300.0, 0.0), 9.0, Start(1e-3), bound=np.inf),
}  # fmt: skip


def log_of(name: str, folder: Path) -> Path:
    path = folder / f"{name}.mcap"
    logged_run(SCENARIOS[name], path)
    return path


def rewrite(path: Path, **changes: Trace | None) -> Path:
    """Write the log anew, whole and with checksums that hold, with other samples in it."""
    log = read_log(path)
    assert not log.warnings
    traces = {"tick": log.tick, "substep": log.substep} | changes
    assert traces["tick"] is not None
    write_log(
        path, traces["tick"], substep=traces["substep"], metadata=log.metadata,
        attachments=log.attachments, epoch_ns=log.epoch_ns, overwrite=True,
    )  # fmt: skip
    return path


def with_attachment(path: Path, **attachments: bytes) -> Path:
    log = read_log(path)
    changed = dict(log.attachments) | {k.replace("_", "."): v for k, v in attachments.items()}
    write_log(
        path, log.tick, metadata=log.metadata, attachments=changed, epoch_ns=log.epoch_ns,
        overwrite=True,
    )  # fmt: skip
    return path


def flipped(trace: Trace, channel: str, row: int) -> Trace:
    """Return the trace with the lowest bit of one value turned over."""
    t, channels = trace.t.copy(), {name: v.copy() for name, v in trace.channels.items()}
    values = t if channel == "time" else channels[channel]
    values.view(np.uint64)[row] ^= 1
    return trace.with_channels(channels, t)


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_kind_of_run_replays_bit_for_bit(name: str, tmp_path: Path):
    """Mutation: `bound` not written to the scenario file; or `position` of a start of three."""
    scenario = SCENARIOS[name]
    logged = logged_run(scenario, tmp_path / "a.mcap")
    result = replay(tmp_path / "a.mcap", integral if name == "user" else None)
    assert result.identical
    assert (result.first_difference, result.notes) == (None, ())
    assert result.ticks == len(logged.run.trace)
    ended = {"escaping": Outcome.ESCAPED, "overflowing": Outcome.NOT_FINITE}
    assert logged.run.outcome is ended.get(name, Outcome.COMPLETED)


def test_the_log_is_the_run(tmp_path: Path):
    logged = logged_run(SCENARIOS["disturbed"], tmp_path / "a.mcap")
    log = read_log(tmp_path / "a.mcap")
    assert list(log.tick.channels) == list(logged.run.trace.channels)
    for name, values in logged.run.trace.channels.items():
        assert log.tick[name].tobytes() == values.tobytes()
    forces = SCENARIOS["disturbed"].forces()
    assert forces is not None
    assert log.tick["disturbance_m3"].tobytes() == forces[:, 2].tobytes()
    assert "disturbance_m2" not in log.tick.channels


def test_another_processor_replays_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Propagators that differ in their last bits. Mutation: replay with its own propagators."""
    exact = equations.propagator
    monkeypatch.setattr(equations, "propagator", lambda *a: exact(*a) * (1.0 + 2.0**-50))
    equations.mechanism.cache_clear()  # another processor remembers nothing of this one
    path = log_of("friction", tmp_path)
    monkeypatch.undo()
    equations.mechanism.cache_clear()
    assert replay(path).identical
    kept = read_log(path).tick["position_m1"]
    log_of("friction", tmp_path)
    assert not np.array_equal(kept, read_log(path).tick["position_m1"])


@pytest.mark.parametrize(
    ("name", "channel", "tick"),
    [
        ("wall", "position_m3", 0),
        ("wall", "position_m3", 1234),
        ("wall", "velocity_m1", 999),
        ("wall", "command", 1000),
        ("wall", "work_b1", 1499),
        ("wall", "contact", 7),
        ("wall", "time", 640),
        ("disturbed", "disturbance_m1", 1001),
    ],
)
def test_one_flipped_bit_is_named(name: str, channel: str, tick: int, tmp_path: Path):
    path = log_of(name, tmp_path)
    log = read_log(path)
    rewrite(path, tick=flipped(log.tick, channel, tick))
    result = replay(path)
    first = result.first_difference
    assert not result.identical
    assert first is not None
    assert (first.tick, first.topic, first.channel) == (tick, "/tick", channel)
    assert first.time == tick * 0.001
    if channel != "time":
        assert first.replayed == log.tick[channel][tick]
        assert first.logged == flipped(log.tick, channel, tick)[channel][tick]


def test_the_earliest_difference_wins(tmp_path: Path):
    """Mutation: `min` over channels instead of over ticks."""
    path = log_of("wall", tmp_path)
    early = flipped(read_log(path).tick, "work_b23", 300)
    first = replay(rewrite(path, tick=flipped(early, "position_m1", 301))).first_difference
    assert first is not None
    assert (first.tick, first.channel) == (300, "work_b23")


def test_a_flipped_substep_is_named(tmp_path: Path):
    """Row 2000 of seven a tick, where the delay's remainder is none: tick 285."""
    path = log_of("friction", tmp_path)
    substep = read_log(path).substep
    assert substep is not None
    assert len(substep) == 400 * 7
    first = replay(rewrite(path, substep=flipped(substep, "velocity_m2", 2000))).first_difference
    assert first is not None
    assert (first.tick, first.topic, first.channel) == (285, "/substep", "velocity_m2")
    assert first.time == substep.t[2000]


def kept(trace: Trace, rows: list[int]) -> Trace:
    return trace.with_channels({n: v[rows] for n, v in trace.channels.items()}, trace.t[rows])


@pytest.mark.parametrize(
    ("rows", "tick", "logged", "replayed"),
    [
        ([*range(700), *range(701, 1500)], 700, None, 700 * 0.001),
        ([*range(1400)], 1400, None, 1400 * 0.001),
        ([*range(1000), *range(1200, 1500)], 1000, None, 1.0),
        ([*range(5), *range(4, 1500)], 4, 0.004, None),
    ],
)
def test_a_sample_too_few_or_too_many_is_named(
    rows: list[int], tick: int, logged: float | None, replayed: float | None, tmp_path: Path
):
    path = log_of("wall", tmp_path)
    first = replay(rewrite(path, tick=kept(read_log(path).tick, rows))).first_difference
    assert first == (tick, tick * 0.001, "/tick", "time", logged, replayed)


def test_samples_after_the_end_are_named(tmp_path: Path):
    path = log_of("wall", tmp_path)
    tick = read_log(path).tick
    longer = {name: np.append(v, v[-1]) for name, v in tick.channels.items()}
    rewrite(path, tick=tick.with_channels(longer, np.append(tick.t, 1.5)))
    assert replay(path).first_difference == (1500, 1.5, "/tick", "time", 1.5, None)


def test_a_cut_log_replays_as_far_as_it_goes(tmp_path: Path):
    """At any length: identical and said to be cut, or one sentence; never silence."""
    path = log_of("one-sided", tmp_path)
    data = path.read_bytes()
    ticks, refusals = set[int](), list[str]()
    for size in np.linspace(1, len(data) - 1, 20).astype(int):
        path.write_bytes(data[:size])
        try:
            result = replay(path)
        except (LogError, ReplayError) as error:
            refusals.append(str(error))
        else:
            assert result.identical
            assert result.notes
            ticks.add(result.ticks)
    assert {1000, 1200} <= ticks
    assert refusals
    assert not any("\n" in refusal for refusal in refusals)


@pytest.mark.parametrize("lost", [(0, 100), (300, 420), (900, 1000)])
def test_a_damaged_log_compares_what_is_left(
    lost: tuple[int, int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Whole blocks lost in the middle: the rest is compared at its own ticks."""
    monkeypatch.setattr("zwidth.scenarios.logged_run.BLOCK_TICKS", 100)
    path = log_of("wall", tmp_path)
    log, data = read_log(path), bytearray(path.read_bytes())
    share = [len(data) * place // 1500 for place in lost]
    data[share[0] + 30_000 : share[1] + 30_000] = bytes(share[1] - share[0])
    path.write_bytes(data)
    result = replay(path)
    assert result.identical
    assert any("missing" in note for note in result.notes)
    assert 1000 <= result.ticks < len(log.tick)


def test_an_interrupted_run_keeps_its_blocks(tmp_path: Path):
    done = list[int]()

    def stop(ticks: int) -> None:
        done.append(ticks)
        if len(done) == 3:
            raise KeyboardInterrupt

    long = replace(SCENARIOS["wall"], duration=60.0)
    with pytest.raises(KeyboardInterrupt):
        logged_run(long, tmp_path / "a.mcap", on_block=stop)
    assert not (tmp_path / "a.mcap").exists()
    result = replay(tmp_path / "a.partial.mcap")
    assert result.identical
    assert result.ticks == 3000
    assert any("KeyboardInterrupt" in note for note in result.notes)


def test_a_full_disk_keeps_what_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    write, room = os.write, 600_000

    def limited(descriptor: int, data: bytes) -> int:
        nonlocal room
        if len(data) > room:
            raise OSError(errno.ENOSPC, "No space left on device")
        room -= len(data)
        return write(descriptor, data)

    monkeypatch.setattr(os, "write", limited)
    with pytest.raises(LogWriteError, match=r"there is no room left; what was logged before"):
        logged_run(replace(SCENARIOS["wall"], duration=60.0), tmp_path / "a.mcap")
    monkeypatch.undo()
    result = replay(tmp_path / "a.partial.mcap")
    assert result.identical
    assert result.ticks >= 2000


@pytest.mark.skipif(os.name == "nt", reason="there is no SIGKILL")
def test_kill_leaves_a_log_that_replays(tmp_path: Path):
    """Mutation: a writer that keeps its chunks in memory until it is closed."""
    scenario = tmp_path / "s.toml"
    text = scenario_to_text(replace(SCENARIOS["wall"], duration=1e5, energy="none"))
    scenario.write_text(text)
    line = [sys.executable, "-m", "zwidth", "simulate", str(scenario), "--out", str(tmp_path)]
    process = subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    partial = tmp_path / "s.partial.mcap"
    until = time.monotonic() + 60.0
    while not (partial.exists() and partial.stat().st_size > 300_000):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < until
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    result = replay(partial)
    assert result.identical
    assert result.ticks >= 2000
    assert any("was not closed" in note for note in result.notes)


def test_your_own_law_and_its_source(tmp_path: Path):
    path = log_of("user", tmp_path)
    with pytest.raises(ScenarioError, match=r"supply it with --controller test_replay:integral"):
        replay(path)
    result = replay(path, other)
    (note,) = result.notes
    assert note == (
        "the source of test_replay:other is not the one that ran as test_replay:integral when the"
        " log was written"
    )
    first = result.first_difference
    assert first is not None
    assert first.channel == "command"
    with pytest.raises(ScenarioError, match=r"which is built in; leave your function out"):
        replay(log_of("wall", tmp_path), integral)


def test_what_cannot_be_replayed_is_one_sentence(tmp_path: Path):
    path = log_of("wall", tmp_path)
    recording = tmp_path / "recording.mcap"
    write_log(recording, read_log(path).tick)
    with pytest.raises(ReplayError, match=r"has no attachment 'scenario\.toml': only a log that"):
        replay(recording)
    log = read_log(path)
    empty = log.tick.with_channels({n: v[:0] for n, v in log.tick.channels.items()}, log.tick.t[:0])
    write_log(recording, empty, attachments=log.attachments)
    with pytest.raises(ReplayError, match=r"holds no sample; there is nothing to compare"):
        replay(recording)
    fewer = {name: v for name, v in log.tick.channels.items() if name != "applied"}
    write_log(recording, log.tick.with_channels(fewer), attachments=log.attachments)
    with pytest.raises(ReplayError, match=r"/tick has no applied, which its scenario records"):
        replay(recording)


@pytest.mark.parametrize("scalars", [4, 7])
def test_a_log_of_an_earlier_version_is_replayed(scalars: int, tmp_path: Path):
    """Its memory had fewer numbers. Mutation: those that it lacks left out."""
    path = log_of("wall", tmp_path)
    with np.load(BytesIO(read_log(path).attachments["computed.npz"])) as file:
        kept = {name: file[name] for name in file.files}
    kept["start_scalars"] = kept["start_scalars"][:scalars]
    np.savez_compressed(earlier := BytesIO(), **kept)  # pyright: ignore[reportArgumentType]
    with_attachment(path, computed_npz=earlier.getvalue())
    assert replay(path).identical


def test_a_log_of_another_device_is_refused(tmp_path: Path):
    """Numbers of a wall 1e-6 stiffer, or of a device 1e-6 heavier, are not those of the log."""
    path = log_of("wall", tmp_path)
    text = read_log(path).attachments["device.toml"].decode()
    heavier = text.replace("m_kgm2 = 0.001168", "m_kgm2 = 0.001168001168")
    assert heavier != text
    with_attachment(path, device_toml=heavier.encode())
    with pytest.raises(ReplayError, match=r"propagators in the log differs from what its device"):
        replay(path)
    with_attachment(path, computed_npz=b"PK no")
    with pytest.raises(ReplayError, match=r"the computed numbers in the log cannot be read"):
        replay(path)


Lines = Callable[..., tuple[int, str, str]]


@pytest.fixture
def zwidth(capsys: pytest.CaptureFixture[str]) -> Lines:
    def call(*words: str) -> tuple[int, str, str]:
        status = cli.run(list(words))
        out, err = capsys.readouterr()
        return status, out, err

    return call


def test_simulate_and_replay_on_the_command_line(tmp_path: Path, zwidth: Lines):
    (tmp_path / "s.toml").write_text(scenario_to_text(SCENARIOS["wall"]))
    status, out, _ = zwidth("simulate", f"{tmp_path}/s.toml", "--out", f"{tmp_path}", "--json", "-")
    assert status == 0
    result = json.loads(out)
    assert (result["ticks"], result["outcome"], result["verdict"]) == (1500, "completed", "decays")
    assert abs(result["energy"]["imbalance"]) < 1e-9 * result["energy"]["turned_over"]
    assert Path(result["picture"]).read_bytes().startswith(b"\x89PNG")
    status, out, _ = zwidth("replay", result["log"], "--json", "-")
    assert status == 0
    assert json.loads(out) == {
        "identical": True, "ticks": 1500, "first_difference": None, "warnings": [],
    }  # fmt: skip
    path = Path(result["log"])
    rewrite(path, tick=flipped(read_log(path).tick, "encoder", 77))
    status, out, err = zwidth("replay", str(path), "--json", "-")
    assert status == 1
    assert json.loads(out)["first_difference"]["channel"] == "encoder"
    assert "different: first at tick 77 (t = 0.077 s), /tick encoder: logged" in err


def test_it_says_how_far_it_is(tmp_path: Path, zwidth: Lines, monkeypatch: pytest.MonkeyPatch):
    """Mutation: only the first block is told."""
    begun: list[str] = []
    monkeypatch.setattr(HEART, "begins", begun.append)
    assert zwidth("replay", str(log_of("wall", tmp_path)))[0] == 0
    shares = ("0 %", "67 %", "100 %")  # 1500 ticks in blocks of 1000
    assert begun == ["reading wall.mcap", *(f"simulating again, {s}" for s in shares)]


def test_your_own_law_on_the_command_line(
    tmp_path: Path, zwidth: Lines, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "my_law.py").write_text("def law(k, t, y, v, p, m):\n    return -p[0] * y\n")
    (tmp_path / "my_bad.py").write_text("1 / 0\n")
    (tmp_path / "s.toml").write_text(
        'duration_s = 0.2\n[device]\nname = "phantom_1_0"\n[start]\nposition = 1e-3\n[controller]\n'
        'kind = "user"\nfunction = "my_law:law"\nparameters = [5.0]\n'
    )
    monkeypatch.chdir(tmp_path)
    assert zwidth("simulate", "s.toml", "--controller", "my_law:law")[0] == 0
    assert zwidth("replay", "runs/s.mcap", "--controller", "my_law:law")[0] == 0
    for given, sentence in (
        ("my_law:lw", "module my_law has no function lw"),
        ("my_bad:law", "module my_bad cannot be imported: ZeroDivisionError"),
        ("my_law", "my_law is not allowed; give module:function"),
    ):
        status, out, err = zwidth("replay", "runs/s.mcap", "--controller", given)
        assert (status, out) == (2, "")
        assert sentence in err
        assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "does not exist; check the name"),
        (b"", "is empty; check the program that wrote it"),
        (b"position,time\n1,2\n", "is not an MCAP file: it starts with"),
        (b"\x89MCAP0\r\n", "is damaged or cut short before its first sample"),
    ],
)
def test_a_file_that_is_no_log_is_one_sentence(
    content: bytes | None, words: str, tmp_path: Path, zwidth: Lines
):
    path = tmp_path / "a.mcap"
    if content is not None:
        path.write_bytes(content)
    status, out, err = zwidth("replay", str(path))
    assert (status, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1


def test_simulate_that_cannot_be_is_one_sentence(tmp_path: Path, zwidth: Lines):
    bad = tmp_path / "s.toml"
    bad.write_text("duration_s = nan\n[device]\nname='phantom_1_0'\n[controller]\nkind='none'\n")
    for words, sentence in (
        ((str(bad),), "duration_s is nan; it must be a finite time above 0 s"),
        ((f"{tmp_path}/none.toml",), "there is no file"),
        ((str(bad), "--out", str(bad)), "is a file"),
    ):
        status, _, err = zwidth("simulate", *words)
        assert status == 2
        assert sentence in err
        assert err.count("\n") == 1

"""A newcomer at the door: a CSV of a rig, one command, an answer that names what is there.

The rigs are simulated here, by scipy, in degrees and at 500 Hz; nothing of zwidth makes them. What
they give at the default effort, `benchmarks/newcomer.py` says (docs/first_answers.md); here one of
them has it, and the others are quick. All but friction are asked for with -m truth; so is play, for
which a quick look does not look, with the effort that finds it.
"""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import zwidth.diagnose_files
from zwidth.cli import run
from zwidth.diagnosis.answer.result import Diagnosis
from zwidth.diagnosis.selection.effort import EFFORTS, QUICK
from zwidth.errors import Status
from zwidth.logs.assumed import assumed
from zwidth.logs.errors import LogError
from zwidth.logs.open_source import open_source
from zwidth.sim.device_file import load_device

Floats = NDArray[np.float64]
RATE, MASS, DAMPER = 500.0, 1.5e-3, 4e-3  # Hz, kg m2, N m s/rad
FRICTION, WEIGHT, LIMIT = 0.04, 0.08, 0.15  # N m
LOAD, SHAFT, PLAY = 0.8e-3, 12.0, 0.02  # kg m2, N m/rad, rad from one side to the other
SHARP, SMOOTH = 3e-4, 3e-3  # rad/s, over which a simulator turns its friction
Load = Callable[[float, float], float]


def command(seconds: float) -> Floats:
    """A sum of sines from 0.3 to 40 Hz of 0.3 N m at most."""
    random, t = np.random.default_rng(0), np.arange(round(seconds * RATE)) / RATE
    f = np.geomspace(0.3, 40.0, 24)
    u = np.sum(np.sin(2 * np.pi * f * t[:, None] + random.uniform(0, 7, f.size)) / f**0.25, axis=1)
    return 0.3 * u / np.abs(u).max()


def swung(u: Floats, load: Load) -> Floats:
    """Return the angle [rad] of one mass under a command held over each sample, and a load."""

    def slope(t: float, x: Floats) -> list[float]:
        force = u[min(int(t * RATE + 1e-9), u.size - 1)]
        return [x[1], (force - DAMPER * x[1] + load(x[0], x[1])) / MASS]

    x, angle = np.zeros(2), np.empty(u.size)
    for k in range(u.size):
        angle[k] = x[0]
        span = (k / RATE + 1e-10, (k + 1) / RATE - 1e-10)
        x = solve_ivp(slope, span, x, method="LSODA", rtol=1e-8, atol=1e-10).y[:, -1]
    return angle


def save(path: Path, u: Floats, angle: Floats, header: str = "time,torque_Nm,angle_deg") -> None:
    """Write what a rig's own program would: seconds, N m, and degrees with 0.002 of noise."""
    noise = 0.002 * np.random.default_rng(1).standard_normal(u.size)
    table = np.column_stack([np.arange(u.size) / RATE, u, np.rad2deg(angle) + noise])
    np.savetxt(path, table, "%.7g", ",", header=header, comments="")


RIGS: dict[str, tuple[str, Load, bool]] = {
    "friction": ("coulomb_friction", lambda _, v: -FRICTION * np.tanh(v / SHARP), False),
    "gravity": ("gravity_pendulum", lambda q, _: -WEIGHT * np.sin(q), False),
    "saturation": ("saturation", lambda *_: 0.0, True),
}
TRUTH = {"friction": FRICTION, "gravity": WEIGHT, "saturation": LIMIT}


@pytest.mark.parametrize(
    "name",
    ["friction", *(pytest.param(n, marks=pytest.mark.truth) for n in RIGS if n != "friction")],
)
def test_one_command_from_a_file_to_an_answer(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """Mutations: the degrees read as radians; friction and gravity left in the fit's damper."""
    monkeypatch.chdir(tmp_path)
    effect, load, clipped = RIGS[name]
    u = command(3.0)
    save(Path("data.csv"), u, swung(np.clip(u, -LIMIT, LIMIT) if clipped else u, load))
    effort = [] if name == "saturation" else ["--effort", "quick"]  # the shortest at the default
    line = ["diagnose", "data.csv", *effort, "--json", "runs/answer.json"]
    assert run(line) == Status.DONE
    out, err = capsys.readouterr()
    answer = json.loads(Path("runs/answer.json").read_text())
    assert [finding["effect"] for finding in answer["findings"]] == [effect]
    values = answer["findings"][0]["parameters"]
    assert next(iter(values.values()))["value"] == pytest.approx(TRUTH[name], rel=0.03)
    assert answer["linear_refit"]["m1"]["value"] == pytest.approx(MASS, rel=0.01)
    assert effect in out
    for said in ("time [s], 500 samples a second", "torque_Nm [Nm]", "angle_deg [deg]", "one mass"):
        assert said in err
    fitted = load_device("runs/data.device.toml").chain.masses  # what rubs may pass for a mode
    assert fitted.sum() == pytest.approx(MASS, rel=0.2)
    for file in ("recording.toml", "device.toml", "augmented.toml", "diagnosis.html"):
        assert Path("runs", f"data.{file}").is_file()


@pytest.mark.truth
def test_friction_that_a_simulator_smooths_is_seen_to_rise(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """It is zero at rest and reaches its level at ten times the speed of the tanh.

    Mutation: friction that rises out of the library; then dry friction is `identified`.
    """
    monkeypatch.chdir(tmp_path)
    u = command(3.0)
    save(Path("data.csv"), u, swung(u, lambda _, v: -FRICTION * np.tanh(v / SMOOTH)))
    line = ["diagnose", "data.csv", "--effort", "quick", "--json", "runs/answer.json"]
    assert run(line) == Status.DONE
    assert "Friction that rises from" in capsys.readouterr().out
    (found,) = json.loads(Path("runs/answer.json").read_text())["findings"]
    assert found["effect"] == "rising_friction"
    assert found["parameters"]["level"]["value"] == pytest.approx(FRICTION, rel=1e-3)


def both_sides(u: Floats) -> Floats:
    """Return the angles [rad] of motor and load, (ticks, 2), with play in the shaft between."""

    def slope(t: float, x: Floats) -> list[float]:
        bent = x[0] - x[2]
        torque = SHAFT * (bent - np.clip(bent, -0.5 * PLAY, 0.5 * PLAY))
        force = u[min(int(t * RATE + 1e-9), u.size - 1)]
        return [x[1], (force - DAMPER * x[1] - torque) / MASS, x[3], (torque - 2e-3 * x[3]) / LOAD]

    x, angles = np.zeros(4), np.empty((u.size, 2))
    for k in range(u.size):
        angles[k] = x[0], x[2]
        span = (k / RATE + 1e-10, (k + 1) / RATE - 1e-10)
        x = solve_ivp(slope, span, x, rtol=1e-7, atol=1e-10).y[:, -1]
    return angles


@pytest.mark.truth
def test_play_between_motor_and_load_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """With an effort between quick, which looks for no play, and normal, which tries much more.

    Mutations: the load's column left out; springs of a fitted device trusted to a third, as those
    of a data sheet are (across play it is fitted far too soft).
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(EFFORTS, "quick", replace(QUICK, effects=1, generations=20, members=8))
    u = command(2.0)
    noise = 0.002 * np.random.default_rng(1).standard_normal((u.size, 2))
    table = np.column_stack([np.arange(u.size) / RATE, u, np.rad2deg(both_sides(u)) + noise])
    header = "time,torque_Nm,motor_angle_deg,load_angle_deg"
    np.savetxt("data.csv", table, "%.7g", ",", header=header, comments="")
    line = ["diagnose", "data.csv", "--effort", "quick", "--json", "runs/answer.json"]
    assert run(line) == Status.DONE
    err = capsys.readouterr().err
    assert (
        "motor_angle_deg is taken for the side that is driven, load_angle_deg for the other" in err
    )
    assert "two masses are assumed" in err
    (finding,) = json.loads(Path("runs/answer.json").read_text())["findings"]
    assert (finding["effect"], finding["at"]) == ("backlash", "link12")
    assert finding["parameters"]["gap"]["value"] == pytest.approx(PLAY, rel=0.02)


def test_what_was_edited_is_read_and_not_written_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """What is found the second time is that of the first: files are the matter here.

    Mutation: the draft written without a look at what stands there.
    """
    monkeypatch.chdir(tmp_path)
    u = command(2.0)
    save(Path("data.csv"), u, swung(u, lambda *_: 0.0))
    line = ["diagnose", "data.csv", "--effort", "quick"]
    kept: list[Diagnosis] = []
    real = zwidth.diagnose_files.diagnose

    def keeping(*asked: Any) -> Diagnosis:
        kept.append(real(*asked))
        return kept[-1]

    monkeypatch.setattr(zwidth.diagnose_files, "diagnose", keeping)
    assert run(line) == Status.DONE
    assert "nothing_missing" in capsys.readouterr().out
    for file in (Path("runs/data.recording.toml"), Path("runs/data.device.toml")):
        file.write_text(file.read_text() + "# mine\n")
    monkeypatch.setattr(zwidth.diagnose_files, "diagnose", lambda *_: kept[-1])
    assert run(line) == Status.DONE
    said = capsys.readouterr().err
    assert "is read as described in runs/data.recording.toml, which you edited" in said
    assert "using the device in runs/data.device.toml, which you edited" in said
    for file in (Path("runs/data.recording.toml"), Path("runs/data.device.toml")):
        assert file.read_text().endswith("# mine\n")


@pytest.mark.parametrize(
    ("header", "scale", "said"),
    [
        ("time,torque,angle", 57.3, "angle has no unit: rad is assumed (it moves by"),
        ("time,torque,angle", 1.0, "torque has no unit: N m is assumed"),
        ("time,current_A,angle_deg", 57.3, "current_A is in A, and how much N m that is"),
        ("t_us,u,x", 1.0, "x has no unit: m is assumed"),
    ],
)
def test_what_was_assumed_is_said(tmp_path: Path, header: str, scale: float, said: str):
    u = command(2.0)
    t = np.arange(u.size) / RATE * (1e6 if "us" in header else 1.0)
    table = np.column_stack([t, u, scale * 8.0 * np.sin(3.0 * np.arange(u.size) / RATE)])
    np.savetxt(tmp_path / "d.csv", table, "%.17g", ",", header=header, comments="")
    found = assumed(open_source(tmp_path / "d.csv"), "d.csv")
    assert any(doubt.startswith(said) for doubt in found.doubts), found.doubts
    assert ("time_unit" in found.text) == ("us" in header)


def test_a_file_that_was_not_written_to_its_end_is_said_to_be_short(tmp_path: Path):
    """Mutation: the columns guessed from one sample, none of which then "seems a position"."""
    (tmp_path / "d.csv").write_text("t [s],q [rad],u [N m]\n0.0,0.0,0.1\n0.001,0.")
    with pytest.raises(LogError, match=r"d\.csv holds 1 sample, too few"):
        assumed(open_source(tmp_path / "d.csv"), "d.csv")


def test_a_step_of_so_many_lines_a_turn_is_told_in_degrees_and_in_radians(tmp_path: Path):
    """Mutation: 360 and a turn of 2 pi exchanged."""
    q = np.rint(500.0 * np.sin(3.0 * np.arange(2000) / RATE))
    u = np.cos(3.0 * np.arange(2000) / RATE)
    for step, hint in ((0.09, "degrees?"), (2.0 * np.pi / 4096.0, "")):
        table = np.column_stack([np.arange(q.size) / RATE, u, step * q])
        np.savetxt(tmp_path / "d.csv", table, "%.17g", ",", header="t,u,angle", comments="")
        (doubt,) = (d for d in assumed(open_source(tmp_path / "d.csv"), "d").doubts if "angle" in d)
        assert ("degrees?" in doubt) == bool(hint), doubt


def test_somebody_at_a_terminal_is_asked_and_nobody_else(tmp_path: Path):
    """Mutation: the answer of the person passed over."""
    table = np.column_stack([np.arange(300) / RATE, *np.random.default_rng(0).random((3, 300))])
    np.savetxt(tmp_path / "d.csv", table, "%.17g", ",", header="t,a,b,theta", comments="")
    source, asked = open_source(tmp_path / "d.csv"), list[str]()

    def ask(question: str, answers: object, default: str) -> str:
        asked.append(question)
        return "b" if "drives" in question else default

    assert 'signal = "b"' in assumed(source, "d.csv", ask).text
    assert any("drives" in question for question in asked)
    alone = assumed(source, "d.csv")
    assert "[input]" not in alone.text
    assert any("taken as a motion that nothing drives" in doubt for doubt in alone.doubts)


def test_a_clock_that_scatters_has_one_period_in_all_that_is_said_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """Mutation: the median of the intervals in the error, their mean in the warning."""
    monkeypatch.chdir(tmp_path)
    t = np.arange(1000) / RATE + 2e-4 * np.random.default_rng(0).standard_normal(1000)
    table = np.column_stack([t, np.cos(3.0 * t), np.sin(3.0 * t)])
    np.savetxt("d.csv", table, "%.9g", ",", header="t,u_Nm,x_rad", comments="")
    assert run(["diagnose", "d.csv", "--device", "phantom_1_0"]) == Status.BAD_INPUT
    said = capsys.readouterr().err
    (warned,) = re.findall(r"scatter by \S+ s about the period of (\S+) s", said)
    assert f"the recording's period is {warned} s, the device's 0.001 s" in said
    assert "missing" not in said


def test_a_table_without_a_motion_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    np.savetxt("d.csv", np.random.default_rng(0).random((300, 2)), "%.6g", ",")
    assert run(["diagnose", "d.csv"]) == Status.BAD_INPUT
    said = capsys.readouterr().err.strip().splitlines()
    assert said[-1].startswith("error: d.csv has no line that names its columns, so it is unknown")
    assert not Path("runs").exists()

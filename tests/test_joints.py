"""Recordings with several joints: each that moves by itself, and one table of them."""

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_door import ANGLE, SPEED, TORQUE, T, table

import zwidth
from tests.diagnosis_examples import record
from zwidth.cli import run
from zwidth.fleet.listing import is_fleet, listed
from zwidth.logs.assumed import assumed, joints_of
from zwidth.logs.open_source import open_source
from zwidth.logs.source import RecordingError
from zwidth.sim.physics import make_physics


def names(folder: Path, columns: dict[str, Any]) -> tuple[dict[str, str], tuple[str, ...]]:
    found = joints_of(open_source(table(folder, columns)))
    return found.moving, found.still


def test_joints_are_called_by_what_their_names_differ_in(tmp_path: Path) -> None:
    """Mutations: still joints among the moving; a number that means another's, too; the words in
    the other order, which no joint is then found by."""
    still = 0.0 * T
    assert names(tmp_path, {"t": T, "tau[0]": TORQUE, "q[0]": ANGLE, "q[1]": still, "q[2]": SPEED,
                            "tau[2]": TORQUE}) == ({"0": "q[0]", "2": "q[2]"}, ("1",))  # fmt: skip
    one, two = "arm1.tau[0]", "arm1.tau[1]"
    assert names(tmp_path, {"t": T, one: TORQUE, two: TORQUE, "arm1.q[0]": ANGLE,
                            "arm1.q[1]": SPEED})[0] == {
        "0": "arm1.q[0]", "arm1.q[1]": "arm1.q[1]",
    }  # fmt: skip
    pan, lift = "observation.state.shoulder_pan.pos", "observation.state.shoulder_lift.pos"
    found = joints_of(open_source(table(tmp_path, {
        "timestamp": T, pan: ANGLE, lift: SPEED, "action.shoulder_pan.pos": ANGLE,
    })))  # fmt: skip
    assert set(found.moving.values()) == {pan, lift}
    assert not found.still
    for label, signal in found.moving.items():
        assert label in signal
        taken_up = assumed(open_source(tmp_path / "d.csv"), "d.csv", joint=label)
        assert f'signal = "{signal}"' in taken_up.text


def test_joints_of_which_only_a_goal_says_what_they_are(tmp_path: Path) -> None:
    """Mutation: names that say no quantity left out."""
    later = np.roll(ANGLE, -3)
    columns = {"t": T, "J1 Actual": 0.1 * ANGLE, "J2 Actual": ANGLE,
               "J1 Command": 0.1 * later, "J2 Command": later}  # fmt: skip
    assert names(tmp_path, columns)[0] == {"1": "J1 Actual", "2": "J2 Actual"}


def test_a_recording_of_one_device_has_no_joints(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="only angle moves in it; leave --joint out"):
        names(tmp_path, {"t": T, "torque": TORQUE, "angle": ANGLE})
    with pytest.raises(RecordingError, match="no position in it moves"):
        names(tmp_path, {"t": T, "torque": TORQUE, "temperature": ANGLE})


def test_masses_as_zwidth_names_them_are_of_one_device(tmp_path: Path) -> None:
    """Mutations: the joint that moves most of them; joints with a drive each taken for masses."""
    torque, first, third = "torque_Nm", "position_m1_rad", "position_m3_rad"
    table(tmp_path, {"time_s": T, torque: TORQUE, first: ANGLE, third: 2.0 * ANGLE})
    text = assumed(open_source(tmp_path / "d.csv"), "d.csv").text
    said = [(o["at"], o["signal"]) for o in tomllib.loads(text)["output"]]
    assert said == [("m1", first), ("m3", third)]
    table(tmp_path, {"time_s": T, "torque_m1": TORQUE, "torque_m2": 0.1 * TORQUE,
                     "position_m1": ANGLE, "position_m2": 2.0 * ANGLE})  # fmt: skip
    text = assumed(open_source(tmp_path / "d.csv"), "d.csv").text
    assert [o["signal"] for o in tomllib.loads(text)["output"]] == ["position_m2"]


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three joints: one with friction, one without anything, one that stands still."""
    from test_diagnosis_command import MOTOR

    folder = tmp_path_factory.mktemp("arm")
    rubbing = MOTOR.with_physics(make_physics("coulomb_friction", "m1", level=0.02))
    runs = [record(device, 3.0, seed=seed) for seed, device in enumerate((rubbing, MOTOR), 1)]
    columns = [x for e in runs for x in (e.command, e.measured[:, 0])]
    time = 0.001 * np.arange(columns[0].size)
    header = "time,tau[0],q[0],tau[1],q[1],tau[2],q[2]"
    grid = np.column_stack([time, *columns, 0.0 * time, 0.0 * time])
    np.savetxt(folder / "arm.csv", grid, "%.17g", ",", header=header, comments="")
    return folder


@pytest.mark.truth
def test_all_joints_of_a_recording_in_one_table(
    arm: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Mutations: the same joint for all; the JSON of the last joint alone."""
    monkeypatch.chdir(arm)
    asked = ["diagnose", "arm.csv", "--joint", "all", "--effort", "quick", "--json", "a.json"]
    assert run(asked) == 0
    said = capsys.readouterr()
    assert "2 joints that move (2 stand still)" in said.err
    assert "All joints" in said.out
    answers = json.loads((arm / "a.json").read_text())
    assert answers["still"] == ["2"]
    found = {k: [f["effect"] for f in v["findings"]] for k, v in answers["joints"].items()}
    assert found == {"0": ["coulomb_friction"], "1": []}
    assert tomllib.loads((arm / "runs/arm.0.toml").read_text())["input"]["signal"] == "tau[0]"
    assert (arm / "runs/arm.1.diagnosis.html").exists()
    assert is_fleet(arm / "runs/arm.joints.toml")
    assert [one.device for one in listed(arm / "runs/arm.joints.toml")] == ["0", "1"]


def test_a_joint_that_cannot_be_diagnosed_costs_itself_alone(
    arm: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Mutations: the first error ends all; an error of every joint is a success."""
    monkeypatch.chdir(arm)

    def fails(console: Any, recordings: tuple[Path, ...], *_: Any) -> None:
        raise ValueError(f"{recordings[0].name} is a test")

    monkeypatch.setattr("zwidth.joint_door.diagnose_files", fails)
    assert run(["diagnose", "arm.csv", "--joint", "all", "--out", "o", "--json", "b.json"]) == 1
    said = capsys.readouterr()
    assert "joint 0: arm.0.toml is a test" in said.err
    assert "no joint could be diagnosed" in said.err
    answers = json.loads((arm / "b.json").read_text())["joints"]
    assert answers["1"] == {"error": "arm.1.toml is a test"}


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["arm.csv"], "--joint all takes one recording, and 2 recordings"),
        (["--validate", "arm.csv"], "--joint all takes one recording, and --validate"),
    ],
)
def test_what_has_no_use_beside_all_joints(
    arm: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    more: list[str], words: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(arm)
    assert run(["diagnose", "arm.csv", *more, "--joint", "all"]) == 2
    assert words in capsys.readouterr().err


def test_joints_from_python(arm: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each with its own number. Mutations: the joint not passed on; an error that ends all."""
    asked: list[str | None] = []

    def one(recording: Any, device: Any, *, joint: str, **_: Any) -> str:
        asked.append(joint)
        if joint == "1":
            raise ValueError("a test")
        return f"joint {joint} of {recording.name}"

    monkeypatch.setattr("zwidth.api.diagnose_joints.diagnose", one)
    found = zwidth.diagnose_joints(arm / "arm.csv")
    assert asked == ["0", "1"]
    assert found["0"] == "joint 0 of arm.csv"
    with pytest.raises(KeyError, match="a test"):
        found["1"]
    with pytest.raises(TypeError, match="recording is of type int"):
        zwidth.diagnose_joints(3)  # pyright: ignore[reportArgumentType]
    frame = {"t": T, "tau[0]": TORQUE, "q[0]": ANGLE, "tau[1]": TORQUE, "q[1]": SPEED}
    with pytest.warns(UserWarning, match="assumed"):
        trace = zwidth.api.given.trace_of(frame, joint="1")  # type: ignore[attr-defined]
    np.testing.assert_allclose(trace["position_m1"], SPEED)

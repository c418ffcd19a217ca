"""What the door takes the columns of strangers' files for: by names, by numbers, by their time."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import click
import numpy as np
import pytest

from benchmarks.door import EXPECTED, Driven, answer, faults
from zwidth.door import asker
from zwidth.heartbeat import HEART
from zwidth.logs.assumed import Assumed, assumed
from zwidth.logs.names import read_name
from zwidth.logs.open_source import open_source
from zwidth.logs.recording import read_recording
from zwidth.logs.source import RecordingError
from zwidth.logs.written_time import nanoseconds_of

CASES = Path("../shared/cases")
T = 0.01 * np.arange(400)
ANGLE = np.sin(3.0 * T) + 0.3 * np.sin(7.1 * T)
SPEED = 3.0 * np.cos(3.0 * T) + 2.13 * np.cos(7.1 * T) + 1e-2 * np.sin(55.0 * T)
TORQUE = 0.1 * np.cos(5.0 * T) + 0.02 * np.sin(17.0 * T)


def table(folder: Path, columns: Mapping[str, object]) -> Path:
    """Write a CSV whose columns are numbers or texts, 400 of each."""
    rows = zip(*(np.broadcast_to(np.asarray(c), T.shape).tolist() for c in columns.values()),
               strict=True)  # fmt: skip
    path = folder / "d.csv"
    path.write_text("\n".join([",".join(columns), *(",".join(map(str, row)) for row in rows), ""]))
    return path


def taken(path: Path, joint: str | None = None) -> Assumed:
    return assumed(open_source(path), path.name, joint=joint)


def roles(found: Assumed) -> dict[str, str]:
    """Return role -> signal, without its unit."""
    return {role: what.split(" [")[0] for role, what in found.roles}


@pytest.mark.parametrize("name", list(EXPECTED))
def test_cases(name: str) -> None:
    """Every case is taken for what it is (`benchmarks/door.py`)."""
    path = CASES / name
    if not path.exists():
        pytest.skip(f"{path} is not here: the cases are not ours to pass on")
    if isinstance(EXPECTED[name], Driven):
        pytest.importorskip("mujoco")
    assert faults(answer(path, EXPECTED[name]), EXPECTED[name]) == []


@pytest.mark.parametrize(
    ("name", "quantity", "role"),
    [
        ("Present_Position", "position", "measured"),  # Dynamixel, Feetech
        ("Goal_Position", "position", "goal"),
        ("Present Load", "torque", "measured"),
        ("Present_Temperature", "other", "measured"),
        ("target_qd_3", "velocity", "goal"),  # UR RTDE
        ("actual_current_0", "current", "measured"),
        ("q_d[2]", "position", ""),  # libfranka: which of the two the numbers say
        ("q_d", "position", "goal"),
        ("tau_ext_hat_filtered[1]", "other", ""),
        ("axis0.motor.current_control.Iq_measured", "current", "measured"),  # ODrive
        ("input_pos", "position", "goal"),
        ("vbus_voltage", "other", ""),
        ("q_current", "current", ""),  # moteus
        ("d_current", "other", ""),
        ("control_torque", "torque", "command"),
        ("position_error", "position", "error"),
        ("erpm", "velocity", ""),  # VESC
        ("temp_mos_max", "other", ""),
        ("Position actual value", "position", "measured"),  # CiA 402
        ("Velocity demand value", "velocity", "goal"),
        ("MAIN.fActPosition", "position", "measured"),  # CODESYS, TwinCAT
        ("GVL.lrSetVelocity", "velocity", "goal"),
        ("joint.0.motor-pos-cmd", "position", "goal"),  # LinuxCNC
        ("joint.0.motor-pos-fb", "position", "measured"),
        ("/effort_controller/command/data", "torque", "command"),  # ROS
        ("Istwinkel", "position", "measured"),
        ("Sollposition", "position", "goal"),
        ("theta_ddot", "acceleration", ""),
        ("v", "velocity", ""),
        ("x_load", "position", ""),
        ("pid_output", "input", "command"),
        ("current_position", "position", "measured"),
        ("target_current", "current", "goal"),
        ("frame_index", "counter", ""),
        ("ω", "velocity", ""),
    ],
)
def test_names(name: str, quantity: str, role: str) -> None:
    """Mutation: the first word that names a quantity decides, and `current` is always one."""
    said = read_name(name)
    assert (said.quantity, said.role) == (quantity, role), said


def test_a_goal_drives_before_what_was_measured_and_after_a_torque(tmp_path: Path) -> None:
    """A current that is called measured answers the goal of its loop; a bare one drives.

    Mutations: goals left out of what may drive; what was measured before them.
    """
    late = np.roll(ANGLE, 3)
    found = taken(table(tmp_path, {"t": T, "goal_pos_deg": ANGLE, "present_pos_deg": late}))
    assert roles(found)["goal"] == "goal_pos_deg"
    assert roles(found)["position"] == "present_pos_deg"
    columns = {"t": T, "goal_pos_deg": ANGLE, "present_pos_deg": late, "present_current_mA": TORQUE}
    found = taken(table(tmp_path, columns))
    assert roles(found)["goal"] == "goal_pos_deg"
    columns = {"t": T, "goal_pos_deg": ANGLE, "present_pos_deg": late, "current_mA": TORQUE}
    assert roles(taken(table(tmp_path, columns)))["command"] == "current_mA"
    assert any("may each be the command" in doubt for doubt in found.doubts)


def test_a_temperature_is_no_command_because_none_is_left(tmp_path: Path) -> None:
    """Mutation: the one column left taken whatever it is."""
    found = taken(table(tmp_path, {"t": T, "angle": ANGLE, "temperature": 20.0 + T}))
    assert "[input]" not in found.text
    (doubt,) = (d for d in found.doubts if "seems to be a command" in d)
    assert "temperature cannot be one" in doubt
    assert "record its torque" in doubt


def test_of_several_joints_the_one_that_moves_is_taken_with_its_torque(tmp_path: Path) -> None:
    """Mutation: the first of an array taken; or the torque of another joint."""
    columns: dict[str, object] = {"time": T}
    for k in range(4):
        columns |= {f"q[{k}]": (1.0 if k == 2 else 0.01) * ANGLE + k, f"tau[{k}]": TORQUE * (k + 1)}
    path = table(tmp_path, columns)
    found = roles(taken(path))
    assert (found["position"], found["command"]) == ("q[2]", "tau[2]")
    found = roles(taken(path, joint="3"))
    assert (found["position"], found["command"]) == ("q[3]", "tau[3]")
    with pytest.raises(RecordingError, match="no joint '7'"):
        taken(path, joint="7")


def test_joints_have_names(tmp_path: Path) -> None:
    """Mutation: only numbers tell joints apart."""
    names = ("shoulder_pan", "elbow_flex", "wrist_roll")
    columns: dict[str, object] = {"timestamp": T}
    for k, name in enumerate(names, start=1):
        columns |= {f"action.{name}.pos": k * ANGLE, f"state.{name}.pos": k * np.roll(ANGLE, 2)}
    path = table(tmp_path, columns)
    found = roles(taken(path))
    assert (found["goal"], found["position"]) == ("action.wrist_roll.pos", "state.wrist_roll.pos")
    found = roles(taken(path, joint="elbow_flex"))
    assert (found["goal"], found["position"]) == ("action.elbow_flex.pos", "state.elbow_flex.pos")


@pytest.mark.parametrize(
    ("columns", "command", "outputs"),
    [
        ({"q": ANGLE, "v": SPEED, "u": TORQUE}, "u", {"position": "q", "velocity": "v"}),
        ({"q": ANGLE, "v": TORQUE}, "v", {"position": "q"}),  # a voltage
        ({"q": ANGLE, "qd": np.roll(ANGLE, -2)}, "qd", {"position": "q"}),  # desired
        ({"q": ANGLE, "dq": np.gradient(ANGLE, T), "tau": TORQUE}, "tau", {"position": "q"}),
        ({"q": ANGLE, "speed": 9.55 * SPEED, "u": TORQUE}, "u", {"position": "q"}),
    ],
)  # fmt: skip
def test_numbers_decide_what_names_leave_open(
    tmp_path: Path, columns: dict[str, object], command: str, outputs: dict[str, str]
) -> None:
    """Mutation: each comparison of `logs/roles.py` with its sign turned."""
    found = roles(taken(table(tmp_path, {"t": T, **columns})))
    assert found.get("command", found.get("goal")) == command
    assert {k: v for k, v in found.items() if k in ("position", "velocity")} == outputs


@pytest.mark.parametrize(
    ("first", "second", "seconds"),
    [
        ("2025-11-12T10:03:29.555Z", "2025-11-12T10:03:29.565Z", 0.01),
        ("2025-11-12 23:59:59.5+01:00", "2025-11-13 00:00:00.25+01:00", 0.75),
        ("12.11.2025 10:03:29,5", "12.11.2025 10:03:30", 0.5),
        ("11/30/2025 11:59:59 AM", "11/30/2025 12:00:00 PM", 1.0),
        ("2025/11/12_10:03:29:555", "2025/11/12_10:03:29:556", 0.001),
        ("20251112T100329.5", "20251112T100330.0", 0.5),
        ("23:59:59.9", "00:00:00.1", 0.2),
        ("59:59.9", "60:00.1", 0.2),
    ],
)
def test_written_times(first: str, second: str, seconds: float) -> None:
    """Mutation: the zone added where it is to be taken off; midnight not passed."""
    found = nanoseconds_of([first, "", second])
    assert found is not None
    times, missing = found
    assert (times[2] - times[0]) / 1e9 == pytest.approx(seconds, abs=1e-12)
    assert missing.tolist() == [False, True, False]


def test_what_is_no_time_is_none() -> None:
    for cells in (["on", "off"], ["2025-13-45T10:00:00", "2025-13-45T10:00:01"], ["10:99:00"] * 2):
        assert nanoseconds_of(cells) is None


def stamps(kind: str) -> tuple[dict[str, object], float]:
    """Return columns of time of a kind, and the period that they show."""
    count = np.arange(400)
    match kind:
        case "iso":
            return {"stamp": [f"2024-05-03T10:15:{k / 100:06.3f}" for k in range(400)]}, 0.01
        case "day and clock":
            clock = [f"10:15:{k / 100:06.3f}" for k in range(400)]
            return {"date": "2024-05-03", "time": clock}, 0.01
        case "epoch":
            return {"time": 1_700_000_000.0 + 0.01 * count}, 0.01
        case "epoch in ms":
            return {"time": 1_700_000_000_000 + 10 * count}, 0.01
        case "epoch in us":
            return {"time": 1_700_000_000_000_000 + 10_000 * count}, 0.01
        case "coarse":
            return {"time": 0.02 * (count // 2)}, 0.01
        case "coarse and uneven":
            return {"time": np.round(0.01 * count, 1)}, 0.01
        case "counter of 16 bits":
            return {"time_ms": (60_000 + 20 * count) % 65_536}, 0.02
        case _:
            return {"ms": 5 * count}, 0.005


@pytest.mark.parametrize(
    "kind",
    ["iso", "day and clock", "epoch", "epoch in ms", "epoch in us", "coarse", "coarse and uneven",
     "counter of 16 bits", "milliseconds"],
)  # fmt: skip
def test_times(tmp_path: Path, kind: str) -> None:
    """The rate comes out right, and no other is assumed."""
    columns, period = stamps(kind)
    path = table(tmp_path, {**columns, "torque": TORQUE, "angle": ANGLE})
    found = taken(path)
    rate = float(dict(found.roles)["time"].split(", ")[1].split()[0])
    assert rate == pytest.approx(1.0 / period, rel=1e-3)
    assert not any("are assumed" in doubt for doubt in found.doubts)
    toml = tmp_path / "d.toml"
    toml.write_text(found.text)
    trace = read_recording(toml)
    np.testing.assert_allclose(np.diff(trace.t), period, rtol=1e-3)
    np.testing.assert_allclose(trace["command"], TORQUE)


def test_a_time_that_is_refused_is_named_with_its_reason(tmp_path: Path) -> None:
    """Mutation: the reasons dropped."""
    shuffled = np.random.default_rng(0).permutation(T)
    found = taken(table(tmp_path, {"time": shuffled, "torque": TORQUE, "angle": ANGLE}))
    (doubt,) = (d for d in found.doubts if "seems to be time" in d)
    assert "time goes back in" in doubt


def test_a_number_beside_the_signals_tells_the_period(tmp_path: Path) -> None:
    """Mutation: a rate taken for a period."""
    for name, value in (("Ts", 0.004), ("fs", 250.0), ("sample_rate_hz", 250.0)):
        np.savez(tmp_path / "d.npz", u=TORQUE, q=ANGLE, allow_pickle=False, **{name: value})
        found = taken(tmp_path / "d.npz")
        assert "period_s = 0.004" in found.text, found.text


def test_signals_in_rows_of_their_own_are_brought_onto_one_axis(tmp_path: Path) -> None:
    """Mutation: no resampling, and no row has both."""
    t = np.sort(np.concatenate([T, T + 0.0034]))
    even = np.arange(t.size) % 2 == 0
    lines = [
        f"{a:.6f},{'' if e else np.cos(5.0 * a)},{np.sin(3.0 * a) if e else ''}"
        for a, e in zip(t.tolist(), even.tolist(), strict=True)
    ]
    path = tmp_path / "d.csv"
    path.write_text("\n".join(["__time,/cmd/effort,/joint/position", *lines, ""]))
    toml = tmp_path / "d.toml"
    toml.write_text(taken(path).text)
    trace = read_recording(toml)
    np.testing.assert_allclose(trace["position_m1"], np.sin(3.0 * trace.t), atol=2e-4)
    np.testing.assert_allclose(np.diff(trace.t), 0.01, rtol=1e-9)


def test_what_has_one_answer_is_not_asked(tmp_path: Path) -> None:
    """At a terminal neither; of two it is. Mutation: it asks for the only column that can drive."""
    asked: list[str] = []

    def ask(question: str, answers: Sequence[str], default: str) -> str:
        asked.append(question)
        return default

    one = {"time_s": T, "torque_Nm": TORQUE, "angle_deg": ANGLE}
    assumed(open_source(table(tmp_path, one)), "f.csv", ask)
    assert asked == []
    assumed(open_source(table(tmp_path, one | {"current_A": 2.0 * TORQUE})), "f.csv", ask)
    assert asked == ["which column drives the device"]


def test_nothing_is_written_over_a_question(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutation: the sign of life goes on while a person reads the question."""
    held: list[bool] = []

    def prompt(*_: object, **__: object) -> str:
        held.append(HEART._held > 0)  # pyright: ignore[reportPrivateUsage]
        return "turns"

    monkeypatch.setattr(click, "prompt", prompt)
    for stream in (sys.stdin, sys.stdout):
        monkeypatch.setattr(stream, "isatty", lambda: True)
    ask = asker()
    assert ask is not None
    assert ask("does the device turn or slide", ("turns", "slides"), "turns") == "turns"
    assert held == [True]

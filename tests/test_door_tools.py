"""Tables as well-known tools write them: whose columns are what, and in which units they count.

Each is a small file of the tool's form, of a motion that was made for it.
"""

from pathlib import Path

import numpy as np
import pytest
from test_door import ANGLE, SPEED, TORQUE, T, roles, table, taken

from zwidth.logs.assumed import assumed
from zwidth.logs.labelled_text import table_of
from zwidth.logs.open_source import open_source
from zwidth.logs.recording import read_described, unscaled
from zwidth.logs.recording_file import description_of
from zwidth.logs.source import RecordingError
from zwidth.logs.units import TURN
from zwidth.sim.trace import Trace

LATER = np.roll(ANGLE, -4)
TURNS = {"position": 1.0 / TURN, "velocity": 1.0 / TURN}
NOISE = np.random.default_rng(1).standard_normal(T.size)


def read(path: Path) -> Trace:
    """Return the recording as the door reads it."""
    text = assumed(open_source(path), path.name).text
    return read_described(description_of(text.encode(), path.with_suffix(".toml")), path.parent)


TABLES = {
    "dynamixel wizard": (
        {"Time(ms)": 1e3 * T, "ID:001 Goal Position": np.round(2048 + 500 * LATER),
         "ID:001 Present Position": np.round(2048 + 500 * ANGLE),
         "ID:001 Present Current": np.round(500 * TORQUE)},
        "ID:001 Goal Position", "ID:001 Present Position",
    ),
    "lerobot": (
        {"timestamp": np.tile(T[:200], 2), "frame_index": np.tile(np.arange(200), 2),
         "episode_index": np.repeat([0, 1], 200), "action": LATER, "observation.state": ANGLE},
        "action", "observation.state",
    ),
    "moteus": (
        {"timestamp": T, "servo_stats.position": ANGLE / TURN,
         "servo_stats.velocity": SPEED / TURN, "servo_stats.torque_Nm": TORQUE + 1e-3 * NOISE,
         "servo_stats.q_A": 9.0 * TORQUE, "servo_control.torque_Nm": TORQUE},
        "servo_control.torque_Nm", "servo_stats.position",
    ),
    "odrive": (
        {"time": T, "axis0.encoder.pos_estimate": ANGLE / TURN,
         "axis0.encoder.vel_estimate": SPEED / TURN,
         "axis0.motor.current_control.Iq_setpoint": 9.0 * TORQUE,
         "axis0.motor.current_control.Iq_measured": 9.0 * TORQUE + 1e-2 * NOISE},
        "axis0.motor.current_control.Iq_setpoint", "axis0.encoder.pos_estimate",
    ),
    "simplefoc": (
        {"time_us": 1e6 * T, "target": LATER, "Uq": 5.0 * TORQUE, "Ud": 0.0 * T,
         "Iq": 2.0 * TORQUE + 1e-2 * NOISE, "angle": ANGLE},
        "Uq", "angle",
    ),
    "vesc": (
        {"ms_today": 1e3 * T, "input_voltage": 41.0 + 1e-2 * NOISE, "current_motor": TORQUE,
         "current_in": 0.1 * TORQUE, "erpm": np.round(7.0 * 60.0 / TURN * SPEED),
         "fault_code": 0.0 * T},
        "current_motor", "erpm",
    ),
    "ur": (
        {"timestamp": T, "target_q_0": LATER, "target_qd_0": np.gradient(LATER, 0.01),
         "actual_q_0": ANGLE, "actual_current_0": 9.0 * TORQUE},
        "target_q_0", "actual_q_0",
    ),
    "libfranka csv": (
        {"duration": 1e3 * T, "q[0]": ANGLE, "q[1]": 1e-7 * NOISE, "q_d[0]": ANGLE,
         "q_d[1]": 0.0 * T, "tau_J[0]": TORQUE + 1e-3 * NOISE, "tau_J[1]": 1e-7 * NOISE,
         "tau_J_d[0]": TORQUE, "tau_J_d[1]": 0.0 * T},
        "tau_J_d[0]", "q[0]",
    ),
    "arduino pid": (
        {"millis": np.round(1e3 * T), "Setpoint": 100.0 * LATER, "Input": 100.0 * ANGLE,
         "Output": 100.0 * TORQUE},
        "Output", "Input",
    ),
    "betaflight": (
        {"time (us)": 1e6 * T, "rcCommand[0]": 40.0 * TORQUE,
         "setpoint[0]": 57.3 * np.roll(SPEED, -4),
         "gyroADC[0]": 57.3 * SPEED, "gyroADC[1]": np.round(NOISE)},
        "setpoint[0]", "gyroADC[0]",
    ),
    "acs": (
        {"Time(sec)": T, "RPOS": LATER, "FPOS": ANGLE, "FVEL": SPEED},
        "RPOS", "FPOS",
    ),
    "feetech": (
        {"timestamp": T, "goal": np.round(2048 + 500 * LATER), "pos": np.round(2048 + 500 * ANGLE),
         "load": np.round(400 * TORQUE + NOISE)},
        "goal", "pos",
    ),
    "libfranka log": (
        {"time": T, "state.q[3]": ANGLE, "state.q_d[3]": 0.0 * T, "state.dq[3]": SPEED,
         "state.tau_J[3]": TORQUE + 1e-2 * NOISE, "cmd.tau_J_d[3]": TORQUE},
        "cmd.tau_J_d[3]", "state.q[3]",
    ),
    "mini cheetah": (
        {"t": T, "p_des": LATER, "v_des": 0.0 * T, "kp": 0.0 * T + 6.0, "t_ff": 0.0 * T,
         "p_out": ANGLE, "v_out": SPEED, "t_out": TORQUE},
        "p_des", "p_out",
    ),
    "sinamics": (
        {"Time [ms]": 1e3 * T, "Drive_1.r62 Speed setpoint [rpm]": 9.55 * np.roll(SPEED, -4),
         "Drive_1.r63 Speed actual value smoothed [rpm]": 9.55 * SPEED,
         "Drive_1.r79 Torque setpoint total [Nm]": TORQUE},
        "Drive_1.r79 Torque setpoint total", "Drive_1.r63 Speed actual value smoothed",
    ),
    "speed loop": (
        {"t": 1e3 * T, "rpm": 9.55 * SPEED, "out": TORQUE, "rpm_sp": 9.55 * np.roll(SPEED, -4)},
        "out", "rpm",
    ),
    "phases": (
        {"t": T, "ia_mA": 1e3 * NOISE, "ib_mA": 1e3 * NOISE, "ic_mA": 1e3 * NOISE,
         "iq_mA": 1e3 * TORQUE, "theta_mrad": 1e3 * ANGLE},
        "iq_mA", "theta_mrad",
    ),
    "armature": ({"t": T, "ia_mA": 1e3 * TORQUE, "theta_mrad": 1e3 * ANGLE}, "ia_mA", "theta_mrad"),
    "filtered counts": (
        {"i_ms": 10 * np.arange(T.size), "vfilt_cps": 500 * SPEED, "duty": TORQUE},
        "duty", "vfilt_cps",
    ),
    "elmo": (
        {"Time": T, "Position [cnt]": np.round(500 * ANGLE),
         "Position Command [cnt]": np.round(500 * LATER), "Active Current [A]": TORQUE},
        "Position Command", "Position",
    ),
    "quanser": (
        {"t": T, "V_m": 10.0 * TORQUE, "theta_m": ANGLE, "theta_dot": SPEED}, "V_m", "theta_m",
    ),
    "egm": (
        {"time": T, "feedBack.joints[0]": 0.1 * ANGLE, "feedBack.joints[1]": ANGLE,
         "planned.joints[0]": 0.1 * LATER, "planned.joints[1]": LATER},
        "planned.joints[1]", "feedBack.joints[1]",
    ),
    "kuka": (
        {"IPOC": 1e3 * T, "AIPos.A1": 0.1 * ANGLE, "AIPos.A2": ANGLE, "MACur.A1": TORQUE,
         "MACur.A2": TORQUE},
        "MACur.A2", "AIPos.A2",
    ),
    "trinamic": (
        {"time_ms": 1e3 * T, "XACTUAL": np.round(2e3 * ANGLE), "XTARGET": np.round(2e3 * LATER)},
        "XTARGET", "XACTUAL",
    ),
}  # fmt: skip


@pytest.mark.parametrize("tool", list(TABLES))
def test_whose_columns_are_what(tmp_path: Path, tool: str) -> None:
    """Mutations: "id" before a number as the current across; a counter that starts anew as a
    position; a current that was measured before the goal of its loop; sticks as commands."""
    columns, command, motion = TABLES[tool]
    found = roles(taken(table(tmp_path, columns)))
    assert found.get("command", found.get("goal")) == command
    assert found.get("position", found.get("velocity")) == motion


@pytest.mark.parametrize(
    ("tool", "channel", "truth"),
    [
        ("moteus", "position_m1", ANGLE),
        ("moteus", "velocity_m1", SPEED),
        ("odrive", "position_m1", ANGLE),
        ("vesc", "velocity_m1", 7.0 * SPEED),  # of the field: its seven pole pairs are not known
        ("betaflight", "velocity_m1", SPEED),
    ],
)
def test_units_that_a_tool_does_not_write(
    tmp_path: Path, tool: str, channel: str, truth: np.ndarray
) -> None:
    """Turns, degrees and turns of the field, each said. Mutation: no unit by the tool."""
    path = table(tmp_path, TABLES[tool][0])
    np.testing.assert_allclose(read(path)[channel], truth, atol=0.02 * np.abs(truth).max())
    said = " ".join(taken(path).doubts)
    assert ("one pole pair" in said) == (tool == "vesc")
    assert (" is taken, as " in said) == (tool != "vesc")  # whose erpm is a unit by itself


def test_a_speed_to_go_to_is_said_to_be_one(tmp_path: Path) -> None:
    """Not to be a command "in rad/s". Mutation: the sentence of an amplifier."""
    rpm = 60.0 / TURN
    path = table(tmp_path, {
        "time_s": T, "setpoint_rpm": rpm * np.roll(SPEED, -3), "actual_rpm": rpm * SPEED,
    })  # fmt: skip
    said = " ".join(taken(path).doubts)
    assert "setpoint_rpm is a speed to go to: a loop in proportion to the error" in said
    assert "motor's constant" not in said
    np.testing.assert_allclose(read(path)["command"], np.roll(SPEED, -3), rtol=1e-4, atol=1e-4)


def test_numbers_beside_their_names_are_a_table(tmp_path: Path) -> None:
    """Lines of Arduino's serial plotter. Mutations: the text before the first such line kept; a
    name that a line lacks filled with its neighbour's number."""
    path = tmp_path / "plotter.txt"
    rows = [f"target:{a:.3f},angle:{b:.3f}\tpwm:{c:.3f}" for a, b, c in
            zip(LATER, ANGLE, TORQUE, strict=True)]  # fmt: skip
    path.write_text("\n".join(["Motor ready!", *rows, ""]))
    source = open_source(path)
    np.testing.assert_allclose(source["angle"].values, ANGLE, atol=5e-4)
    found = roles(taken(path))
    assert (found["position"], found["command"]) == ("angle", "pwm")
    esp = "I (10) motor: q=0.1 iq=2\nI (20) motor: q=0.2 iq=3\n"
    assert table_of(esp) == "log_time_ms,q,iq\n10,0.1,2\n20,0.2,3\n"
    assert table_of("a=1 b=2\na=3\n") == "a,b\n1,2\n3,\n"
    assert table_of("time: 10:03:29\ntime: 10:03:30\n") is None
    assert table_of("a,b\n1,2\n") is None


STAMPED = {
    "python": ("2025-03-04 {clock},{ms:03d} INFO servo 1 goal={goal:.4f} pos={pos:.4f}", "pos"),
    "serial monitor": ("{clock}.{ms:03d} -> goal:{goal:.4f},pos:{pos:.4f}", "pos"),
    "ros 1": ("[INFO] [17410896{s:02d}.{ms:03d}]: goal={goal:.4f}, pos={pos:.4f}", "pos"),
    "bare": ("{clock}.{ms:03d} -> {goal:.4f}\t{pos:.4f}", "pos"),
}


@pytest.mark.parametrize("form", list(STAMPED))
def test_stamps_before_the_lines_of_a_log_are_its_time(tmp_path: Path, form: str) -> None:
    """Mutations: the comma of Python's milliseconds kept; the stamp a part of the first name."""
    pattern, position = STAMPED[form]
    rows: list[str] = []
    for t, goal, pos in zip(T, LATER, ANGLE, strict=True):
        s, ms = divmod(round(1e3 * t), 1000)
        clock = f"12:34:{s:02d}"
        rows.append(pattern.format(clock=clock, s=s, ms=ms, goal=goal, pos=pos))
    if form == "bare":
        rows.insert(0, "12:34:00.000 -> goal\tpos")
    path = tmp_path / "log.txt"
    path.write_text("\n".join([*rows, ""]))
    trace = read(path)
    np.testing.assert_allclose(trace.t - trace.t[0], T - T[0], atol=1e-6)
    np.testing.assert_allclose(trace["position_m1"], ANGLE, atol=6e-5)
    assert roles(taken(path))["goal"] == "goal"
    assert position in open_source(path).signals


def test_names_stand_under_what_they_are_of(tmp_path: Path) -> None:
    """As pandas writes columns of two levels. Mutations: the lower line alone; a name that stands
    once over several columns, over the first of them alone."""
    for upper in ("t,j1,,j2,", "t,j1,j1,j2,j2"):
        path = tmp_path / "d.csv"
        rows = [f"{t},{0.1 * q},0,{q},{u}" for t, q, u in zip(T, ANGLE, TORQUE, strict=True)]
        path.write_text("\n".join([upper, ",pos,tau,pos,tau", *rows, ""]))
        found = roles(taken(path))
        assert (found["time"], found["position"]) == ("t", "j2 pos")
        assert found["command"] == "j2 tau"


def test_rows_of_several_motors_in_turn_are_taken_apart(tmp_path: Path) -> None:
    """Each with the times of its rows. Mutations: all rows as of one motor; the times of the
    first. A number that seldom changes is no motor's."""
    twice = {name: np.repeat(values, 2) for name, values in {"time": T, "position": ANGLE,
             "current": TORQUE}.items()}  # fmt: skip
    twice["time"][1::2] += 2e-4
    twice["position"][::2] *= 0.1
    motor = np.tile([3, 7], T.size)

    def written(motor: np.ndarray) -> Path:
        path = tmp_path / "bus.csv"
        rows = zip(twice["time"], motor, twice["position"], twice["current"], strict=True)
        lines = [",".join(map(str, row)) for row in rows]
        path.write_text("\n".join(["time,motor_id,position,current", *lines, ""]))
        return path

    path = written(motor)
    found = roles(taken(path))
    assert (found["position"], found["command"]) == ("position 7", "current 7")
    trace = read(path)
    np.testing.assert_allclose(trace["position_m1"], ANGLE)
    np.testing.assert_allclose(np.diff(trace.t), np.diff(T), atol=1e-9)
    assert roles(taken(path, "3"))["position"] == "position 3"
    source = open_source(written(np.repeat([3, 7], T.size)))
    assert "position" in source.signals


def test_a_unit_stands_before_what_is_asked(tmp_path: Path) -> None:
    """Mutations: "sp" as a part of the unit; the goal without one."""
    columns = {"time": T, "angle_deg_cmd": np.degrees(LATER), "angle_deg_meas": np.degrees(ANGLE)}
    trace = read(table(tmp_path, columns))
    np.testing.assert_allclose(trace["command"], LATER)
    np.testing.assert_allclose(trace["position_m1"], ANGLE)


def test_joint_states_of_ros2_topic_echo(tmp_path: Path) -> None:
    """Two joints, then none with a velocity. Mutations: the quantities in another order; a blank
    for an array that is empty taken for a cell of the next."""
    for velocities in (True, False):
        rows = []
        for t, q, v, u in zip(T, ANGLE, SPEED, TORQUE, strict=True):
            ns = 1_741_089_600_000_000_000 + round(1e9 * t)
            moves = f"{0.1 * v:.6f},{v:.6f}" if velocities else ""
            rows.append(f"{ns // 10**9},{ns % 10**9},,a,b,{0.1 * q:.6f},{q:.6f},{moves},0,{u:.6f}")
        path = tmp_path / "echo.csv"
        path.write_text("\n".join([*rows, "1741089600,5,,a", ""]))
        source = open_source(path)
        assert ("b.velocity" in source.signals) == velocities
        assert source.notes == ("1 lines are no joint state of these joints and are left out",)
        found = roles(taken(path))
        assert (found["position"], found["command"]) == ("b.position", "b.effort")
        trace = read(path)
        np.testing.assert_allclose(trace["position_m1"], ANGLE, atol=1e-6)
        np.testing.assert_allclose(trace.t - trace.t[0], T - T[0], atol=1e-7)


@pytest.mark.parametrize(
    ("start", "words"),
    [
        (b"(1609459200.123456) can0 201#0011223344556677\n", "candump.*DBC"),
        (b" can0  201   [8]  00 11 22 33 44 55 66 77\n", "candump.*DBC"),
        (b"date Thu Mar 4\nbase hex  timestamps absolute\n", "Vector.*DBC"),
        (b"#ROSBAG V2.0\n" + bytes(99), "bag of ROS 1.*rostopic echo -p"),
        (b"SQLite format 3\0" + bytes(99), "not a readable ROS 2 bag"),
        (b"\x80\x04\x95" + bytes(99), "pickle.*numpy.savez"),
        (b"MDF     4.10    " + bytes(99), "asammdf"),
        (b"\x1f\x8b\x08" + bytes(99), "gunzip"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "git lfs pull"),
    ],
)
def test_what_is_known_and_not_read_says_what_to_do(
    tmp_path: Path, start: bytes, words: str
) -> None:
    """Mutation: the sentence of a file that is nothing known."""
    path = tmp_path / "a.log"
    path.write_bytes(start)
    with pytest.raises(RecordingError, match=words):
        open_source(path)


def test_a_logged_word_is_no_can_log(tmp_path: Path) -> None:
    """A header may begin as Vector's files do. Mutation: four letters are enough."""
    path = tmp_path / "a.csv"
    path.write_text("LOGGED,torque,angle\n" + "".join(f"{t},{u},{a}\n" for t, u, a in
                    zip(T, TORQUE, ANGLE, strict=True)))  # fmt: skip
    assert len(open_source(path).signals) == 3


def test_a_speed_tells_the_rate_of_a_file_without_time(tmp_path: Path) -> None:
    """At which it is the slope of the position, if that is a usual one. Mutations: any rate; the
    speed left out as of another size."""
    rate = 1.0 / float(T[1] - T[0])
    path = table(tmp_path, {"torque": TORQUE, "angle": ANGLE, "velocity": SPEED})
    found = taken(path)
    assert f"no column seems to be time: {rate:g} samples a second are taken" in found.doubts[0]
    assert "velocity" in roles(found)
    np.testing.assert_allclose(read(path).t, T, atol=1e-9)
    path = table(tmp_path, {"torque": TORQUE, "angle": ANGLE, "velocity": 57.3 * SPEED})
    assert "so 1000 samples a second are assumed" in taken(path).doubts[0]


def test_a_loop_in_counts_says_what_a_count_is_in_both_places(tmp_path: Path) -> None:
    """The goal and the position of a servo's register. Mutations: the goal in newton metres, or in
    radians; counts of a turn that are 2 pi taken for known."""
    columns = {"t": T, "goal_position": np.round(2048 + 500 * LATER),
               "present_position": np.round(2048 + 500 * ANGLE)}  # fmt: skip
    path = table(tmp_path, columns)
    text = taken(path).text
    assert text.count("counts_per_rev = 6.28") == 2
    trace = read(path)
    assert (trace.units["command"], trace.units["position_m1"]) == ("rad", "rad")
    np.testing.assert_allclose(trace["command"], columns["goal_position"])
    assert unscaled([trace]) == ("", "counts")
    few = table(tmp_path, columns | {"present_position": np.round(10 * ANGLE)})
    assert "counts" not in roles(taken(few))["position"]


def test_an_export_of_twincat_scope(tmp_path: Path) -> None:
    """Each channel has times of its own. Mutations: the header's numbers read as samples; all
    channels with the times of the first."""
    lines = ["Name\tProject", "File\tC:\\a.svdx", "Starttime of export\t133500000000000000", ""]
    for key, values in {
        "Name": ("Axis.fActPosition", "Axis.fSetTorque"), "Data-Type": ("REAL64", "REAL64"),
        "SampleTime[ms]": ("10", "10"), "SymbolName": ("MAIN.a", "MAIN.b"),
    }.items():  # fmt: skip
        lines.append("\t".join(f"{key}\t{value}" for value in values))
    lines.append("")
    lines += [f"{1e3 * t:.3f}\t{a:.6f}\t{1e3 * t + 2.0:.3f}\t{u:.6f}" for t, a, u in
              zip(T, ANGLE, TORQUE, strict=True)]  # fmt: skip
    for ending, change in (("t", str), ("c", lambda s: s.replace(".", ",").replace("\t", ";"))):
        path = tmp_path / f"{ending}.csv"
        path.write_text(change("\n".join(lines[:1])) + "\n" + "\n".join(map(change, lines[1:])))
        source = open_source(path)
        position, torque = source.signals.values()
        np.testing.assert_allclose(position.values, ANGLE, atol=1e-6)
        np.testing.assert_allclose(torque.stamps["stamp"], np.rint(1e9 * T) + 2_000_000, atol=1)
        found = roles(taken(path))
        assert found["command"].endswith("SetTorque")
        assert found["position"].endswith("ActPosition")
    empty = tmp_path / "empty.csv"
    empty.write_text("\n".join(lines[:9]))
    with pytest.raises(RecordingError, match="TwinCAT Scope without a sample"):
        open_source(empty)


def test_units_of_a_labview_file_with_times_of_each_channel(tmp_path: Path) -> None:
    """Mutation: the units taken in the order of the columns."""
    path = tmp_path / "multi.lvm"
    end = "***End_of_Header***"
    head = ["LabVIEW Measurement\t", "Separator\tTab", "Decimal_Separator\t.", "X_Columns\tMulti",
            f"{end}\t", "Channels\t2\t\t\t", "Y_Unit_Label\tN m\t\tDegrees\t",
            "X_Dimension\tTime\t\tTime\t", f"{end}\t\t\t\t",
            "X_Value\tMotor Torque\tX_Value\tAngle\tComment"]  # fmt: skip
    rows = [f"{t:.4f}\t{u:.6f}\t{t:.4f}\t{a:.6f}\t" for t, u, a in
            zip(T, TORQUE, ANGLE, strict=True)]  # fmt: skip
    path.write_text("\n".join([*head, *rows, ""]))
    source = open_source(path)
    assert (source["Motor Torque"].unit, source["Angle"].unit) == ("N m", "Degrees")


def test_a_table_without_names_says_what_to_write(tmp_path: Path) -> None:
    """Mutation: the sentence for columns with names."""
    path = tmp_path / "bare.csv"
    rows = [f"{0.01 * k:.2f},shoulder,{a:.6f},{v:.6f},{u:.6f}" for k, (a, v, u) in
            enumerate(zip(ANGLE, SPEED, TORQUE, strict=True))]  # fmt: skip
    path.write_text("\n".join([*rows, ""]))
    with pytest.raises(RecordingError, match=r"no line that names its columns.*write a line"):
        taken(path)


def test_columns_that_are_no_motion_are_named(tmp_path: Path) -> None:
    """Mutation: the time among them."""
    path = table(tmp_path, {"Time(s)": T, "CH1(V)": TORQUE, "CH2(V)": ANGLE})
    with pytest.raises(RecordingError, match="position or a velocity, only CH1 and CH2; name"):
        taken(path)
